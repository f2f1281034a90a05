"""Texts of measured rows: how they are encoded, what stands between columns, and which decimal mark they use.

Nothing is guessed: a text that could be read in two ways is refused with what was found. Large plain texts are read
a block at a time (``plain_text``).
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from truepose.errors import InputError
from truepose.identification.recording.decimals import with_decimal_points
from truepose.identification.recording.plain_text import SEPARATORS, read_plain_csv

SI: Final = "SI"
"""Unit of a column in the SI unit of whatever is in it, as ROS logs: metres for lengths, radians for angles."""
SPACES: Final = " "
_NAMES: Final = {",": "a comma", ";": "a semicolon", "\t": "a tab", SPACES: "spaces"}
_SAMPLE = 50
"""Rows that tell what stands between columns."""
_WORD: Final = re.compile(r"\S+(?:\s+(?:\[[^\]]*\]|\([^)]*\)))?")
_SEPARATOR_LINE: Final = re.compile(r"sep=(.)\s*", re.IGNORECASE)
_BINARY: Final = re.compile(r"[\x00-\x08\x0e-\x1f]")
_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


@dataclass(frozen=True)
class TextTable:
    """Headers and cells column by column, as they stand.

    ``line`` gives the line of the file of a 0-based row, None where there are no lines.
    """

    headers: Sequence[str]
    columns: Sequence[Sequence[object]]
    line: Callable[[int], int] | None = None
    notes: tuple[str, ...] = ()


def read_large_text(path: Path) -> TextTable | None:
    """A plain text of many rows, never whole in memory; None where it is not plain."""
    with path.open("rb") as stream:
        plain = read_plain_csv(stream)
    if plain is None:
        return None
    return TextTable(*plain, line=lambda row: _line_of_row(path.read_bytes(), row))


def read_text(data: bytes, where: str) -> TextTable:
    """A text's header and rows; ``where`` opens messages.

    Raises InputError for a text that cannot be decoded or could be read in two ways, for a missing header and a row of
    the wrong length, csv.Error for quotes that do not close.
    """
    text, notes = decoded(data, where)
    kept = _Kept(text)
    first = next(kept, "")
    told = _SEPARATOR_LINE.fullmatch(first)  # a spreadsheet's own first line
    first, separator = (next(kept, ""), told[1]) if told else (first, "")
    if not first:
        raise InputError(f"{where}: found no header, expected a line with the names of the columns")
    separator = separator or _separator(text, first, where)
    headers = (
        _cells(first, separator) if separator == SPACES else next(csv.reader([first], delimiter=separator))
    )
    rows, lines = _rows(kept, separator)
    _check_lengths(where, headers, rows, lines, separator)
    columns: Sequence[Sequence[object]] = [[row[k] for row in rows] for k in range(len(headers))]
    if separator != "," or '"' in text:  # only quoted cells hold a comma that commas stand around
        columns = with_decimal_points(columns, headers, separator, where, lines.__getitem__)
    return TextTable(headers, columns, lines.__getitem__, notes)


def decoded(data: bytes, where: str) -> tuple[str, tuple[str, ...]]:
    """The text, with a note where it is no Unicode. Raises InputError for what is no text, or may be several."""
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), None)
    if encoding is None and data[:2].count(0) == 1 and not len(data) % 2:
        encoding = "utf-16-le" if data[1:2] == b"\0" else "utf-16-be"
    notes: tuple[str, ...] = ()
    try:
        text = data.decode(encoding or "utf-8")
    except UnicodeDecodeError:
        if encoding is not None or re.search(rb"[\x80-\x9f]", data):
            raise InputError(
                f"{where}: cannot read the file: neither text in UTF-8, UTF-16 or Latin-1, nor Parquet, Excel or a bag"
            ) from None
        text, notes = data.decode("latin-1"), (f"{where}: read as Latin-1: it is no text in UTF-8",)
    found = _BINARY.search(text)
    if found:
        raise InputError(
            f"{where}: cannot read the file: found the control character {found[0]!r}, expected text"
        )
    return text, notes


class _Kept(Iterator[str]):
    """Lines that are neither empty nor comments; ``number`` counts all lines up to the last one given."""

    def __init__(self, text: str) -> None:
        self.number = 0
        self._lines = (
            (k, line) for k, line in enumerate(io.StringIO(text, newline=""), start=1) if counts(line)
        )

    def __next__(self) -> str:
        self.number, line = next(self._lines)
        return line


def counts(line: str) -> bool:
    """Whether a line is neither empty nor a comment."""
    start = line.lstrip()
    return bool(start) and not start.startswith("#")


def _line_of_row(data: bytes, row: int) -> int:
    kept = _Kept(data.decode("utf-8-sig"))
    for _ in range(row + 2):  # the header is no row
        next(kept)
    return kept.number


def _cells(line: str, separator: str) -> list[str]:
    if separator == SPACES:
        return _WORD.findall(line)
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        return []


def _separator(text: str, header: str, where: str) -> str:
    """What stands between columns: what splits the header, and rows into as many cells."""
    known = [s for s in SEPARATORS if len(_cells(header, s)) > 1]
    if len(known) == 1:
        return known[0]
    rows = _Kept(text)
    sample = [line for line, _ in zip(rows, range(_SAMPLE), strict=False) if line != header]
    if not known:
        count = len(_cells(header, SPACES))
        spaced = count > 1 and all(len(line.split()) == count for line in sample[:1])
        return SPACES if spaced else ","
    fitting = [s for s in known if all(len(_cells(line, s)) == len(_cells(header, s)) for line in sample)]
    if len(fitting) == 1:
        return fitting[0]
    found = " and ".join(_NAMES[s] for s in fitting or known)
    raise InputError(f"{where}: found {found} in the header, expected one and the same between all columns")


def _rows(kept: _Kept, separator: str) -> tuple[list[list[str]], list[int]]:
    """Cells of all further rows, and the lines that they end on."""
    lines: list[int] = []
    if separator == SPACES:
        rows = []
        for line in kept:
            rows.append(line.split())
            lines.append(kept.number)
        return rows, lines
    rows = []
    for row in csv.reader(kept, delimiter=separator, strict=True):
        rows.append(row)
        lines.append(kept.number)
    return rows, lines


def _check_lengths(
    where: str, headers: Sequence[str], rows: Sequence[Sequence[str]], lines: Sequence[int], separator: str
) -> None:
    for number, row in enumerate(rows):
        if len(row) != len(headers):
            twice = separator == "," and len(row) == 2 * len(headers)
            hint = "; decimal commas need a semicolon or a tab between columns" if twice else ""
            raise InputError(
                f"{where}: row {number + 1} (line {lines[number]}): found {len(row)} cells, "
                f"expected {len(headers)}{hint}"
            )


__all__ = ["SI", "SPACES", "TextTable", "counts", "decoded", "read_large_text", "read_text"]
