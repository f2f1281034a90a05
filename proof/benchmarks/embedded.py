"""What the generated C takes on a controller: instructions, stack and bytes on Cortex-M7 and Cortex-M4F.

    python -m benchmarks.embedded [MACHINE...]

Without a file: a UR10 in the modified convention with Hayati's rotation, errors of up to 1 mm and 0.5 deg in every
parameter, so that no decoupled closed form holds. Needs the toolchain that docs/reference/codegen.md names. Prints one table a
machine, double on Cortex-M7 and float on Cortex-M4F, each at -O2 and -Os. Counts are exact and repeat on any computer
with the same compiler.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from truepose.codegen.c import generate
from truepose.codegen.leaves.embedded.measure import OPTIMISATIONS, Measurement, measure
from truepose.codegen.leaves.embedded.section import table
from truepose.codegen.printer import Real
from truepose.errors import InputError
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

REALS: tuple[Real, ...] = ("double", "float")
# Universal Robots' published lengths, in the modified convention: alpha (deg), d, r (mm)
UR10 = ((0, 0, 127.3), (90, 0, 0), (0, -612.0, 0), (0, -572.3, 163.941), (90, 0, 115.7), (-90, 0, 92.2))
SEED = 10
LENGTH, ANGLE = 1.0, 0.5


def ur10() -> str:
    """A machine file of the UR10 with errors drawn evenly within +-1 mm and +-0.5 deg."""
    random = np.random.default_rng(SEED)
    lines = ["schema: truepose/machine/1", "name: ur10", "mechanism:", "  type: serial", "  joints:"]
    for k, (alpha, d, r) in enumerate(UR10, start=1):
        beta, twist, away, theta, along = random.uniform(-1, 1, 5) * (ANGLE, ANGLE, LENGTH, ANGLE, LENGTH)
        lines.append(
            f"    - {{name: q{k}, kind: revolute, beta: {beta:.5f}, alpha: {alpha + twist:.5f}, d: {d + away:.5f}, "
            f"theta: {theta:.5f}, r: {r + along:.5f}, range: [-360, 360]}}"
        )
    x, y, z = random.uniform(-1, 1, 3) * LENGTH
    turns = ", ".join(f"{angle:.4f}" for angle in random.uniform(-1, 1, 3) * ANGLE)
    tool = f"xyz: [{x:.4f}, {y:.4f}, {100 + z:.4f}], rpy: [{turns}]"
    return "\n".join([*lines, f"frames: {{tool: {{in: flange, {tool}}}}}", ""])


def measured(machine: Machine, folder: Path) -> list[Measurement]:
    """Both precisions, each on its target, at every optimisation."""
    found = []
    for real in REALS:
        generate(machine, folder / real, real)
        found += [measure(folder / real, optimisation=level) for level in OPTIMISATIONS]
    return found


def main(files: list[str]) -> int:
    """Generate, measure and print; 2 when something is missing."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "ur10.yaml").write_text(ur10(), encoding="utf-8")
        for k, file in enumerate(files or [str(folder / "ur10.yaml")]):
            try:
                found = measured(load_machine(Path(file)), folder / str(k))
            except InputError as exc:
                sys.stderr.write(f"error: {exc}\n")
                return 2
            sys.stdout.write("\n".join([*table(found), "", ""]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
