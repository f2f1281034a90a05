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
from truepose.identification.recording.table import Column, Table
from truepose.models.limits import LARGEST
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
        ("!", "#", "//", "*"), re.compile(r"\bfaro\b|\bcam2\b|\bX\s*[=:]?\s*[-+]?\d", re.IGNORECASE)
    ),
}
ANY: Final = Dialect(("!", "%", "#", "//", "*"), re.compile(""))
_AXES: Final = ("x", "y", "z")
_NUMBER: Final = re.compile(r"[-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eEdD][-+]?\d++)?")
_WHOLE: Final = re.compile(r"\d+")
_LABEL: Final = re.compile(r"(?<![^\s,;\t])[XYZ]\s*[=:]?\s*(?=[-+]?[\d.])")
_UNIT: Final = re.compile(r"units?\b[^A-Za-z]*(?:length\b[^A-Za-z]*|are\s+|in\s+)?([A-Za-z]+)", re.IGNORECASE)
_IN_HEADER: Final = re.compile(r"[\[(]\s*([A-Za-z]+)\s*[\])]")
_TURNS: Final = frozenset({"rx", "ry", "rz", "roll", "pitch", "yaw", "q0", "q1", "q2", "q3", "i", "j", "k"})


@dataclass(frozen=True)
class _Header:
    """Where the columns of a point list stand: its name (several words) and x y z; the unit, None where not said."""

    name: tuple[int, ...]
    axes: tuple[int, int, int]
    unit: str | None
    turns: tuple[str, ...]


def dialect_of(text: str) -> Dialect:
    """The format by its signs; what all have in common where there are none."""
    return next((found for found in DIALECTS.values() if found.signs.search(text)), ANY)


def read_points(text: str, file: str, dialect: Dialect, unit: str | None = None) -> Table:
    """Columns ``name``, x, y and z of every point. ``unit`` of the lengths; None: as the file says.

    Raises InputError naming file and line for a line that is no point, and for a unit that is no length.
    """
    header: _Header | None = None
    said: str | None = None
    names: list[str] = []
    points: list[list[float]] = []
    lines: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        comment = line.lstrip().startswith(dialect.comments)
        found = _UNIT.search(line)
        if found and not points and _length(found[1]):
            said = _length(found[1])
            continue
        words = _words(line.lstrip("/!%#* ") if comment else line)
        header = _header(words) or header if not points else header
        if comment or (not points and not _numeric(words)):
            continue  # a heading
        name, xyz = _point(words, header, f"{file}: line {number}")
        names.append(name)
        points.append(xyz)
        lines.append(number)
    if not points:
        raise InputError(f"{file}: found no point, expected lines with a name and x y z")
    return _table(file, names, points, lines, header, unit, said, dialect)


def _table(
    file: str,
    names: Sequence[str],
    points: Sequence[Sequence[float]],
    lines: Sequence[int],
    header: _Header | None,
    unit: str | None,
    said: str | None,
    dialect: Dialect,
) -> Table:
    notes = []
    known = unit or (header.unit if header and header.unit else said)
    if known is None:
        notes.append(
            f"{file}: states no unit: its lengths are taken as {dialect.unit} (--unit says otherwise)"
        )
    if header and header.turns:
        notes.append(
            f"{file}: {', '.join(header.turns)} left out: the file does not say which rotation they mean"
        )
    length = parse_unit(known or dialect.unit, "length", f"{file}: unit")
    cells: dict[str, Sequence[object]] = {"name": list(names)}
    cells |= {axis: [point[k] for point in points] for k, axis in enumerate(_AXES)}
    columns = (Column("name"), *(Column(axis, length) for axis in _AXES))
    return Table(file, columns, cells, len(points), lines.__getitem__, tuple(notes))


def _words(line: str) -> list[str]:
    """Words of a line, apart by semicolons, tabs, commas, or spaces; labels of numbers (``X=1.0``) are left out."""
    line = _LABEL.sub(" ", line)
    for separator in (";", "\t", ","):
        if separator in line:
            parts = line.split(separator)
            decimals = separator == ";"
            return [part.strip().strip('"').replace(",", "." if decimals else ",") for part in parts]
    return re.findall(r'(?<=")[^"]*(?=")|[^\s"]+', line)


def _header(words: Sequence[str]) -> _Header | None:
    """What a line of headings says of the columns; None where it is no such line."""
    plain = [_IN_HEADER.sub("", word).strip().casefold() for word in words]
    plain = [word for word in plain if word]
    if not set(_AXES) <= set(plain):
        return None
    at = tuple(plain.index(axis) for axis in _AXES)
    units = {found[1] for word in words for found in [_IN_HEADER.search(word)] if found}
    unit = next((known for known in map(_length, sorted(units)) if known), None)
    return _Header(tuple(range(min(at))), (at[0], at[1], at[2]), unit, tuple(w for w in plain if w in _TURNS))


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


def _point(words: Sequence[str], header: _Header | None, where: str) -> tuple[str, list[float]]:
    if header is not None:
        at, own = header.axes, header.name
    else:
        first = _first_number(words)
        at, own = (first, first + 1, first + 2), tuple(range(first))
    cells = [words[k] if k < len(words) else "" for k in at]
    if not all(_NUMBER.fullmatch(cell) for cell in cells):
        raise InputError(f"{where}: found {cut(' '.join(words))!r}, expected a name and x y z")
    xyz = [float(cell.replace("D", "e").replace("d", "e")) for cell in cells]
    if not max(map(abs, xyz)) <= LARGEST:
        raise InputError(f"{where}: found {cut(' '.join(cells))!r}, expected x y z of at most {LARGEST:g}")
    return "::".join(words[k] for k in own), xyz


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


__all__ = ["ANY", "DIALECTS", "Dialect", "dialect_of", "read_points"]
