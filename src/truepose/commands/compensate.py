"""``compensate``: commands that make the real machine follow a path."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import (
    AnywayOption,
    FileOption,
    JsonOption,
    MachineArg,
    check_file,
    finish,
    progress,
)
from truepose.files import atomic_file

if TYPE_CHECKING:
    import pandas as pd

    from truepose.models.machine.machine import Machine

PathArg = Annotated[
    Path,
    typer.Argument(
        metavar="PATH",
        help="Rows of nominal joint values, or of tool poses x y z rx ry rz in the base frame.",
    ),
]
MethodOption = Annotated[
    str,
    typer.Option(
        help="exact: the calibrated machine solved; first-order: the predicted error taken off the pose.",
        metavar="exact|first-order",
    ),
]


def compensate(
    machine: MachineArg,
    path: PathArg,
    output: FileOption,
    method: MethodOption = "exact",
    anyway: AnywayOption = False,
    as_json: JsonOption = False,
) -> None:
    """Commands that put the real tool where nominal joints and links, with the calibrated tool, would put it.

    MACHINE is a calibrated.yaml or improved.yaml; its effects use the path's drivers (payload, temperatures, time). Its task:
    says which components of the pose are met; without one, fewer than six joints meet what they can hold.
    A table comes back with the joints' columns corrected.

    Example: truepose compensate fit/calibrated.yaml path.csv -o commands.csv
    """
    correct_and_tell(
        lambda loaded: compensate_table(loaded, path, output, method),
        machine,
        output,
        anyway=anyway,
        as_json=as_json,
    )


Corrected = tuple[dict[str, object], list[str], list[str]]
"""Summary for --json, lines and notes."""


def correct_and_tell(
    correct: Callable[[Machine], Corrected], machine: Path, output: Path, *, anyway: bool, as_json: bool
) -> None:
    """Load a machine that may be applied, run a correction with it, and tell of it."""
    from truepose.identification.report.applied_words import check_applicable
    from truepose.models.load import load_machine

    check_file(output, machine)
    with progress("compensating"):
        loaded = load_machine(machine)
        if not anyway:
            check_applicable(loaded)
        summary, lines, notes = correct(loaded)
    summary = {"command": "compensate", **summary, "files": [str(output)]}
    finish(summary, lines, notes, as_json=as_json)


def compensate_table(machine: Machine, path: Path, output: Path, method: str) -> Corrected:
    """Write the commands for a table of joints or poses; summary, lines and notes."""
    from truepose.identification.compensation import compensate as compensation
    from truepose.identification.compensation.path_table import check_commands, commands, path_rows
    from truepose.identification.prediction.predict import unheard
    from truepose.identification.recording.table import read_table
    from truepose.identification.report.applied_words import expected_words, pose_json
    from truepose.identification.report.compensation_words import compensation_json, compensation_lines

    check_file(output, path)
    table, rows = path_rows(machine, read_table(path))
    found = compensation.compensate(machine, rows, method=method)  # type: ignore[arg-type]
    with atomic_file(output) as unfinished:
        _write(unfinished, output.suffix, commands(table, machine, found))
        if unfinished.is_file():  # a pipe is read by others
            check_commands(read_table(unfinished), machine, found.command, str(output))
    summary = {"method": method, **compensation_json(found)}
    lines = [*compensation_lines(found, output), f"  {expected_words(machine)}"]
    notes = [*rows.notes, *unheard(machine, rows), *found.notes]
    return summary | {"expected_pose": pose_json(machine)}, lines, notes


def _write(path: Path, suffix: str, frame: pd.DataFrame) -> None:
    if suffix.lower() in {".parquet", ".pq"}:
        frame.to_parquet(path, index=False)
    else:
        frame.to_csv(path, index=False, lineterminator="\n")
