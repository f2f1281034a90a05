"""Decimal commas: which cells of a text have them, and the same cells with points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import pyarrow.compute as pc  # type: ignore[import-untyped]

from truepose.errors import InputError

_COMMA: Final = r"^\s*[-+]?(\d+,\d*|,\d+)([eE][-+]?\d+)?\s*$"
_POINT: Final = r"^\s*[-+]?(\d+\.\d*|\.\d+)([eE][-+]?\d+)?\s*$"
_PATTERNS: Final = {",": _COMMA, ".": _POINT}
_GROUPED: Final = r"^\s*[-+]?[1-9]\d{0,2},\d{3}\s*$"


def with_points(cells: Any) -> Any:
    """An array of texts, decimal commas replaced by points."""
    if not _holds(cells, ","):
        return cells
    return pc.if_else(pc.match_substring_regex(cells, _COMMA), pc.replace_substring(cells, ",", "."), cells)


class DecimalMarks:
    """Which decimal marks the columns of a text have, told by some rows after the others: the first cell of each column."""

    def __init__(self) -> None:
        self._rows = 0
        self._first: dict[str, dict[int, tuple[int, str]]] = {mark: {} for mark in _PATTERNS}
        self._decimal: set[int] = set()  # columns with a comma that groups no thousands

    def add(self, columns: Sequence[Any]) -> None:
        """The next rows: arrays of texts as they stand."""
        for k, cells in enumerate(columns):
            for mark, first in self._first.items():
                if k not in first and _holds(cells, mark):
                    at = pc.match_substring_regex(cells, _PATTERNS[mark]).index(True).as_py()
                    if at >= 0:
                        first[k] = self._rows + at, cells[at].as_py().strip()
            if k in self._first[","] and k not in self._decimal and _not_grouped(cells):
                self._decimal.add(k)
        self._rows += len(columns[0])

    def check(self, names: Sequence[str], separator: str, where: str, line: Callable[[int], int]) -> None:
        """Raise InputError where commas and points are both decimal marks, or where commas may group thousands.

        ``line`` gives the file's line of a 0-based row; ``where`` opens messages.
        """
        if not self._first[","]:
            return

        def found(mark: str) -> str:
            column, (row, cell) = min(self._first[mark].items())
            return f"{cell!r} in row {row + 1} (line {line(row)}), column {names[column].strip()!r}"

        if self._first["."]:
            raise InputError(
                f"{where}: found {found(',')} and {found('.')}, expected one decimal mark throughout"
            )
        if separator != ";" and not self._decimal:
            raise InputError(
                f"{where}: found {found(',')}: the comma may mark decimals or thousands; write a point, or a semicolon "
                "between columns"
            )


def _holds(cells: Any, mark: str) -> bool:
    """Whether a cell of an array of texts may hold a mark, told by all their bytes at once."""
    data = cells.buffers()[2]
    return data is not None and mark.encode() in data.to_pybytes()


def _not_grouped(cells: Any) -> bool:
    """Whether there is a number with a comma that does not look like thousands."""
    comma, grouped = (pc.match_substring_regex(cells, pattern) for pattern in (_COMMA, _GROUPED))
    return bool(pc.any(pc.and_not(comma, grouped)).as_py())
