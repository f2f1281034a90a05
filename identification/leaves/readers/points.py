"""Point lists of trackers and metrology software as tables: Leica, SpatialAnalyzer, FARO, and what looks like them.

Each line names a point and gives x y z; what follows (scatter, time stamps) is left out. Several words may name a point
(``Collection::Group::Target`` is one). Lines above the points may say what the columns are called, and their units.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from truepose.errors import InputError
from truepose.identification.leaves.readers import headings
from truepose.identification.recording.table import Column, Table
from truepose.models.file.limits import LARGEST
from truepose.models.units import parse_unit
from truepose.wording import cut

PROGRAMS: Final = ("spatialanalyzer", "leica", "faro")
"""Whose point lists are known by their signs."""
_SIGNS: Final = re.compile(
    r"^\s*//|SpatialAnalyzer|\S::\S|leica|axyz|tracker\s*pilot|t-scan|t-probe|emscon|\bfaro\b|\bcam2\b"
    r"|\bX[ \t]*[=:]?[ \t]*[-+]?\d",
    re.IGNORECASE | re.MULTILINE,
)
_COMMENTS: Final = ("!", "%", "#", "//", "*")
_NUMBER: Final = re.compile(r"[-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eEdD][-+]?\d++)?")
_WHOLE: Final = re.compile(r"\d+")
_LABEL: Final = re.compile(r"(?<![^\s,;\t])[XYZ]\s*[=:]?\s*(?=[-+]?[\d.])")
_UNIT: Final = re.compile(r"units?\b[^A-Za-z]*(?:length\b[^A-Za-z]*|are\s+|in\s+)?([A-Za-z]+)", re.IGNORECASE)
_LENGTHS: Final = {
    "mm": "mm", "millim": "mm", "cm": "cm", "centim": "cm", "um": "um", "microm": "um", "m": "m",
    "in": "inch", "inch": "inch", "inches": "inch", "ft": "ft", "foot": "ft", "feet": "ft",
}  # fmt: skip
"""Units by the words that mean them, ``meters`` in short."""
_TURNS: Final = frozenset({"rx", "ry", "rz", "roll", "pitch", "yaw", "q0", "q1", "q2", "q3", "i", "j", "k"})
_NAMES: Final = re.compile(
    r".*(?:name|point|target|punkt|group|collection|station|object).*|(?:id|pt|nr|no|num(?:ber)?)\.?",
    re.IGNORECASE,
)
"""Headings of columns that name a point."""


@dataclass(frozen=True)
class _Header:
    """What the columns are called, their units, and where x, y and z stand among them."""

    columns: tuple[Column, ...]
    axes: tuple[int, ...]


def is_marked(text: str) -> bool:
    """Return True if a text has a sign of one of the ``PROGRAMS``."""
    return _SIGNS.search(text) is not None


def read_points(
    text: str,
    file: str,
    unit: str | None = None,
    chosen: Mapping[str, str] | None = None,
    *,
    marked: bool = True,
) -> Table:
    """Return the columns ``name``, x, y and z of every point, and numbers before them that a heading names.

    ``unit`` of the lengths, None: as the file says; ``chosen``: what x, y and z are called, or their numbers. Unless the list
    is ``marked``, numbers that no heading names must be a name and x y z. Raises InputError naming file and line for a line
    that is no point, for a heading that does not say which columns are x, y and z, and for a unit that is no length.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    first = next((k for k, (_, line) in enumerate(lines) if _is_point(line)), None)
    if first is None:
        raise InputError(f"{file}: found no point, expected lines with a name and x y z")
    rows = [(k, _words(line)) for k, line in lines[first:] if not line.lstrip().startswith(_COMMENTS)]
    header, said, named = None, None, None
    for number, line in lines[:first]:
        if stated := _stated_unit(line):
            said = stated
            continue
        comment = line.lstrip().startswith(_COMMENTS)
        words = _words(line.lstrip("/!%#* ") if comment else line)
        units = [word.strip("[]()") for word in words]
        if any(units) and all(not word or headings.length_or_angle(word) for word in units):
            header = header and _with_units(header, units)
        else:
            columns = _columns(words)
            header = _header(columns, chosen or {}) or header
            named = (f"{file}: line {number}", columns, comment)
    header = header or _numbered_header(rows[0][1], chosen or {})
    if header is None:
        if named and headings.names_columns(named[1], len(rows[0][1]), is_comment=named[2]):
            raise headings.asked_columns([column.name for column in named[1]], named[0])
        if not marked:
            _check_unnamed(rows[0][1], f"{file}: line {rows[0][0]}")
    return _table(file, rows, header, unit, said)


def _is_point(line: str) -> bool:
    """Return True if a line may be a point: three numbers in it, no comment and no unit."""
    numbers = sum(_is_number(word) for word in _words(line))
    return numbers >= len(headings.XYZ) and not line.lstrip().startswith(_COMMENTS) and not _stated_unit(line)


def _is_number(word: str) -> bool:
    return _NUMBER.fullmatch(word) is not None


def _stated_unit(line: str) -> str | None:
    """Return the unit of length that a line states in words, ``Units: Millimeters``."""
    found = _UNIT.search(line)
    return _LENGTHS.get(re.sub("met(er|re)s?$", "m", found[1].casefold())) if found else None


def _words(line: str) -> list[str]:
    """Return the words of a line, apart by semicolons, tabs, commas, or spaces, without labels of numbers (``X=1.0``)."""
    if len(_LABEL.findall(line)) == len(headings.XYZ):  # else a point is called X
        line = _LABEL.sub(" ", line)
    for separator in (";", "\t", ","):
        if separator in line:
            decimals = separator == ";"
            parts = line.split(separator)
            return [part.strip().strip('"').replace(",", "." if decimals else ",") for part in parts]
    return re.findall(r'(?<=")[^"]*(?=")|[^\s"]+', line)


def _columns(words: Sequence[str]) -> list[Column]:
    """Return the columns of a line of headings; a unit in brackets may be a word of its own."""
    joined: list[str] = []
    for word in words:
        if joined and re.fullmatch(r"[\[(].*[\])]", word):
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    return [headings.read_column(word) for word in joined]


def _header(columns: Sequence[Column], chosen: Mapping[str, str]) -> _Header | None:
    """Return what a line of headings says of the columns; None if it does not name x, y and z once each."""
    names = [column.name for column in columns]
    wanted = [chosen.get(axis, axis) for axis in headings.XYZ]
    if any(names.count(name) != 1 for name in wanted):
        return None
    return _Header(tuple(columns), tuple(names.index(name) for name in wanted))


def _numbered_header(words: Sequence[str], chosen: Mapping[str, str]) -> _Header | None:
    """Return the header of a list without one, if its columns are chosen by number."""
    numbers = [chosen.get(axis, "") for axis in headings.XYZ]
    if not all(number.isdecimal() and 1 <= int(number) <= len(words) for number in numbers):
        return None
    columns = tuple(Column(str(k)) for k in range(1, len(words) + 1))
    return _Header(columns, tuple(int(number) - 1 for number in numbers))


def _with_units(header: _Header, words: Sequence[str]) -> _Header:
    """Return the header with the units of a line below it: one for each column, for x, y and z, or the same for all."""
    units = [headings.length_or_angle(word) for word in words]
    at = header.axes if len(units) != len(header.columns) else range(len(header.columns))
    if len(units) < len(at) or len(set(units)) == 1:
        units = [units[0]] * len(at)
    below = dict(zip(at, units, strict=False))
    columns = tuple(replace(c, unit=c.unit or below.get(k)) for k, c in enumerate(header.columns))
    return replace(header, columns=columns)


def _check_unnamed(words: Sequence[str], where: str) -> None:
    """Refuse a first row of numbers of which nothing says which are x, y and z."""
    first = _first_number(words)
    others = any(map(_is_number, words[first + 3 :]))
    named = first == 0 or _WHOLE.fullmatch(words[0]) or not _is_number(words[0])
    if others or not named:
        raise headings.asked_numbers(len(words), where)


def _table(
    file: str,
    rows: Sequence[tuple[int, Sequence[str]]],
    header: _Header | None,
    unit: str | None,
    said: str | None,
) -> Table:
    columns, axes = (header.columns, header.axes) if header else ((), ())
    units = [unit or own or said for own in ([columns[k].unit for k in axes] or [None] * 3)]
    places = [_place(words, header, f"{file}: line {number}") for number, words in rows]
    first, before = rows[0][1], range(min(places[0]))
    kept = [
        k
        for k in before
        if len(first) == len(columns) and _is_number(first[k]) and not _NAMES.fullmatch(columns[k].name)
    ]
    notes = []
    if None in units:
        notes.append(f"{file}: states no unit: its lengths are taken as mm (--unit says otherwise)")
    turns = [
        c.name.casefold() for k, c in enumerate(columns) if k not in kept and c.name.casefold() in _TURNS
    ]
    if turns:
        notes.append(f"{file}: {', '.join(turns)} left out: the file does not say which rotation they mean")
    names = [
        "::".join(words[k] for k in range(min(at)) if k not in kept)
        for (_, words), at in zip(rows, places, strict=True)
    ]
    cells: dict[str, Sequence[object]] = {"name": names} if any(names) or not kept else {}
    known = [Column("name")] if cells else []
    for k in kept:
        known.append(columns[k])
        cells[columns[k].name] = [_float(w[k]) if _is_number(w[k]) else None for _, w in rows]
    for j, (axis, own) in enumerate(zip(headings.XYZ, units, strict=True)):
        known.append(Column(axis, parse_unit(own or "mm", "length", f"{file}: column {axis!r}: unit")))
        cells[axis] = [_float(words[at[j]]) for (_, words), at in zip(rows, places, strict=True)]
    lines = [number for number, _ in rows]
    return Table(file, tuple(known), cells, len(rows), lines.__getitem__, tuple(notes))


def _place(words: Sequence[str], header: _Header | None, where: str) -> tuple[int, ...]:
    """Return where x, y and z stand in a row: names of more words than their headings move them, dates behind do not."""
    if header is None:
        first = _first_number(words)
        places: list[tuple[int, ...]] = [(first, first + 1, first + 2)]
    else:
        more = max(0, len(words) - len(header.columns))
        places = [tuple(k + moved for k in header.axes) for moved in dict.fromkeys((0, more))]
    found = [at for at in places if all(k < len(words) and _is_number(words[k]) for k in at)]
    if len(found) != 1:
        cells = f"{len(header.columns)} cells as in its heading" if found and header else "a name and x y z"
        raise InputError(f"{where}: found {cut(' '.join(words))!r}, expected {cells}")
    if not max(abs(_float(words[k])) for k in found[0]) <= LARGEST:
        shown = cut(" ".join(words[k] for k in found[0]))
        raise InputError(f"{where}: found {shown!r}, expected x y z of at most {LARGEST:g}")
    return found[0]


def _float(word: str) -> float:
    return float(word.replace("D", "e").replace("d", "e"))


def _first_number(words: Sequence[str]) -> int:
    """Return where x stands: behind the name, whose last word may be a number, too."""
    first = 1
    while first < len(words) and not _is_number(words[first]):
        first += 1
    beyond = words[first + 1 : first + 4]
    counted = first < len(words) and _WHOLE.fullmatch(words[first])
    if counted and len(beyond) == 3 and all("." in word and _is_number(word) for word in beyond):
        first += 1
    elif first == 1 and len(words) == 3:  # no name at all
        first = 0
    return first
