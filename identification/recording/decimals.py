"""Decimal commas: which cells of a text have them, and the same cells with points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]

from truepose.errors import InputError
from truepose.identification.recording.arrow_columns import ArrowCells

_COMMA: Final = r"^\s*[-+]?(\d+,\d*|,\d+)([eE][-+]?\d+)?\s*$"
_POINT: Final = r"^\s*[-+]?(\d+\.\d*|\.\d+)([eE][-+]?\d+)?\s*$"
_GROUPED: Final = r"^\s*[-+]?[1-9]\d{0,2},\d{3}\s*$"


def with_decimal_points(
    columns: Sequence[Sequence[object]],
    names: Sequence[str],
    separator: str,
    where: str,
    line: Callable[[int], int],
) -> Sequence[Sequence[object]]:
    """The columns of texts, decimal commas replaced by points; ``line`` gives the file's line of a 0-based row.

    Raises InputError where commas and points are both decimal marks, or where commas may group thousands.
    """
    arrays = [_array(column) for column in columns]
    commas = [k for k, array in enumerate(arrays) if pc.any(pc.match_substring_regex(array, _COMMA)).as_py()]
    if not commas:
        return columns

    def found(column: int, pattern: str) -> str:
        at = pc.match_substring_regex(arrays[column], pattern).index(True).as_py()
        cell = arrays[column][at].as_py().strip()
        return f"{cell!r} in row {at + 1} (line {line(at)}), column {names[column].strip()!r}"

    comma = found(commas[0], _COMMA)
    for k, array in enumerate(arrays):
        if pc.any(pc.match_substring_regex(array, _POINT)).as_py():
            raise InputError(
                f"{where}: found {comma} and {found(k, _POINT)}, expected one decimal mark throughout"
            )
    if separator != ";" and all(_all_grouped(arrays[k]) for k in commas):
        raise InputError(
            f"{where}: found {comma}: the comma may mark decimals or thousands; write a point, or a semicolon "
            "between columns"
        )
    out = list(columns)
    for k in commas:
        matched = pc.match_substring_regex(arrays[k], _COMMA)
        pointed = pc.if_else(matched, pc.replace_substring(arrays[k], ",", "."), arrays[k])
        out[k] = ArrowCells(pointed) if isinstance(columns[k], ArrowCells) else pointed.to_pylist()
    return out


def _array(column: Sequence[object]) -> Any:
    return column.array if isinstance(column, ArrowCells) else pa.array(column, pa.string())


def _all_grouped(array: Any) -> bool:
    """Whether every number with a comma looks like thousands."""
    matched = array.filter(pc.match_substring_regex(array, _COMMA))
    return bool(pc.all(pc.match_substring_regex(matched, _GROUPED)).as_py())


__all__ = ["with_decimal_points"]
