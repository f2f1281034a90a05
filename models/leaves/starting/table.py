"""Denavit-Hartenberg tables from a CSV: the columns a, alpha, d, theta (and r, beta for Khalil's), one row a joint
or a fixed frame (``truepose.models.leaves.starting.table``).

Optional columns: name (or joint), kind, offset (added to theta), min and max, or range. A unit may stand in a header
(``a [m]``, ``alpha (rad)``) or in a cell (``pi/2``, ``90°``); without one lengths are mm and angles deg, and what looks
like metres or radians is refused rather than guessed.

Which rows of a Denavit-Hartenberg table are joints: a row is driven where the table says so, and fixed where it does not.

A table says it by a column ``kind``, by the joint's variable in theta, or in d where theta has none, and by a range. If it says
so of one turning joint, it is taken to say it of all. If it says it of none, names decide: of rows that are counted (q1 to q7)
one without a number is fixed, and so is a flange. What only names say is listed, so that nothing is driven in silence.
"""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from truepose.bounded import check_input
from truepose.errors import InputError
from truepose.models.leaves.starting.start import Start, unranged
from truepose.wording import close_matches, shortened

_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3, "in": 25.4, "inch": 25.4}
_DEG = {
    "deg": 1.0,
    "°": 1.0,
    "degree": 1.0,
    "degrees": 1.0,
    "rad": 180.0 / math.pi,
    "radian": 180.0 / math.pi,
}
UNITS = {"length": _MM, "angle": _DEG}
"""Factors to mm and to deg."""
_NUMBER = r"(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_PI = re.compile(rf"^([-+]?)({_NUMBER})?\*?(?:pi|π)(?:/({_NUMBER}))?$", re.IGNORECASE)
_PLAIN = re.compile(rf"^[-+]?{_NUMBER}$")
_UNIT = re.compile(r"^(.*?[\d.,iπ])\s*(mm|cm|m|um|µm|inch|in|deg|°|degrees?|rad|radian)$", re.IGNORECASE)
_LETTER = r"(?:θ|theta|th|q|d|var)_?\{?\d*\}?\*?"
_VARIABLE = re.compile(rf"^([-+]?)({_LETTER})", re.IGNORECASE)
_VARIABLE_LAST = re.compile(rf"^(.*?)\s*\+\s*({_LETTER})$", re.IGNORECASE)
_PRINTED = str.maketrans("−–º˚₀₁₂₃₄₅₆₇₈₉", "--°°0123456789")
_RADIANS = (math.pi / 4, math.pi / 2, math.pi, 3 * math.pi / 2)


@dataclass(frozen=True)
class Cell:
    """A number in mm or deg, and whether its text (or its column) says in which unit it stood."""

    value: float
    unit_said: bool


def cell(text: str, dimension: str, unit: str, where: str, *, variable: bool = False) -> Cell:
    """A number of ``dimension`` (length, angle) in mm or deg; ``unit`` is the column's, empty where it names none.

    With ``variable`` the joint's own variable may stand before it (``θ1 - 90``). Empty text and a dash are 0.
    Raises InputError, opened by ``where``, for what is no number, and for an angle that looks like radians although
    nothing says so.
    """
    plain = _normal(text)
    if variable:
        plain = _without_variable(plain, where, text)
    if plain in ("", "-"):
        return Cell(0.0, unit_said=True)
    found = _UNIT.match(plain)
    own = found[2].lower() if found else ""
    said = own or unit
    if said and said not in UNITS[dimension]:
        raise InputError(f"{where}: found {text!r}, expected {_expected(dimension)}")
    number = found[1].strip() if found else plain
    turned = _PI.match(number) if dimension == "angle" else None
    if turned:
        sign = -1.0 if turned[1] == "-" else 1.0
        return Cell(sign * _float(turned[2] or "1") * 180.0 / _float(turned[3] or "1"), unit_said=True)
    if not _PLAIN.match(number):
        raise InputError(f"{where}: found {text!r}, expected {_expected(dimension)}")
    value = _float(number)
    if dimension == "angle" and not said and any(abs(abs(value) - r) < 5e-4 * r for r in _RADIANS):
        raise InputError(
            f"{where}: found {text!r} without a unit, which looks like radians, expected a header such as "
            "`alpha [rad]` or `alpha [deg]`"
        )
    return Cell(
        value * UNITS[dimension][said or ("mm" if dimension == "length" else "deg")], unit_said=bool(said)
    )


def interval(text: str, dimension: str, unit: str, where: str) -> tuple[float, float]:
    """A range in mm or deg: ``-170..170``, ``-170 to 170``, ``±170``, ``[-170, 170]``. Raises InputError otherwise."""
    plain = _normal(text).strip("[]()")
    symmetric = re.match(r"^(?:±|\+/-|\+-)(.*)$", plain)
    if symmetric:
        high = cell(symmetric[1], dimension, unit, where).value
        return -high, high
    parts = [part for part in re.split(r"\s*(?:\.\.\.?|\bto\b|;|,(?=\s)|/)\s*", plain) if part]
    if len(parts) != 2:
        raise InputError(f"{where}: found {text!r}, expected two numbers such as -170..170, or ±170")
    ends = [cell(part, dimension, unit, where).value for part in parts]
    return min(ends), max(ends)


def variable_in(text: str) -> str:
    """Return the joint's variable that a cell names, as in ``θ1``, ``q2 - 90``, ``90 + q2``; empty where it names none."""
    plain = _normal(text)
    found = _VARIABLE.match(plain) or _VARIABLE_LAST.match(plain)
    return found[2].lower() if found else ""


def _without_variable(text: str, where: str, found: str) -> str:
    last = _VARIABLE_LAST.match(text)
    match = _VARIABLE.match(text)
    if last and not match:
        return last[1]
    if not match:
        return text
    if match[1] == "-":
        raise InputError(
            f"{where}: found {found!r}, a joint that turns against its axis, expected a positive variable: turn its "
            "axis round in the table (alpha + 180)"
        )
    rest = text[match.end() :].strip()
    return re.sub(r"^([-+])\s+", r"\1", rest).removeprefix("+")


def _normal(text: str) -> str:
    """Text with plain minus signs and digits, without spaces at its ends."""
    return text.strip().translate(_PRINTED)


def _float(text: str) -> float:
    return float(text.replace(",", "."))


def _expected(dimension: str) -> str:
    return (
        "a length such as 425, 0.425 m or 425 mm"
        if dimension == "length"
        else "an angle such as 90, -pi/2 or 90 deg"
    )


Cells = Mapping[str, str]
_KINDS = {
    "": "", "revolute": "revolute", "r": "revolute", "rotary": "revolute", "rotational": "revolute",
    "prismatic": "prismatic", "p": "prismatic", "linear": "prismatic", "t": "prismatic",
    "fixed": "fixed", "f": "fixed", "none": "fixed", "static": "fixed", "constant": "fixed", "-": "fixed",
}  # fmt: skip
_ENDS = {"flange", "tool", "tcp", "ee", "eef", "effector", "endeffector"}
_NAMED = 10


def row_kinds(rows: Sequence[Cells], places: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return each row's kind (revolute, prismatic, fixed), and notes on what the table leaves open.

    ``places`` open messages. Raises InputError for an unknown kind, and for a row that is fixed and moves.
    """
    stated = [_stated_kind(row, where) for row, where in zip(rows, places, strict=True)]
    labels = [row.get("name", "").strip() for row in rows]
    complete = any(_states_turning(row) for row in rows)
    kinds, assumed, still = [], [], []
    for label, kind, fixed, place in zip(labels, stated, _fixed_by_name(labels), places, strict=True):
        shown = repr(label) if label else place.rpartition(": ")[2]
        if kind:
            kinds.append(kind)
        elif complete or fixed:
            kinds.append("fixed")
            still.append(shown)
        else:
            kinds.append("revolute")
            assumed += [shown] if not re.search(r"\d", label) else []
    notes = []
    if still:
        why = "have no variable, as others have" if complete else "are not named as joints"
        notes.append(f"CHECK rows that {why}, and are fixed here: {shortened(still, _NAMED)}.")
    if assumed:
        notes.append(
            f"CHECK rows that do not say whether they are driven, and are here: {shortened(assumed, _NAMED)}. One that is not "
            "has kind fixed."
        )
    return kinds, tuple(notes)


def _stated_kind(row: Cells, where: str) -> str:
    """Return the kind that a row states, empty where it states none."""
    found = row.get("kind", "").strip().lower()
    if found not in _KINDS:
        raise InputError(f"{where}, column 'kind': found {found!r}, expected revolute, prismatic or fixed")
    moves = next((column for column in ("theta", "d", "r") if variable_in(row.get(column, ""))), "")
    ranged = next((column for column in ("range", "min", "max") if row.get(column, "").strip()), "")
    if _KINDS[found] == "fixed" and (moves or ranged):
        column = moves or ranged
        raise InputError(
            f"{where}, column {column!r}: found {row[column].strip()!r} in a fixed row, expected a joint's row"
        )
    if _KINDS[found]:
        return _KINDS[found]
    if moves:
        return "revolute" if moves == "theta" else "prismatic"
    return "revolute" if ranged else ""


def _states_turning(row: Cells) -> bool:
    """Return whether a row says, by its kind or its variable, that it is a turning joint's."""
    return _KINDS[row.get("kind", "").strip().lower()] == "revolute" or bool(
        variable_in(row.get("theta", ""))
    )


def _fixed_by_name(labels: Sequence[str]) -> list[bool]:
    """Return for each name whether it is a flange's or a tool's, or one without a number among rows that are counted."""
    stems = [re.sub(r"\d+", "", label.lower()) if re.search(r"\d", label) else None for label in labels]
    counted = any(2 * n > len(labels) for stem, n in Counter(stems).items() if stem is not None)
    ends = [bool(_ENDS & set(re.split(r"[^a-z]+", label.lower()))) for label in labels]
    return [end or (counted and stem is None) for end, stem in zip(ends, stems, strict=True)]


CONVENTIONS = ("standard", "modified", "khalil")
FIELDS: Mapping[str, tuple[str, ...]] = {
    "standard": ("a", "alpha", "d", "theta"),
    "modified": ("a", "alpha", "d", "theta"),
    "khalil": ("beta", "alpha", "d", "theta", "r"),
}
_ANGLES = ("alpha", "beta", "theta", "offset")
_ALIASES = {
    "α": "alpha", "θ": "theta", "β": "beta", "joint": "name", "link": "name", "i": "name", "type": "kind", "lower": "min",
    "upper": "max", "theta_offset": "offset", "θ_offset": "offset", "q_offset": "offset", "limits": "range",
}  # fmt: skip
_KNOWN = ("name", "kind", "a", "alpha", "d", "theta", "r", "beta", "offset", "min", "max", "range")
_FRAMES = ("base", "flange", "tool", "world")
"""Names of frames, which no row may have."""
_METRES = 5.0
"""mm: a table of nothing but shorter lengths was most likely written in metres."""
_HEADER = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]$")


@dataclass(frozen=True)
class Row:
    """One line of the table: its cells by column, the columns' units, and how messages call the line."""

    cells: Mapping[str, str]
    units: Mapping[str, str]
    where: str

    def number(self, column: str, *, prismatic: bool) -> Cell:
        own = "d" if prismatic else "theta"
        dimension = "angle" if column in _ANGLES else "length"
        variable = column == own or (prismatic and column == "r")
        where = f"{self.where}, column {column!r}"
        return cell(
            self.cells.get(column, ""), dimension, self.units.get(column, ""), where, variable=variable
        )

    def limits(self, *, prismatic: bool) -> tuple[float, float] | None:
        dimension = "length" if prismatic else "angle"
        text = self.cells.get("range", "").strip()
        if text:
            return interval(text, dimension, self.units.get("range", ""), f"{self.where}, column 'range'")
        ends = [self.cells.get(end, "").strip() for end in ("min", "max")]
        if not any(ends):
            return None
        low, high = (
            cell(text, dimension, self.units.get(end, ""), f"{self.where}, column {end!r}").value
            for text, end in zip(ends, ("min", "max"), strict=True)
        )
        return low, high


def table_start(path: Path, convention: str) -> Start:
    """The start of a table file. Raises InputError naming file, row and column."""
    try:
        check_input(path)
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as exc:
        reason = exc.strerror if isinstance(exc, OSError) else "not a text in UTF-8"
        raise InputError(f"{path}: cannot read the table: {reason}") from None
    rows = _rows(text, path)
    if not convention:
        convention = _stated(rows, path)
    return start_of(rows, convention, path.stem, f"the table {path.name}", str(path))


def start_of(rows: Sequence[Row], convention: str, name: str, title: str, where: str) -> Start:
    """The start of read rows. Raises InputError for what the rows' cells do not say."""
    if convention not in CONVENTIONS:
        raise InputError(f"--convention: found {convention!r}, expected one of {', '.join(CONVENTIONS)}")
    joints, lengths = [], []
    kinds, notes = row_kinds([row.cells for row in rows], [row.where for row in rows])
    _refuse_shared_variables(rows)
    for k, (row, kind) in enumerate(zip(rows, kinds, strict=True), start=1):
        joint, used = _joint(row, k, convention, kind)
        joints.append(joint)
        lengths += used
    _refuse_metres(lengths, where)
    names = [joint["name"] for joint in joints]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice or not joints:
        found = f"the joint {twice[0]!r} twice" if twice else "no rows"
        raise InputError(f"{where}: found {found}, expected a row for each joint, with a name of its own")
    mechanism = {"type": "serial", "convention": convention, "joints": joints}
    missing = [
        field
        for field in FIELDS[convention]
        if field != "beta" and not any(field in row.cells for row in rows)
    ]
    if missing:
        notes = (*notes, f"CHECK columns that the table has not, all 0 here: {', '.join(missing)}.")
    about = ("CHECK every number against the drawing.", *notes, *unranged(joints))
    return Start(name, title[:1].upper() + title[1:], mechanism, about)


def _joint(row: Row, place: int, convention: str, kind: str) -> tuple[dict[str, Any], list[Cell]]:
    """A row as a joint of a machine file, and its lengths."""
    prismatic = kind == "prismatic"
    joint: dict[str, Any] = {"name": _name(row, place, kind), "kind": kind}
    lengths = []
    for field in FIELDS[convention]:
        found = row.number(field, prismatic=prismatic)
        joint[field] = found.value
        lengths += [] if field in _ANGLES else [found]
    joint["theta"] += row.number("offset", prismatic=prismatic).value
    limits = row.limits(prismatic=prismatic)
    if limits is not None:
        if limits[0] >= limits[1]:
            raise InputError(f"{row.where}: found the range {list(limits)}, expected its lower end first")
        joint["range"] = list(limits)
    return joint, lengths


def _name(row: Row, place: int, kind: str) -> str:
    """Name of a row: its own; of one that is only counted, q1 or, without a joint, row1."""
    label = row.cells.get("name", "").strip() or str(place)
    if kind == "fixed" and label.lower() in _FRAMES:
        return f"{label.lower()}_frame"
    return f"{'row' if kind == 'fixed' else 'q'}{label}" if label.isdigit() else label


def _refuse_shared_variables(rows: Sequence[Row]) -> None:
    """Refuse one variable in two rows: no row of a table couples joints."""
    seen: dict[str, str] = {}
    for row in rows:
        for column in ("theta", "d", "r"):
            name = variable_in(row.cells.get(column, ""))
            if any(digit.isdigit() for digit in name) and seen.setdefault(name, row.where) != row.where:
                raise InputError(
                    f"{row.where}, column {column!r}: found the variable {name} of {seen[name]}, expected one of its own: "
                    "joints that move together are a `mimic` of type: graph"
                )


def _refuse_metres(lengths: Sequence[Cell], where: str) -> None:
    used = [length for length in lengths if length.value]
    if (
        used
        and not any(length.unit_said for length in used)
        and all(abs(length.value) < _METRES for length in used)
    ):
        largest = max(abs(length.value) for length in used)
        raise InputError(
            f"{where}: found no length above {largest:g} and no unit, which looks like metres, expected headers such as "
            "`a [m]`, `d [m]` (or [mm])"
        )


def _stated(rows: Sequence[Row], path: Path) -> str:
    """Khalil's convention shows by its column r; of the two others a table does not say which it is."""
    if any("r" in row.cells for row in rows):
        return "khalil"
    raise InputError(
        f"{path}: found columns a, alpha, d and theta, which two conventions share, expected --convention standard "
        "(a and alpha lie beyond the joint: most data sheets) or modified (Craig's: a and alpha lie before it)"
    )


def _rows(text: str, path: Path) -> list[Row]:
    lines = [
        (k, line)
        for k, line in enumerate(text.splitlines(), start=1)
        if line.strip() and line.lstrip()[0] != "#"
    ]
    if not lines:
        raise InputError(f"{path}: found no header, expected the columns a, alpha, d, theta")
    mark = next((mark for mark in ("\t", ";", "|", ",") if mark in lines[0][1]), ",")
    table = [
        (k, next(csv.reader([line.strip().strip("|")], delimiter=mark, skipinitialspace=True)))
        for k, line in lines
    ]
    names, units = _header(table[0][1], path)
    out = []
    for k, cells in table[1:]:
        if all(set(text.strip()) <= set("-:") for text in cells):
            continue  # the rule under the header of a Markdown table
        if len(cells) > len(names):
            raise InputError(
                f"{path}: line {k}: found {len(cells)} cells, expected {len(names)}: one a column"
            )
        out.append(Row(dict(zip(names, cells, strict=False)), units, f"{path}: line {k}"))
    return out


def _header(cells: Sequence[str], path: Path) -> tuple[list[str], dict[str, str]]:
    names: list[str] = []
    units: dict[str, str] = {}
    for text in cells:
        with_unit = _HEADER.match(text.strip())
        label = (with_unit[1] if with_unit else text).strip().lower().replace(" ", "_")
        name = _ALIASES.get(label, label)
        if name not in _KNOWN:
            raise InputError(f"{path}: found the column {text.strip()!r}; {close_matches(name, _KNOWN)}")
        if name in names:
            raise InputError(f"{path}: found the column {name!r} twice, expected it once")
        names.append(name)
        if with_unit:
            units[name] = _unit(name, with_unit[2], path)
    return names, units


def _unit(name: str, unit: str, path: Path) -> str:
    known = [*UNITS["angle"], *UNITS["length"]]
    if name in _ANGLES:
        known = list(UNITS["angle"])
    elif name in ("a", "d", "r"):
        known = list(UNITS["length"])
    if unit.lower() not in known:
        raise InputError(
            f"{path}: column {name!r}: found the unit {unit!r}, expected one of {', '.join(known)}"
        )
    return unit.lower()
