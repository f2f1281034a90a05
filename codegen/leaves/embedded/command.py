"""``codegen`` with ``--measure``: what the generated C takes on an emulated controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.codegen.c import generate
from truepose.codegen.features import ALL, Features
from truepose.codegen.leaves.embedded.measure import OPTIMISATIONS, Measurement, measure
from truepose.codegen.leaves.embedded.section import sizes_section
from truepose.codegen.leaves.embedded.toolchain import required
from truepose.codegen.printer import Real
from truepose.commands.common import AnywayOption, DirectoryOption, JsonOption, MachineArg
from truepose.commands.controller import FeaturesOption, RealOption, write_and_tell
from truepose.files import atomic_directory
from truepose.models.machine.machine import Machine

if TYPE_CHECKING:
    from truepose.codegen.features import Features
    from truepose.codegen.printer import Real
    from truepose.models.machine.machine import Machine


def generate_measured(
    machine: Machine,
    directory: Path,
    real: Real = "double",
    *,
    nominal: Mapping[str, float] | None = None,
    optimisations: Sequence[str] = OPTIMISATIONS,
    features: Features = ALL,
) -> tuple[list[Path], list[Measurement]]:
    """``generate``, with a section of measurements at the end of README.md; the paths, and the measurements.

    Unlike what ``generate`` writes, README.md then depends on the compiler and the emulator of this computer, both
    of which it names. Raises InputError as ``generate`` and ``measure`` do; nothing is written then.
    """
    tools = required()
    with atomic_directory(directory) as partial:
        files = generate(machine, partial, real, nominal=nominal, features=features)
        measured = [
            measure(partial, machine.name, optimisation=level, tools=tools) for level in optimisations
        ]
        readme = partial / "README.md"
        text = readme.read_text(encoding="utf-8") + "\n" + sizes_section(measured)
        readme.write_text(text, encoding="utf-8", newline="\n")
    return [Path(directory) / file.relative_to(partial) for file in files], measured


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
    from truepose.codegen.leaves.embedded.command import generate_measured
    from truepose.codegen.leaves.embedded.section import summary

    paths, measured = generate_measured(machine, output, real, nominal=drawing, features=features)
    more: dict[str, object] = {"measured": [asdict(one) for one in measured]} if measured else {}
    return paths, more, summary(measured)


COMMANDS = (codegen,)
