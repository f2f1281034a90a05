"""Tables that are in memory already: DataFrames, dicts of columns, Arrow tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa  # type: ignore[import-untyped]

from truepose.errors import InputError
from truepose.identification.recording.arrow_columns import ArrowCells


def is_table(source: object) -> bool:
    """Whether a source holds columns itself: a mapping, a DataFrame, or anything that gives Arrow columns."""
    return isinstance(source, (Mapping, pd.DataFrame)) or hasattr(source, "__arrow_c_stream__")


def columns_of(source: Any, where: str) -> tuple[list[str], list[Sequence[object]]]:
    """Headers and cells; NaN and None are empty cells. Raises InputError for names that are no text, unequal columns."""
    if not isinstance(source, (Mapping, pd.DataFrame)):
        try:
            table = pa.table(source)
        except pa.ArrowInvalid as exc:
            raise InputError(
                f"{where}: found one column without a name, expected a table of columns"
            ) from exc
        return list(table.column_names), [ArrowCells(column) for column in table.columns]
    names = list(source.keys())
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"{where}: found the column {name!r}, expected names that are texts")
    if isinstance(source, pd.DataFrame):
        return names, [_cells(source.iloc[:, k]) for k in range(len(names))]
    series = [_series(source[name], f"{where}: column {name!r}") for name in names]
    sizes = {name: len(column) for name, column in zip(names, series, strict=True)}
    if len(set(sizes.values())) > 1:
        short, long = min(sizes, key=sizes.__getitem__), max(sizes, key=sizes.__getitem__)
        raise InputError(
            f"{where}: found {sizes[short]} values in {short!r} and {sizes[long]} in {long!r}, expected as many"
        )
    return names, [_cells(column) for column in series]


def _series(values: Any, where: str) -> pd.Series[Any]:
    """One column, without an index that could put its values in other rows."""
    if isinstance(values, (str, bytes)) or np.ndim(values) != 1:
        raise InputError(f"{where}: expected a sequence of values, one a row")
    return pd.Series(list(values) if not isinstance(values, (np.ndarray, pd.Series)) else np.asarray(values))


def _cells(column: pd.Series[Any]) -> Sequence[object]:
    try:
        found = pa.array(column, from_pandas=True)
    except pa.ArrowException:  # cells of several kinds
        return [None if cell is None or pd.isna(cell) else cell for cell in column]
    return ArrowCells(found)
