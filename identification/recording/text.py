"""Texts of measured rows: what stands between columns, and the columns themselves.

Nothing is guessed: a text that could be read in two ways is refused with what was found.

Where rows come from: the digest of a file, and what its comments say: the day of recording, and that rows are shuffled.

Columns of a large file as pyarrow holds them: numbers are read column by column, single cells only when asked for.

What is no plain number is left to ``Table.numbers``, which also says what is wrong with it.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import datetime
import hashlib
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]
import pyarrow.csv as pacsv  # type: ignore[import-untyped]

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.files import read_input
from truepose.identification.recording.languages import refuse_languages


class ArrowCells(Sequence[object]):
    """Cells (n,) of a pyarrow array, or of numbers (n,)."""

    def __init__(self, cells: Any) -> None:
        self._cells = pa.array(cells) if isinstance(cells, np.ndarray) else cells

    def __len__(self) -> int:
        return len(self._cells)

    def __getitem__(self, place: Any) -> Any:
        return self._list[place]

    def __iter__(self) -> Iterator[object]:
        return (cell.as_py() for cell in self._cells)

    @cached_property
    def _list(self) -> list[object]:
        out: list[object] = self._cells.to_pylist()
        return out

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


SPACES: Final = " "
"""Separator of columns that any white space stands between."""
SI: Final = "SI"
"""Unit of a column in the SI unit of whatever is in it, as ROS logs: metres for lengths, radians for angles."""
_NAMES: Final = {"\t": "a tab", ";": "a semicolon", ",": "a comma"}
"""What may stand between columns, beside spaces."""
_SAMPLE = 50
"""Lines that tell what stands between columns, the header among them."""
_WORD: Final = re.compile(r"\S+(?:\s+(?:\[[^\]]{0,80}\]|\([^)]{0,80}\)))?")
"""A name and its unit; texts of many opening brackets would be searched to the end from each."""
_SEPARATOR_LINE: Final = re.compile(r'sep=([^\r\n"])\s*', re.IGNORECASE)
_PATTERNS: Final = {
    ",": r"^\s*[-+]?(\d+,\d*|,\d+)([eE][-+]?\d+)?\s*$",
    ".": r"^\s*[-+]?(\d+\.\d*|\.\d+)([eE][-+]?\d+)?\s*$",
}
_GROUPED: Final = r"^\s*[-+]?[1-9]\d{0,2},\d{3}\s*$"
_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""What an encoded text may begin with."""
_CONTROL: Final = re.compile(r"[\x00-\x08\x0e-\x1f]")
_UNCLEAR: Final = re.compile(rb"[\x80-\x9f]")
"""Letters in Windows-1252, nothing in Latin-1."""


@dataclass(frozen=True)
class TextTable:
    """Headers and cells column by column, as they stand.

    ``line`` gives the line of the file of a 0-based row, None where there are no lines. date: the day that comments name;
    shuffled: they say so of the rows.
    """

    headers: Sequence[str]
    columns: Sequence[Sequence[object]]
    line: Callable[[int], int] | None = None
    notes: tuple[str, ...] = ()
    date: str = ""
    shuffled: bool = False


def read_text(path: Path) -> TextTable:
    """Read a text's header and rows; empty lines and comments are left out.

    Raises InputError for a text that cannot be decoded or could be read in two ways, for a missing header and a row of
    the wrong length, csv.Error for quotes that do not close.
    """
    where = str(path)
    text, notes = decoded(read_input(path), where)
    numbers, lines = list[int](), list[str]()
    for number, line in enumerate(io.StringIO(text, newline=""), start=1):
        start = line.lstrip()
        if start and not start.startswith("#"):
            numbers.append(number)
            lines.append(line)
    refuse_languages("".join(lines[:_SAMPLE]), where)
    stated = _SEPARATOR_LINE.fullmatch(lines[0]) if lines else None  # a spreadsheet's own first line
    above = 2 if stated else 1
    if len(lines) < above:
        raise InputError(f"{where}: found no header, expected a line with the names of the columns")
    header = lines[above - 1]
    sample = [line for line in lines[above - 1 : _SAMPLE] if line != header]
    separator = stated[1] if stated else _separator(header, sample, where)
    names = _WORD.findall(header) if separator == SPACES else next(csv.reader([header], delimiter=separator))
    columns, ends = _columns(where, lines[above:], numbers[above:], len(names), separator)

    def line_of(row: int) -> int:
        return numbers[above + ends[row] - 1]

    columns = _with_points(names, columns, separator, where, line_of)
    cells = [ArrowCells(column) for column in columns]
    return TextTable(names, cells, line_of, notes, recorded_on(text), says_shuffled(text))


def _columns(
    where: str, lines: Sequence[str], numbers: Sequence[int], count: int, separator: str
) -> tuple[list[Any], Sequence[int]]:
    """Return an array of texts for each of ``count`` columns, and how many lines there are up to each row's end."""
    text = "".join(lines)
    if lines and separator.isascii() and separator != SPACES and '"' not in text:
        with contextlib.suppress(pa.ArrowException):  # Python says below what is wrong
            return _plain_columns(text.encode(), count, separator), range(1, len(lines) + 1)
    if separator == SPACES:
        words = (" ".join(line.split()) for line in lines)
        reader = csv.reader(words, delimiter=" ", quoting=csv.QUOTE_NONE)
    else:
        reader = csv.reader(lines, delimiter=separator, strict=True)
    cells, ends = list[str](), list[int]()
    for row in reader:
        ends.append(reader.line_num)
        if len(row) != count:
            at = f"row {len(ends)} (line {numbers[reader.line_num - 1]})"
            twice = separator == "," and len(row) == 2 * count
            hint = "; decimal commas need a semicolon or a tab between columns" if twice else ""
            raise InputError(f"{where}: {at}: found {len(row)} cells, expected {count}{hint}")
        cells += row
    return [pa.array(cells[k::count], pa.string()) for k in range(count)], ends


def _plain_columns(data: bytes, count: int, separator: str) -> list[Any]:
    """Return the columns of a text without quotes. Raises pa.ArrowException for rows of another length."""
    keys = [str(k) for k in range(count)]
    read = pacsv.read_csv(
        pa.BufferReader(data),
        read_options=pacsv.ReadOptions(column_names=keys),
        parse_options=pacsv.ParseOptions(delimiter=separator, quote_char=False),
        convert_options=pacsv.ConvertOptions(
            column_types=dict.fromkeys(keys, pa.string()), strings_can_be_null=False
        ),
    )
    return [column.combine_chunks() for column in read.columns]


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


def _with_points(
    names: Sequence[str], columns: Sequence[Any], separator: str, where: str, line: Callable[[int], int]
) -> list[Any]:
    """Return arrays of texts with points for decimal commas.

    Raises InputError where commas and points are both decimal marks, or where commas may group thousands. ``line`` gives the
    file's line of a 0-based row; ``where`` opens messages.
    """
    comma = _first(columns, ",")
    if comma is None:
        return list(columns)
    point = _first(columns, ".")

    def found(at: tuple[int, int]) -> str:
        column, row = at
        cell = columns[column][row].as_py().strip()
        return f"{cell!r} in row {row + 1} (line {line(row)}), column {names[column].strip()!r}"

    if point is not None:
        raise InputError(
            f"{where}: found {found(comma)} and {found(point)}, expected one decimal mark throughout"
        )
    numbers = [pc.match_substring_regex(cells, _PATTERNS[","]) for cells in columns]
    grouped = [pc.match_substring_regex(cells, _GROUPED) for cells in columns]
    if separator != ";" and not any(
        pc.any(pc.and_not(*pair)).as_py() for pair in zip(numbers, grouped, strict=True)
    ):
        raise InputError(
            f"{where}: found {found(comma)}: the comma may mark decimals or thousands; write a point, or a semicolon "
            "between columns"
        )
    return [
        pc.if_else(number, pc.replace_substring(cells, ",", "."), cells)
        for number, cells in zip(numbers, columns, strict=True)
    ]


def _first(columns: Sequence[Any], mark: str) -> tuple[int, int] | None:
    """Return column and row of the first number with a decimal mark; None where there is none."""
    for column, cells in enumerate(columns):
        if pc.any(pc.match_substring(cells, mark)).as_py():
            row = int(pc.index(pc.match_substring_regex(cells, _PATTERNS[mark]), True).as_py())
            if row >= 0:
                return column, row
    return None


def decoded(data: bytes, where: str) -> tuple[str, tuple[str, ...]]:
    """Return the text, and a note where it is no Unicode. Raises InputError for what is no text, or may be several."""
    encoding, notes = _stated(data), tuple[str, ...]()
    try:
        text = data.decode(encoding or "utf-8")
    except UnicodeDecodeError:
        if encoding is not None or _UNCLEAR.search(data):
            raise InputError(
                f"{where}: cannot read the file: neither text in UTF-8, UTF-16 or Latin-1, nor Parquet, Excel or a bag"
            ) from None
        text, notes = data.decode("latin-1"), (f"{where}: read as Latin-1: it is no text in UTF-8",)
    control = _CONTROL.search(text)
    if control:
        raise InputError(
            f"{where}: cannot read the file: found the control character {control[0]!r}, expected text"
        )
    return text, notes


def _stated(data: bytes) -> str | None:
    """Return the encoding that the first bytes and the size tell; None where they do not."""
    marked = next((name for mark, name in _MARKS if data.startswith(mark)), None)
    if marked is None and data[:2].count(0) == 1 and not len(data) % 2:
        return "utf-16-le" if data[1] == 0 else "utf-16-be"
    return marked


_COMMENTS = ("#", "!", "%", "*", "//")
_DATE = re.compile(r"(?<!\d)((?:19|20)\d\d-\d\d-\d\d)(?!\d)")
_SHUFFLED = re.compile(r"\border\s*[:=]\s*shuffled\b", re.IGNORECASE)
_FIELD = re.compile(r"[\s,;]+")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LINES, _LETTERS = 40, 1 << 16
"""Lines and characters at the head of a file in which comments are looked for."""


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal; empty for what is no file."""
    if not path.is_file():
        return ""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def recorded_on(text: str) -> str:
    """Return the first date (2026-03-14) in the comments above a text's data; empty where there is none.

    A file's own time stamp says when it was copied, not when it was recorded.
    """
    dates = (found for line in _comments(text) for found in _DATE.findall(line) if _is_day(found))
    return str(next(dates, ""))


def says_shuffled(text: str) -> bool:
    """Return True if a comment above a text's data says ``order: shuffled``: rows are no visits one after the other."""
    return any(_SHUFFLED.search(line) for line in _comments(text))


def _comments(text: str) -> list[str]:
    """Return the comments above a text's data."""
    lines = text[:_LETTERS].splitlines()[:_LINES]
    above = takewhile(lambda line: _is_comment(line) or not _is_data(line), lines)
    return [line for line in above if _is_comment(line)]


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _is_day(text: str) -> bool:
    try:
        datetime.date.fromisoformat(text)
    except ValueError:
        return False
    return True


def _is_data(line: str) -> bool:
    """Return True if a line has two numbers and more: a heading has none."""
    return sum(_NUMBER.fullmatch(field) is not None for field in _FIELD.split(line)) >= 2
