"""Point lists of trackers and metrology software as tables: Leica, SpatialAnalyzer, FARO, and what looks like them.

Each line names a point and gives x y z; what follows (scatter, time stamps) is left out. Formats differ in how comments
begin, in how many words name a point (``Collection::Group::Target`` is one) and in the unit when nobody states it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from truepose.errors import InputError
from truepose.identification.leaves.readers.headings import (
    XYZ,
    asked_columns,
    asked_numbers,
    names_columns,
)
from truepose.identification.leaves.readers.point_header import (
    Header,
    are_units,
    columns_of_line,
    header_of,
    numbered_header,
)
from truepose.identification.recording.table import Column, Table
from truepose.models.file.limits import LARGEST
from truepose.models.units import parse_unit
from truepose.wording import cut


@dataclass(frozen=True)
class Dialect:
    """comments: what lines begin with that say nothing but, perhaps, a unit; signs: what tells the format from others."""

    comments: tuple[str, ...]
    signs: re.Pattern[str]
    unit: str = "mm"


DIALECTS: Final[Mapping[str, Dialect]] = {
    "spatialanalyzer": Dialect(("//", "#"), re.compile(r"^\s*//|SpatialAnalyzer|\S::\S", re.MULTILINE)),
    "leica": Dialect(
        ("!", "%", "#", "*"), re.compile(r"leica|axyz|tracker\s*pilot|t-scan|t-probe|emscon", re.IGNORECASE)
    ),
    "faro": Dialect(
        ("!", "#", "//", "*"), re.compile(r"\bfaro\b|\bcam2\b|\bX[ \t]*[=:]?[ \t]*[-+]?\d", re.IGNORECASE)
    ),
}
ANY: Final = Dialect(("!", "%", "#", "//", "*"), re.compile(""))
_NUMBER: Final = re.compile(r"[-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eEdD][-+]?\d++)?")
_WHOLE: Final = re.compile(r"\d+")
_LABEL: Final = re.compile(r"(?<![^\s,;\t])[XYZ]\s*[=:]?\s*(?=[-+]?[\d.])")
_UNIT: Final = re.compile(r"units?\b[^A-Za-z]*(?:length\b[^A-Za-z]*|are\s+|in\s+)?([A-Za-z]+)", re.IGNORECASE)


def dialect_of(text: str) -> Dialect:
    """The format by its signs; what all have in common where there are none."""
    return next((found for found in DIALECTS.values() if found.signs.search(text)), ANY)


def read_points(
    text: str,
    file: str,
    dialect: Dialect,
    unit: str | None = None,
    chosen: Mapping[str, str] | None = None,
) -> Table:
    """Columns ``name``, x, y and z of every point. ``unit`` of the lengths, None: as the file says; ``chosen``: what x, y and z
    are called, or their numbers.

    Raises InputError naming file and line for a line that is no point, for a heading that does not say which columns are x, y
    and z, and for a unit that is no length.
    """
    header, above, said = None, _Above(()), None
    points: list[_Point] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        comment = line.lstrip().startswith(dialect.comments)
        found = _UNIT.search(line)
        if found and not points and _length(found[1]):
            said = _length(found[1])
            continue
        words = _words(line.lstrip("/!%#* ") if comment else line)
        if points and comment:
            continue
        if comment or (not points and not _numeric(words)):
            columns = columns_of_line(words)
            if header is not None and are_units(words):
                header = header.with_units(words)
            elif not are_units(words):
                header = header_of(columns, chosen or {}) or header
                above = _Above(tuple(columns), number, comment)
            continue
        where = f"{file}: line {number}"
        if not points and header is None:
            header = numbered_header(words, chosen or {})
            _check_heading(above, words, header, dialect, file, where)
        points.append(_point(words, header, where, number))
    if not points:
        raise InputError(f"{file}: found no point, expected lines with a name and x y z")
    return _table(file, points, header, unit, said, dialect)


@dataclass(frozen=True)
class _Above:
    """The last line above the points that holds no unit alone."""

    columns: tuple[Column, ...]
    number: int = 0
    is_comment: bool = False


@dataclass(frozen=True)
class _Point:
    name: str
    xyz: Sequence[float]
    others: Mapping[int, float]
    line: int


def _check_heading(
    above: _Above, words: Sequence[str], header: Header | None, dialect: Dialect, file: str, where: str
) -> None:
    """Refuse the first row of points, where a heading names other columns, or nothing says which numbers are x, y and z."""
    names = [column.name for column in above.columns]
    if header is not None:
        return
    if names_columns(above.columns, len(words), is_comment=above.is_comment):
        raise asked_columns(names, f"{file}: line {above.number}")
    first = _first_number(words)
    others = any(_NUMBER.fullmatch(word) for word in words[first + 3 :])
    named = first == 0 or _WHOLE.fullmatch(words[0]) or not _NUMBER.fullmatch(words[0])
    if dialect is ANY and (others or not named):
        raise asked_numbers(len(words), where)


def _table(
    file: str,
    points: Sequence[_Point],
    header: Header | None,
    unit: str | None,
    said: str | None,
    dialect: Dialect,
) -> Table:
    notes = []
    units = [unit or own or said for own in (header.units() if header else [None] * 3)]
    if None in units:
        notes.append(
            f"{file}: states no unit: its lengths are taken as {dialect.unit} (--unit says otherwise)"
        )
    turns = header.turns(points[0].others) if header else ()
    if turns:
        notes.append(f"{file}: {', '.join(turns)} left out: the file does not say which rotation they mean")
    lengths = [
        parse_unit(own or dialect.unit, "length", f"{file}: column {axis!r}: unit")
        for axis, own in zip(XYZ, units, strict=True)
    ]
    cells: dict[str, Sequence[object]] = {}
    columns: list[Column] = []
    if not points[0].others or any(point.name for point in points):
        columns, cells = [Column("name")], {"name": [point.name for point in points]}
    for k, column in enumerate(header.columns if header else ()):
        if k in points[0].others:
            columns.append(column)
            cells[column.name] = [point.others.get(k) for point in points]
    cells |= {axis: [point.xyz[k] for point in points] for k, axis in enumerate(XYZ)}
    columns += [Column(axis, length) for axis, length in zip(XYZ, lengths, strict=True)]
    lines = [point.line for point in points]
    return Table(file, tuple(columns), cells, len(points), lines.__getitem__, tuple(notes))


def _words(line: str) -> list[str]:
    """Words of a line, apart by semicolons, tabs, commas, or spaces; labels of numbers (``X=1.0``) are left out."""
    if len(_LABEL.findall(line)) == len(XYZ):  # else a point is called X
        line = _LABEL.sub(" ", line)
    for separator in (";", "\t", ","):
        if separator in line:
            parts = line.split(separator)
            decimals = separator == ";"
            return [part.strip().strip('"').replace(",", "." if decimals else ",") for part in parts]
    return re.findall(r'(?<=")[^"]*(?=")|[^\s"]+', line)


def _length(word: str) -> str | None:
    """The unit of length that a word means."""
    return _LENGTHS.get(word.casefold())


_LENGTHS: Final[Mapping[str, str]] = {
    **{unit: unit for unit in ("mm", "cm", "m", "um", "ft")},
    **dict.fromkeys(("in", "inch", "inches"), "inch"),
    **dict.fromkeys(("foot", "feet"), "ft"),
    **{
        f"{scale}met{end}": unit
        for scale, unit in (("", "m"), ("milli", "mm"), ("centi", "cm"), ("micro", "um"))
        for end in ("er", "ers", "re", "res")
    },
}


def _numeric(words: Sequence[str]) -> bool:
    """Whether a line may be a point: three numbers in it."""
    return sum(bool(_NUMBER.fullmatch(word)) for word in words) >= 3


def _point(words: Sequence[str], header: Header | None, where: str, line: int) -> _Point:
    found = [axes for axes in _places(words, header) if _are_numbers(words, axes)]
    if len(found) != 1:
        expected = "a name and x y z" if header is None else f"{len(header.columns)} cells as in its heading"
        raise InputError(
            f"{where}: found {cut(' '.join(words))!r}, expected {expected if found else 'a name and x y z'}"
        )
    axes = found[0]
    xyz = [_float(words[k]) for k in axes]
    if not max(map(abs, xyz)) <= LARGEST:
        shown = cut(" ".join(words[k] for k in axes))
        raise InputError(f"{where}: found {shown!r}, expected x y z of at most {LARGEST:g}")
    before = range(min(axes))
    others = {
        k: _float(words[k])
        for k in before
        if header is not None
        and len(words) == len(header.columns)
        and not header.names_point(k)
        and _NUMBER.fullmatch(words[k])
    }
    return _Point("::".join(words[k] for k in before if k not in others), xyz, others, line)


def _places(words: Sequence[str], header: Header | None) -> list[tuple[int, ...]]:
    """Where x, y and z may stand in a row: names of more words than their headings move them, dates behind them do not."""
    if header is None:
        first = _first_number(words)
        return [(first, first + 1, first + 2)]
    more = max(0, len(words) - len(header.columns))
    return [tuple(k + moved for k in header.axes) for moved in dict.fromkeys((0, more))]


def _are_numbers(words: Sequence[str], at: Sequence[int]) -> bool:
    return all(k < len(words) and _NUMBER.fullmatch(words[k]) for k in at)


def _float(word: str) -> float:
    return float(word.replace("D", "e").replace("d", "e"))


def _first_number(words: Sequence[str]) -> int:
    """Where x stands: behind the name, whose last word may be a number, too."""
    first = 1
    while first < len(words) and not _NUMBER.fullmatch(words[first]):
        first += 1
    beyond = words[first + 1 : first + 4]
    counted = first < len(words) and _WHOLE.fullmatch(words[first])
    if counted and len(beyond) == 3 and all("." in word and _NUMBER.fullmatch(word) for word in beyond):
        first += 1
    elif first == 1 and len(words) == 3:  # no name at all
        first = 0
    return first
