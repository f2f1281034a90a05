"""Columns of a large file as pyarrow holds them: numbers are read column by column, single cells only when asked for.

What is no plain number is left to ``Table.numbers``, which also says what is wrong with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]

from truepose.arrays import Array


class ArrowCells(Sequence[object]):
    """Cells (n,) of a pyarrow array, or of numbers (n,)."""

    def __init__(self, cells: Any) -> None:
        self._cells = pa.array(cells) if isinstance(cells, np.ndarray) else cells

    def __len__(self) -> int:
        return len(self._cells)

    def __getitem__(self, place: Any) -> Any:
        return self._list[place]

    def __iter__(self) -> Iterator[object]:
        return iter(self._cells.to_pylist())

    @cached_property
    def _list(self) -> list[object]:
        out: list[object] = self._cells.to_pylist()
        return out

    @property
    def empty(self) -> bool:
        """Whether no cell holds anything but blanks."""
        first = self._cells[0].as_py() if len(self) else None
        if first is not None and str(first).strip():
            return False
        told = _plain(self._cells).drop_null()
        text = pa.types.is_string(told.type) or pa.types.is_large_string(told.type)
        return not len(told) or (text and not pc.any(pc.not_equal(pc.utf8_trim_whitespace(told), "")).as_py())

    def numbers(self, *, lost: bool = False) -> Array | None:
        """(n,) values if every cell is a finite number or the plain text of one, else None.

        Where cells may be ``lost``, an empty one is NaN, and so is NaN itself unless it is a text.
        """
        cells = _plain(self._cells)
        kind = cells.type
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
        out: Array = np.array(values, dtype=np.float64)
        return out if np.count_nonzero(~np.isfinite(out)) == cells.null_count else None


def _plain(cells: Any) -> Any:
    """Cells that are kept by their distinct values, written out."""
    return cells.dictionary_decode() if pa.types.is_dictionary(cells.type) else cells
