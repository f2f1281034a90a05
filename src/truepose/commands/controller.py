"""``codegen``: C for the controller."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from truepose.commands.common import AnywayOption, DirectoryOption, JsonOption, MachineArg, finish, progress
from truepose.commands.results import check_code, check_directory
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
    from truepose.codegen.c import generate
    from truepose.codegen.features import ALL, Features

    check_directory(output)
    number = _number(real)
    chosen = ALL if features is None else Features.of(features)
    with progress("writing C"):
        loaded = _machine_for(output, machine, anyway=anyway)
        drawing = (loaded.file.nominal if loaded.file else {}) or None
        paths = generate(loaded, output, number, nominal=drawing, features=chosen)
    files = sorted(str(path) for path in paths)
    summary, lines = _told(loaded, chosen)
    head = {"command": "codegen", "machine": loaded.name, "real": number, "features": list(chosen.names)}
    finish({**head, "files": files, **summary}, [*files, *lines], [], as_json=as_json)


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
    from truepose.codegen.left_out import left_out, left_out_json, left_out_words
    from truepose.identification.report.applied_words import expected_words, pose_json

    held = left_out(machine, features)
    payload: dict[str, object] = {
        "calibrated": held.calibrated,
        "left_out": left_out_json(held),
        "task": list(held.task.components),
        "expected_pose": pose_json(machine),
    }
    return payload, [*left_out_words(held), expected_words(machine)]
