"""``codegen``: C for the controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from truepose.commands.common import (
    AnywayOption,
    DirectoryOption,
    JsonOption,
    MachineArg,
    check_code,
    check_directory,
    finish,
    progress,
)
from truepose.errors import InputError

if TYPE_CHECKING:
    from truepose.codegen.features import Features
    from truepose.codegen.printer import Real
    from truepose.models.machine.machine import Machine

RealOption = Annotated[str, typer.Option(help="Type of every number.", metavar="double|float")]
FeaturesOption = Annotated[
    str | None,
    typer.Option(
        help="What is generated, separated by commas, and small code: warm, cold, branches, p, batch, state; default all.",
        metavar="LIST",
    ),
]


def codegen(
    machine: MachineArg,
    output: DirectoryOption,
    real: RealOption = "double",
    features: FeaturesOption = None,
    anyway: AnywayOption = False,
    as_json: JsonOption = False,
) -> None:
    """C99 for the controller: forward and inverse kinematics, Jacobian, compensation.

    Example: truepose codegen fit/calibrated.yaml -o controller

    Example: truepose codegen fit/calibrated.yaml -o small --features warm
    """
    write_and_tell(machine, output, real, features, anyway=anyway, as_json=as_json)


Write = Callable[..., "tuple[list[Path], dict[str, object], list[str]]"]
"""Writes the C of a machine: paths, what is added to --json, and lines; arguments as ``write_c``."""


def write_and_tell(
    machine: Path,
    output: Path,
    real: str,
    features: str | None,
    *,
    anyway: bool,
    as_json: bool,
    write: Write | None = None,
) -> None:
    """Write the C of a machine's file into ``output``, and tell what it holds."""
    from truepose.codegen.features import ALL, Features

    check_directory(output)
    number = _number(real)
    chosen = ALL if features is None else Features.of(features)
    with progress("writing C"):
        loaded = _machine_for(output, machine, anyway=anyway)
        drawing = (loaded.file.nominal if loaded.file else {}) or None
        paths, more, added = (write or write_c)(loaded, output, number, drawing, chosen)
    files = sorted(str(path) for path in paths)
    summary, lines = _told(loaded, chosen)
    head = {"command": "codegen", "machine": loaded.name, "real": number, "features": list(chosen.names)}
    finish({**head, "files": files, **summary, **more}, [*files, *lines, *added], [], as_json=as_json)


def write_c(
    machine: Machine, output: Path, real: Real, drawing: Mapping[str, float] | None, features: Features
) -> tuple[list[Path], dict[str, object], list[str]]:
    """Write the C, which compensates for what differs from the ``drawing``."""
    from truepose.codegen.c import generate

    return generate(machine, output, real, nominal=drawing, features=features), {}, []


def _number(real: str) -> Real:
    """The type of every number. Raises InputError for another one."""
    if real not in ("double", "float"):
        raise InputError(f"--real: found {real!r}, expected 'double' or 'float'")
    return cast("Real", real)


def _machine_for(output: Path, path: Path, *, anyway: bool) -> Machine:
    """The machine of a file. Raises InputError where ``output`` holds another one's C, or the file should not be applied."""
    from truepose.identification.report.applied_words import check_applicable
    from truepose.models.load import load_machine

    machine = load_machine(path)
    check_code(output, machine.name)
    if not anyway:
        check_applicable(machine)
    return machine


def _told(machine: Machine, features: Features) -> tuple[dict[str, object], list[str]]:
    """What the C holds and what it leaves out: for --json, and in lines."""
    from truepose.codegen.features import left_out, left_out_json, left_out_words
    from truepose.identification.report.applied_words import expected_words, pose_json

    held = left_out(machine, features)
    payload: dict[str, object] = {
        "calibrated": held.calibrated,
        "left_out": left_out_json(held),
        "task": list(held.task.components),
        "expected_pose": pose_json(machine),
    }
    return payload, [*left_out_words(held), expected_words(machine)]
