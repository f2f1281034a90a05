"""Columns of a block of lines by Arrow, where it reads them as Python's csv does: most blocks are such."""

from __future__ import annotations

import csv
import io
from typing import Any, Final

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]
import pyarrow.csv as pacsv  # type: ignore[import-untyped]

SPACES: Final = " "
"""Separator of columns that any white space stands between."""
_MARK: Final = "\ufeff"


def counts(line: str) -> bool:
    """Whether a line is neither empty nor a comment."""
    start = line.lstrip()
    return bool(start) and not start.startswith("#")


def plain_columns(block: str, count: int, separator: str) -> list[Any] | None:
    """Arrays of texts, one for each of ``count`` columns; None where Python has to read the rows, or say what is wrong.

    ``block``: whole lines. Not plain are line ends in quotes, quotes amid a cell, and rows of another length.
    """
    if "#" in block or separator.isspace() or count == 1:  # else no line of blanks passes for a row
        lines = filter(counts, io.StringIO(block, newline=""))
        block = "\n".join(map(_tabbed, lines)) if separator == SPACES else "".join(lines)
    quoted = separator != SPACES and '"' in block
    data, delimiter = block.encode(), "\t" if separator == SPACES else separator
    if not delimiter.isascii() or block.startswith(_MARK) or (quoted and not _enclosed(data, delimiter)):
        return None
    try:
        columns = _columns(data, count, delimiter, quoted)
    except pa.ArrowException:
        return None
    longest = max(pc.max(pc.binary_length(column)).as_py() or 0 for column in columns)
    return columns if longest <= csv.field_size_limit() else None


def _tabbed(line: str) -> str:
    """A line of words, tabs between them."""
    return "\t".join(line.split())


def _columns(data: bytes, count: int, delimiter: str, quoted: bool) -> list[Any]:
    keys = [str(k) for k in range(count)]
    read = pacsv.read_csv(
        pa.BufferReader(pa.py_buffer(data)),
        read_options=pacsv.ReadOptions(column_names=keys),
        parse_options=pacsv.ParseOptions(delimiter=delimiter, quote_char='"' if quoted else False),
        convert_options=pacsv.ConvertOptions(
            column_types=dict.fromkeys(keys, pa.string()), strings_can_be_null=False
        ),
    )
    return [column.combine_chunks() for column in read.columns]


def _enclosed(data: bytes, delimiter: str) -> bool:
    """Whether all quotes enclose whole cells of one line, or stand twice within: then no reader takes them otherwise."""
    text = np.frombuffer(b"\n" + data + b"\n", np.uint8)
    quotes, ends = np.flatnonzero(text == ord('"')), np.flatnonzero((text == ord("\n")) | (text == ord("\r")))
    opening, closing = quotes[::2], quotes[1::2]
    if len(opening) != len(closing):
        return False
    beside = np.zeros(256, dtype=np.bool_)
    beside[[ord(c) for c in ('"', "\n", "\r", delimiter)]] = True
    within_line = np.searchsorted(ends, opening) == np.searchsorted(ends, closing)
    return bool(np.all(beside[text[opening - 1]] & beside[text[closing + 1]] & within_line))
