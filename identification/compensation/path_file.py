"""A corrected path as text: a million rows in a second."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv as pacsv  # type: ignore[import-untyped]

MANY = 10_000
"""Rows from which a table is written by columns."""


def csv_text(frame: pd.DataFrame) -> str:
    """A table as CSV, floats at full precision; what is long, by columns."""
    if len(frame) >= MANY and all(_is_plain(frame[name]) for name in frame):
        stream = io.BytesIO()
        header = frame.head(0).to_csv(index=False, lineterminator="\n")
        try:
            table = pa.Table.from_pandas(frame, preserve_index=False)
            pacsv.write_csv(table, stream, pacsv.WriteOptions(include_header=False, quoting_style="none"))
            return header + stream.getvalue().decode()
        except pa.ArrowException:
            pass  # a text with a comma in it, or cells of several kinds
    return str(frame.to_csv(index=False, lineterminator="\n"))


def _is_plain(column: pd.Series[Any]) -> bool:
    return column.dtype in (np.float64, np.int64, np.object_) or isinstance(column.dtype, pd.StringDtype)
