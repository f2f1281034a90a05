"""``compensate``: commands that make the real machine follow a path."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import (
    FileOption,
    JsonOption,
    MachineArg,
    PluginOption,
    check_file,
    finish,
    progress,
    reported,
)
from truepose.commands.tables import write_table

if TYPE_CHECKING:
    import pandas as pd

    from truepose.identification.compensation.compensate import Compensation

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
    as_json: JsonOption = False,
    plugin: PluginOption = None,
) -> None:
    """Commands that put the real tool where nominal joints and links, with the calibrated tool, would put it.

    MACHINE is a calibrated.yaml or improved.yaml; its effects use the path's drivers (payload, temperatures, time).
    The path's table comes back with the joints' columns corrected.

    Example: truepose compensate result/calibrated.yaml path.csv -o commands.csv
    """
    with reported(plugin):
        from truepose.identification.compensation import compensate as compensation
        from truepose.identification.compensation.path_table import commands, load_path
        from truepose.identification.prediction.predict import unheard
        from truepose.models.load import load_machine

        check_file(output)
        with progress("compensating"):
            loaded = load_machine(machine)
            table, rows = load_path(loaded, path)
            found = compensation.compensate(loaded, rows, method=method)  # type: ignore[arg-type]
            _write(output, commands(table, loaded, found))
        how = {"method": method, "solved_by": found.solved_by}
        summary = {"command": "compensate", **how, **_figures(found), "files": [str(output)]}
        finish(summary, _lines(found, output), [*rows.notes, *unheard(loaded, rows)], as_json=as_json)


def _write(path: Path, frame: pd.DataFrame) -> None:
    from truepose.files import atomic_write_text
    from truepose.identification.compensation.path_file import csv_text

    if path.suffix.lower() in {".parquet", ".pq"}:
        write_table(path, frame)
    else:
        atomic_write_text(path, csv_text(frame))


def _figures(found: Compensation) -> dict[str, object]:
    """Rows, largest pose errors as the calibrated model predicts them, largest change of each command."""
    import numpy as np

    def largest(twists: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> dict[str, object]:
        norms = [np.linalg.norm(twists[:, part], axis=1) for part in (slice(0, 3), slice(3, 6))]
        return {
            "position": {"value": float(np.max(norms[0])), "unit": "mm"},
            "rotation": {"value": float(np.max(norms[1])), "unit": "rad"},
        }

    change = np.max(np.abs(found.command - found.nominal), axis=0)
    return {
        "rows": len(found.command),
        "largest_error": {"before": largest(found.before), "after": largest(found.after)},
        "largest_correction": dict(zip(found.readings, change.tolist(), strict=True)),
    }


def _lines(found: Compensation, output: Path) -> list[str]:
    import numpy as np

    def words(twists: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
        position = np.max(np.linalg.norm(twists[:, :3], axis=1))
        rotation = np.degrees(np.max(np.linalg.norm(twists[:, 3:], axis=1)))
        return f"{position:.4g} mm, {rotation:.4g} deg"

    return [
        f"{output}: {len(found.command)} rows, solved by {found.solved_by}",
        f"  largest pose error, as the calibrated model has it: {words(found.before)} with the path's commands, "
        f"{words(found.after)} with these",
    ]
