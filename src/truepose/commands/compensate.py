"""``compensate``: commands that make the real machine follow a path."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import (
    AnywayOption,
    FileOption,
    JsonOption,
    MachineArg,
    PluginOption,
    check_file,
    finish,
    progress,
    reported,
)
from truepose.files import write_table

if TYPE_CHECKING:
    import pandas as pd

PathArg = Annotated[
    Path,
    typer.Argument(
        metavar="PATH",
        help="Rows of nominal joint values, or of tool poses x y z rx ry rz in the base frame.",
        show_default=False,
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
    plugin: PluginOption = None,
) -> None:
    """Commands that put the real tool where nominal joints and links, with the calibrated tool, would put it.

    MACHINE is a calibrated.yaml or improved.yaml; its effects use the path's drivers (payload, temperatures, time).
    The path's table comes back with the joints' columns corrected.

    Example: truepose compensate fit/calibrated.yaml path.csv -o commands.csv
    """
    with reported(plugin):
        from truepose.identification.compensation import compensate as compensation
        from truepose.identification.compensation.path_table import commands, load_path
        from truepose.identification.prediction.predict import unheard
        from truepose.identification.report.applied_words import check_applicable, expected_words, pose_json
        from truepose.identification.report.compensation_words import compensation_json, compensation_lines
        from truepose.models.load import load_machine

        check_file(output)
        with progress("compensating"):
            loaded = load_machine(machine)
            if not anyway:
                check_applicable(loaded)
            table, rows = load_path(loaded, path)
            found = compensation.compensate(loaded, rows, method=method)  # type: ignore[arg-type]
            _write(output, commands(table, loaded, found))
        how = {"method": method, "solved_by": found.solved_by}
        summary = {"command": "compensate", **how, **compensation_json(found), "files": [str(output)]}
        summary |= {"expected_pose": pose_json(loaded)}
        lines = [*compensation_lines(found, output), f"  {expected_words(loaded)}"]
        finish(summary, lines, [*rows.notes, *unheard(loaded, rows)], as_json=as_json)


def _write(path: Path, frame: pd.DataFrame) -> None:
    from truepose.files import atomic_write_text
    from truepose.identification.compensation.path_file import csv_text

    if path.suffix.lower() in {".parquet", ".pq"}:
        write_table(path, frame)
    else:
        atomic_write_text(path, csv_text(frame))
