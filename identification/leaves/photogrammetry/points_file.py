"""Files of measured points (CSV or Parquet): the placements, and the body that carries the points. mm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.leaves.photogrammetry.pose_table import COORDINATE
from truepose.identification.recording.table import Table, read_table
from truepose.models.units import convert
from truepose.wording import close_matches

POINT, AXES = "point", ("x", "y", "z")


def read_points(path: Path) -> pd.DataFrame:
    """One row a placement: points' columns (``P1.x P1.y P1.z ...``) in mm, NaN where empty; others as they stand.

    A column may carry a unit, ``P1.x [um]``. Raises InputError naming file, row and column for what is no number.
    """
    table = read_table(path)
    out: dict[str, object] = {}
    for column in table.columns:
        if COORDINATE.match(column.name):
            out[column.name] = _lengths(table, column.name)
        else:
            unit = "" if column.unit is None else f" [{column.unit}]"
            out[f"{column.name}{unit}"] = list(table.cells[column.name])
    return pd.DataFrame(out)


def read_body(path: Path) -> dict[str, tuple[float, ...]]:
    """Points in the body's frame, by name, from the columns ``point x y z``. Raises InputError like ``read_points``."""
    table = read_table(path)
    for name in (POINT, *AXES):
        if name not in table:
            raise InputError(f"{path}: missing column {name!r}; {close_matches(name, table.names)}")
    names = table.texts(POINT)
    for row, name in enumerate(names):
        if name in names[:row]:
            raise InputError(f"{table.where(POINT, row)}: found {name!r} again, expected each point once")
    rows = np.column_stack([_lengths(table, axis, gaps=False) for axis in AXES])
    return {name: tuple(float(v) for v in row) for name, row in zip(names, rows, strict=True)}


def _lengths(table: Table, name: str, *, gaps: bool = True) -> Array:
    """(n,) mm; NaN for an empty cell where ``gaps`` are allowed."""
    cells = list(table.cells[name])
    empty = np.array([gaps and (cell is None or str(cell).strip() == "") for cell in cells], dtype=bool)
    filled = ["0" if gap else cell for cell, gap in zip(cells, empty, strict=True)]
    numbers = replace(table, cells={**table.cells, name: filled}).numbers(name)
    return np.where(empty, np.nan, convert(numbers, table.unit(name, "mm", "length"), "mm"))
