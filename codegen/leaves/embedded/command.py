"""``codegen`` with ``--measure``: what the generated C takes on an emulated controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import AnywayOption, DirectoryOption, JsonOption, MachineArg
from truepose.commands.controller import FeaturesOption, RealOption, write_and_tell

if TYPE_CHECKING:
    from truepose.codegen.features import Features
    from truepose.codegen.printer import Real
    from truepose.models.machine.machine import Machine


MeasureOption = Annotated[
    bool,
    typer.Option(
        "--measure",
        help="Run it on an emulated Cortex-M7 (float: M4F) and state in README.md what it takes there.",
    ),
]


def codegen(
    machine: MachineArg,
    output: DirectoryOption,
    real: RealOption = "double",
    features: FeaturesOption = None,
    measure: MeasureOption = False,
    anyway: AnywayOption = False,
    as_json: JsonOption = False,
) -> None:
    """C99 for the controller: forward and inverse kinematics, Jacobian, compensation.

    Example: truepose codegen fit/calibrated.yaml -o controller

    Example: truepose codegen fit/calibrated.yaml -o small --features warm
    """
    write = _write_measured if measure else None
    write_and_tell(machine, output, real, features, anyway=anyway, as_json=as_json, write=write)


def _write_measured(
    machine: Machine, output: Path, real: Real, drawing: Mapping[str, float] | None, features: Features
) -> tuple[list[Path], dict[str, object], list[str]]:
    from truepose.codegen.leaves.embedded.section import generate_measured, summary

    paths, measured = generate_measured(machine, output, real, nominal=drawing, features=features)
    more: dict[str, object] = {"measured": [asdict(one) for one in measured]} if measured else {}
    return paths, more, summary(measured)


COMMANDS = (codegen,)
