"""``compensate`` for tables and robot programs: its options for a program, whose targets are corrected in place."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import AnywayOption, FileOption, JsonOption, MachineArg, options, pairs
from truepose.commands.compensate import Corrected, MethodOption, compensate_table, correct_and_tell
from truepose.errors import InputError, ReadBackError
from truepose.files import atomic_file

if TYPE_CHECKING:
    from truepose.identification.leaves.programs.dialects import Dialect
    from truepose.identification.leaves.programs.frames import Cell
    from truepose.identification.leaves.programs.words import Limit
    from truepose.models.machine.machine import Machine


PathArg = Annotated[
    Path,
    typer.Argument(
        metavar="PATH",
        help="Rows of nominal joint values, or of tool poses x y z rx ry rz in the base frame; or a robot program "
        "(.src .dat .mod .script).",
    ),
]


@options(
    dialect="kuka|rapid|urscript|csv: How a program is written, where its ending does not tell; csv: points of a table "
    "corrected in place.",
    base="X,Y,Z,...: Frame of a program's poses in the robot's base, where the program names none, in the program's own "
    "numbers.",
    tool="X,Y,Z,...: Tool on the flange in a program's own numbers; where neither it nor the program tells, the machine "
    "file's.",
    frame="NAME=X,Y,Z,...: Numbers of a work object, base, feature or tool that a program names; repeatable.",
    at="DRIVER=VALUE: Value of a driver (payload=3, temperature.base=24) at a program's targets; repeatable.",
    limit="--limit: Point out targets of a program that move by more mm than this.",
    limit_angle="--limit-angle: Point out targets of a program that turn by more deg than this.",
)
def compensate(
    machine: MachineArg,
    path: PathArg,
    output: FileOption,
    method: MethodOption = "exact",
    dialect: str | None = None,
    base: str | None = None,
    tool: str | None = None,
    frame: list[str] | None = None,
    at: list[str] | None = None,
    limit: float = 5.0,
    limit_angle: float = 1.0,
    anyway: AnywayOption = False,
    as_json: JsonOption = False,
) -> None:
    """Commands that put the real tool where nominal joints and links, with the calibrated tool, would put it.

    MACHINE is a calibrated.yaml or improved.yaml; its effects use the path's drivers (payload, temperatures, time). Its task:
    says which components of the pose are met; without one, fewer than six joints meet what they can hold.
    A table comes back with the joints' columns corrected. In a robot program (KUKA .src and .dat, ABB .mod, URScript) the
    numbers of the targets are corrected where they stand, or where a motion names them; what cannot be is listed by line.

    Example: truepose compensate fit/calibrated.yaml path.csv -o commands.csv

    Example: truepose compensate fit/calibrated.yaml job.src -o job_corrected.src --frame "BASE_DATA[1]=800,0,400,0,0,0"
    """

    def corrected(loaded: Machine) -> Corrected:
        from truepose.identification.leaves.programs.dialects import dialect_of
        from truepose.identification.leaves.programs.frames import Cell
        from truepose.identification.leaves.programs.words import Limit

        known = dialect_of(path, dialect)
        if known is None:
            for name, value in {"--base": base, "--tool": tool, "--frame": frame, "--at": at}.items():
                if value:
                    raise InputError(
                        f"{name}: found it with a table, expected a robot program (or --dialect csv, to correct a table's"
                        " points in place)"
                    )
            return compensate_table(loaded, path, output, method)
        if method != "exact":
            raise InputError(f"--method: found {method!r} with a robot program, expected exact")
        cell = Cell(base, tool, pairs("--frame", frame or (), "NAME=VALUE"))
        drivers = {name: _value(name, text) for name, text in pairs("--at", at or (), "NAME=VALUE").items()}
        return _correct_program(loaded, known, (path, output), cell, drivers, Limit(limit, limit_angle))

    correct_and_tell(corrected, machine, output, anyway=anyway, as_json=as_json)


def _correct_program(
    machine: Machine,
    dialect: Dialect,
    files: tuple[Path, Path],
    cell: Cell,
    drivers: Mapping[str, float],
    limit: Limit,
) -> Corrected:
    """Correct a program's targets; summary, lines and notes. Nothing is written where nothing can be corrected."""
    from truepose.identification.leaves.programs.correct import correct
    from truepose.identification.leaves.programs.dialects import beside, text_of
    from truepose.identification.leaves.programs.words import (
        correction_json,
        correction_lines,
        correction_notes,
    )
    from truepose.identification.report.applied_words import expected_words, pose_json

    path, output = files
    if output.exists() and output.samefile(path):
        raise InputError(
            f"{output}: found the program itself, expected another file: twice corrected is wrong"
        )
    try:
        program = dialect.read(text_of(path), machine, beside(path))
        found = correct(machine, program, cell, drivers)
    except ReadBackError as exc:
        line = "" if str(exc)[0].isdigit() else " "
        raise ReadBackError(f"{output}:{line}{exc}") from exc
    except InputError as exc:
        raise exc if str(exc).startswith("--") else InputError(f"{path}: {exc}") from None
    if not found.done:
        first = found.left[0]
        raise InputError(
            f"{path}:{first.line}: {first.what}: no target can be corrected, the first because: {first.why}"
        )
    with atomic_file(output) as unfinished:
        unfinished.write_bytes(found.text.encode("latin-1"))
    summary = {"dialect": dialect.name, **correction_json(found, limit), "expected_pose": pose_json(machine)}
    lines = correction_lines(found, dialect.title, path, output)
    return summary, [*lines, f"  {expected_words(machine)}"], correction_notes(found, machine, limit)


def _value(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--at {name}: found {text!r}, expected a number") from None


COMMANDS = (compensate,)
