"""Large plain texts, a block of rows at a time: numbers are kept as such, texts that repeat by their distinct values.

Plain are numbers, texts and separators only. Quotes, comments between rows, decimal commas and rows of the wrong length are
left to ``text.read_text``, which also says what is wrong.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from typing import Any, BinaryIO

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv as pacsv  # type: ignore[import-untyped]

from truepose.identification.recording.arrow_columns import ArrowCells, StackedCells

BLOCK = 1 << 24
"""Bytes that are read at a time."""
REPEATED = 256
"""Distinct texts of a column of a block up to which they stand as they were written: labels, and numbers of poses."""
SEPARATORS = ("\t", ";", ",")
"""What may stand between columns, beside spaces."""
_NOT_PLAIN = (b'"', b"#", b"\0")
_UTF8 = b"\xef\xbb\xbf"


def read_plain_csv(stream: BinaryIO) -> tuple[list[str], list[StackedCells]] | None:
    """Headers and columns; None for a file with anything else than plain cells."""
    line = next((own for own in _lines(stream) if own and not own.startswith(b"#")), b"")
    try:
        header = line.decode("utf-8")
    except UnicodeDecodeError:
        return None
    known = [separator for separator in SEPARATORS if separator in header]
    if len(known) != 1:  # one column, or a header that alone does not tell
        return None
    try:
        names = next(csv.reader([header], delimiter=known[0], strict=True))
    except csv.Error:
        return None
    parts: list[list[ArrowCells]] = [[] for _ in names]
    marks = _NOT_PLAIN if known[0] == "," else (*_NOT_PLAIN, b",")
    for block in _blocks(stream):
        if any(mark in block for mark in marks):
            return None
        try:
            columns = _columns(block, len(names), known[0])
        except pa.ArrowException:
            return None
        for own, column in zip(parts, columns, strict=True):
            own.append(_kept(column))
    return (names, [StackedCells(own) for own in parts]) if parts[0] else None


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    """Lines up to the header, which are whole: comments and empty ones before it."""
    for k, line in enumerate(stream):
        if not line.endswith(b"\n"):
            return
        yield (line.removeprefix(_UTF8) if k == 0 else line).strip()


def _blocks(stream: BinaryIO) -> Iterator[bytes]:
    """What follows, cut behind ends of lines."""
    rest = b""
    while data := stream.read(BLOCK):
        end = data.rfind(b"\n") + 1
        if end:
            yield rest + data[:end]
            rest = b""
        rest += data[end:]
    if rest.strip():
        yield rest


def _columns(block: bytes, count: int, separator: str) -> list[Any]:
    """Arrays of texts; none where there is no row."""
    if not block.strip():
        return [pa.array([], pa.string())] * count
    keys = [str(k) for k in range(count)]
    read = pacsv.read_csv(
        pa.BufferReader(pa.py_buffer(block)),
        read_options=pacsv.ReadOptions(column_names=keys),
        parse_options=pacsv.ParseOptions(delimiter=separator, quote_char=False),
        convert_options=pacsv.ConvertOptions(
            column_types=dict.fromkeys(keys, pa.string()), strings_can_be_null=False
        ),
    )
    return [column.combine_chunks() for column in read.columns]


def _kept(column: Any) -> ArrowCells:
    """A column of texts (n,): as numbers where it has many, all of them plain."""
    told = column.dictionary_encode()
    if len(told.dictionary) <= REPEATED:
        return ArrowCells(told)
    numbers = ArrowCells(column).numbers()
    return ArrowCells(column if numbers is None else numbers)


__all__ = ["SEPARATORS", "read_plain_csv"]
