"""Columns of a large file as pyarrow holds them: numbers are read column by column, single cells only when asked for.

``read_plain_csv`` reads plain numbers, texts and separators only. It leaves quotes, comments between rows and rows of the
wrong length to ``table.read_table``, as ``ArrowCells.numbers`` leaves cells that are no plain numbers to ``Table.numbers``.
Those also say what is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]
import pyarrow.csv as pacsv  # type: ignore[import-untyped]

from truepose.models.units import FloatArray

_NOT_PLAIN = (b'"', b"#", b"\0")
SEPARATORS = ("\t", ";", ",")
"""What may stand between columns, beside spaces."""


class ArrowCells(Sequence[object]):
    """Cells (n,) of a pyarrow array, or of numbers (n,)."""

    def __init__(self, cells: Any) -> None:
        self._cells = pa.array(cells) if isinstance(cells, np.ndarray) else cells

    @property
    def array(self) -> Any:
        """The pyarrow array itself."""
        return self._cells

    def __len__(self) -> int:
        return len(self._cells)

    def __getitem__(self, place: Any) -> Any:
        return self._list[place]

    def __iter__(self) -> Iterator[object]:
        return iter(self._list)

    @cached_property
    def _list(self) -> list[object]:
        out: list[object] = self._cells.to_pylist()
        return out

    def numbers(self, *, lost: bool = False) -> FloatArray | None:
        """(n,) values if every cell is a finite number or the plain text of one, else None.

        Where cells may be ``lost``, an empty one is NaN, and so is NaN itself unless it is a text.
        """
        cells, kind = self._cells, self._cells.type
        text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
        if not (text or pa.types.is_integer(kind) or pa.types.is_floating(kind)):
            return None
        if lost and text:
            empty = pc.equal(pc.utf8_trim_whitespace(cells), "")
            cells = pc.if_else(empty, pa.scalar(None, kind), cells)
        elif lost and pa.types.is_floating(kind):
            cells = pc.if_else(pc.is_nan(cells), pa.scalar(None, kind), cells)
        if cells.null_count and not lost:
            return None
        try:
            values = pc.cast(cells, pa.float64(), safe=False)
        except pa.ArrowException:
            return None
        out: FloatArray = np.array(values, dtype=np.float64)
        return out if np.count_nonzero(~np.isfinite(out)) == cells.null_count else None


def read_plain_csv(data: bytes) -> tuple[list[str], str, list[ArrowCells]] | None:
    """Headers, what separates them and columns of texts; None for a file with anything else than plain cells."""
    start = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    while True:  # comments and empty lines before the header
        end = data.find(b"\n", start)
        line = data[start : end if end >= 0 else len(data)].strip()
        if end < 0 or (line and not line.startswith(b"#")):
            break
        start = end + 1
    if end < 0 or b'"' in line or any(data.find(mark, end) >= 0 for mark in _NOT_PLAIN):
        return None
    try:
        header = line.decode("utf-8")
        known = [separator for separator in SEPARATORS if separator in header]
        if len(known) != 1:  # one column, or a header that alone does not tell
            return None
        names = header.split(known[0])
        return names, known[0], _columns(memoryview(data)[end + 1 :], len(names), known[0])
    except (UnicodeDecodeError, pa.ArrowException):
        return None


def _columns(body: memoryview, count: int, separator: str) -> list[ArrowCells]:
    keys = [str(k) for k in range(count)]
    read = pacsv.read_csv(
        pa.BufferReader(pa.py_buffer(body)),
        read_options=pacsv.ReadOptions(column_names=keys),
        parse_options=pacsv.ParseOptions(delimiter=separator, quote_char=False),
        convert_options=pacsv.ConvertOptions(
            column_types=dict.fromkeys(keys, pa.string()), strings_can_be_null=False
        ),
    )
    return [ArrowCells(column) for column in read.columns]


__all__ = ["SEPARATORS", "ArrowCells", "read_plain_csv"]
