"""Generated C measured on emulated controllers, each machine once in a process."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from support import ROOT
from support.generated_machines import BODIES, machine_of
from truepose.codegen.c import generate
from truepose.codegen.leaves.embedded.measure import Measurement, measure
from truepose.codegen.leaves.embedded.program import read_source
from truepose.codegen.leaves.embedded.toolchain import Target, missing
from truepose.codegen.printer import Real
from truepose.models.load import load_machine

LACKS = missing()
needs_toolchain = pytest.mark.skipif(bool(LACKS), reason=f"found no {', no '.join(LACKS)}")
TICKS = 3.2
"""Of the boards' timers, an instruction: 128 ns by 40 ns."""
REALS: tuple[Real, ...] = ("double", "float")


@cache
def written(where: Path, name: str, real: Real) -> Path:
    """The directory of a machine's C: one of ``generated_machines``, or one that comes with truepose."""
    bundled = ROOT / "models" / "machines" / name / "machine.yaml"
    directory = where / f"embedded_{name}_{real}"
    generate(machine_of(where, name) if name in BODIES else load_machine(bundled), directory, real)
    return directory


@cache
def measured(where: Path, name: str, real: Real) -> Measurement:
    return measure(written(where, name, real))


def allowed(directory: Path) -> tuple[float, float]:
    """Position (mm) and angle (rad) within which a pose counts as met (interface.md, section 5)."""
    source = read_source(directory)
    reach = max(300.0, float(np.max(np.linalg.norm(source.poses[:, 3::4], axis=1))))
    return (1e-6, 1e-9) if source.real == "double" else (2e-6 * reach, 2e-6)


def log(target: Target, turns: int, ticks: int, deep: int = 8) -> str:
    """What a run would say that saw ``turns`` of the known loop take ``ticks`` ticks, and two words ``deep`` bytes."""
    zeros = " ".join(["00" * (8 if target.real == "double" else 4)] * 2)
    calls = (
        f"nothing 0 0 1 {round(3 * TICKS)} 0",
        f"turn {turns} 0 1 {ticks} 0",
        f"dig 2 0 1 {round(12 * TICKS)} {deep}",
    )
    return "".join(f"{call} {zeros}\n" for call in calls) + "end\n"
