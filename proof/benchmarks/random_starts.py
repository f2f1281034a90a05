"""Reachable poses from random starts: how many the generated inverse solves, machine by machine.

    python -m benchmarks.random_starts [-n 100000] [--real double] [MACHINE...]

Without files: the three bundled machines. Joints are drawn evenly within their ranges (what has none: where the
generated test vectors are drawn), their pose is the target, and the guess is drawn in the same way. Prints a table; the last
column counts poses at which forward kinematics of the solution, started at the pose, found another assembly.
Six-joint arms with errors everywhere are in ``python -m benchmarks.inverse_kinematics --part random``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from truepose.codegen.c import generate
from truepose.codegen.layout import layout_of
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

ROOT = Path(__file__).resolve().parents[2]
BUNDLED = [
    ROOT / "models" / "machines" / name / "machine.yaml"
    for name in ("nanopositioner", "telescope", "polisher")
]
DRIVER = Path(__file__).with_suffix(".c")
HEAD = (
    "| machine | poses | solved | codes 1, 2, 3 | us a pose, with the clock | largest error, mm and entry of R "
    "| fk_from elsewhere |"
)


def row(machine: Machine, poses: int, real: str) -> str:
    """One line of the table."""
    with tempfile.TemporaryDirectory() as folder:
        generate(machine, Path(folder), "float" if real == "float" else "double")
        name = machine.name
        defines = [f"-DNAME={name}", f'-DHEADER="{name}_kin.h"', "-I."]
        files = [str(DRIVER), f"{name}_kin.c", "-lm", "-o", "driver"]
        subprocess.run(["cc", "-O2", *defines, *files], cwd=folder, check=True)
        ends = [repr(float(end)) for pair in _ranges(machine) for end in pair]
        ran = subprocess.run(
            ["./driver", str(poses), *ends], cwd=folder, check=True, capture_output=True, text=True
        )
    solved, one, two, three, _, elsewhere, time, position, rotation = ran.stdout.split()
    codes, error = f"{one}, {two}, {three}", f"{position}, {rotation}"
    return f"| {name} | {poses} | {solved} | {codes} | {float(time):.2f} | {error} | {elsewhere} |"


def _ranges(machine: Machine) -> list[tuple[float, float]]:
    layout = layout_of(symbolic_model(machine, machine.effects), "double")
    spread = zip(layout.start - 0.5 * layout.width, layout.start + 0.5 * layout.width, strict=True)
    actuators = machine.mechanism.actuators
    return [a.range or (float(low), float(high)) for a, (low, high) in zip(actuators, spread, strict=True)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("machines", nargs="*", type=Path, default=BUNDLED)
    parser.add_argument("-n", type=int, default=100_000)
    parser.add_argument("--real", choices=("double", "float"), default="double")
    arguments = parser.parse_args()
    sys.stdout.write(HEAD + "\n" + "|---" * 7 + "|\n")
    for file in arguments.machines:
        sys.stdout.write(row(load_machine(file), arguments.n, arguments.real) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
