"""Texts of measured rows: what stands between columns, and the columns themselves, never whole in memory.

Nothing is guessed: a text that could be read in two ways is refused with what was found.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Final

import pyarrow.compute as pc  # type: ignore[import-untyped]

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.recording.arrow_columns import ArrowCells, TextCells
from truepose.identification.recording.decimals import DecimalMarks, with_points
from truepose.identification.recording.encoding import encoding_of
from truepose.identification.recording.languages import refuse_languages
from truepose.identification.recording.plain_text import SPACES, counts
from truepose.identification.recording.size import check_line, check_size
from truepose.identification.recording.text_rows import TextRows, open_text
from truepose.models.file.limits import LINE

SI: Final = "SI"
"""Unit of a column in the SI unit of whatever is in it, as ROS logs: metres for lengths, radians for angles."""
_NAMES: Final = {"\t": "a tab", ";": "a semicolon", ",": "a comma"}
"""What may stand between columns, beside spaces."""
_SAMPLE = 50
"""Lines that tell what stands between columns, the header among them."""
_REPEATED = 256
"""Distinct texts of a column of a block up to which they are kept: labels, and numbers of poses."""
_PROBED = 1024
"""Cells that tell most columns with more distinct texts."""
_WORD: Final = re.compile(r"\S+(?:\s+(?:\[[^\]]{0,80}\]|\([^)]{0,80}\)))?")
"""A name and its unit; texts of many opening brackets would be searched to the end from each."""
_SEPARATOR_LINE: Final = re.compile(r'sep=([^\r\n"])\s*', re.IGNORECASE)


@dataclass(frozen=True)
class TextTable:
    """Headers and cells column by column, as they stand.

    ``line`` gives the line of the file of a 0-based row, None where there are no lines.
    """

    headers: Sequence[str]
    columns: Sequence[Sequence[object]]
    line: Callable[[int], int] | None = None
    notes: tuple[str, ...] = ()


def read_text(path: Path) -> TextTable:
    """A text's header and rows, read a block at a time: numbers and labels are kept, other cells read again when asked for.

    Raises InputError for a text that cannot be decoded or could be read in two ways, for a missing header and a row of
    the wrong length, csv.Error for quotes that do not close.
    """
    with path.open("rb") as stream:
        encoding, notes = encoding_of(stream, str(path))
    rows, marks = _rows_of(path, encoding), DecimalMarks()
    kept: list[list[ArrowCells | Array | None]] = [[] for _ in rows.headers]
    count = 0
    for columns in rows.blocks():
        marks.add(columns)
        count += len(columns[0])
        check_size(str(path), len(columns), count)
        for own, cells in zip(kept, columns, strict=True):
            own.append(_kept(with_points(cells)))
    marks.check(rows.headers, rows.separator, str(path), rows.line)
    cells = [TextCells(count, partial(_written, rows, k), own) for k, own in enumerate(kept)]
    return TextTable(rows.headers, cells, rows.line, notes)


def _written(rows: TextRows, column: int) -> Iterator[ArrowCells]:
    """A column's texts, some rows at a time."""
    return (ArrowCells(with_points(columns[column])) for columns in rows.blocks())


def _kept(cells: Any) -> ArrowCells | Array | None:
    """What is kept of some rows of a column of texts: few distinct ones as they stand, else numbers; None for others."""
    if len(pc.unique(cells[:_PROBED])) <= _REPEATED:
        told = cells.dictionary_encode()
        if len(told.dictionary) <= _REPEATED:
            return ArrowCells(told)
    return ArrowCells(cells).numbers(lost=True)


def _rows_of(path: Path, encoding: str) -> TextRows:
    """Where the rows of a file are, and what stands between their cells, as its first lines tell."""
    with open_text(path, encoding) as stream:
        whole = (check_line(str(path), line) for line in iter(partial(stream.readline, LINE + 1), ""))
        lines = list(islice(filter(counts, whole), _SAMPLE))
    refuse_languages("".join(lines), str(path))
    told = _SEPARATOR_LINE.fullmatch(lines[0]) if lines else None  # a spreadsheet's own first line
    header = next(iter(lines[1:] if told else lines), "")
    if not header:
        raise InputError(f"{path}: found no header, expected a line with the names of the columns")
    sample = [line for line in lines if line != header]
    separator = told[1] if told else _separator(header, sample, str(path))
    names = _WORD.findall(header) if separator == SPACES else next(csv.reader([header], delimiter=separator))
    check_size(str(path), len(names), 0)
    return TextRows(path, encoding, separator, tuple(names), above=2 if told else 1)


def _separator(header: str, sample: Sequence[str], where: str) -> str:
    """What stands between columns: what splits the header, and rows into as many cells."""
    known = [s for s in _NAMES if _count(header, s) > 1]
    if len(known) == 1:
        return known[0]
    if not known:
        count = len(_WORD.findall(header))
        spaced = count > 1 and all(len(line.split()) == count for line in sample[:1])
        return SPACES if spaced else ","
    fitting = [s for s in known if all(_count(line, s) == _count(header, s) for line in sample)]
    if len(fitting) == 1:
        return fitting[0]
    found = " and ".join(_NAMES[s] for s in fitting or known)
    raise InputError(f"{where}: found {found} in the header, expected one and the same between all columns")


def _count(line: str, separator: str) -> int:
    """Cells of a line by itself."""
    try:
        return len(next(csv.reader([line], delimiter=separator), []))
    except csv.Error:
        return 0
