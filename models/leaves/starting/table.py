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
from typing import Any, NamedTuple

from truepose.errors import InputError
from truepose.files import check_input
from truepose.models.leaves.starting.start import Start, unranged
from truepose.models.units import compatible, convert, parse_unit
from truepose.wording import close_matches, shortened

_NUMBER = r"(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_CELL = re.compile(
    rf"(?P<sign>[-+]?)(?P<number>{_NUMBER})?(?P<pi>\*?(?:pi|π)(?:/(?P<by>{_NUMBER}))?)?\s*(?P<unit>°|[a-zµ]+)?",
    re.I,
)
_LETTER = r"(?:θ|theta|th|q|d|var)_?\{?\d*\}?\*?"
_VARIABLE = re.compile(rf"^([-+]?)({_LETTER})", re.IGNORECASE)
_VARIABLE_LAST = re.compile(rf"^(.*?)\s*\+\s*({_LETTER})$", re.IGNORECASE)
_PRINTED = str.maketrans("−–º˚₀₁₂₃₄₅₆₇₈₉", "--°°0123456789")
_RADIANS = (math.pi / 4, math.pi / 2, math.pi, 3 * math.pi / 2)
_USUAL = {"length": "mm", "angle": "deg"}
_EXPECTED = {
    "length": "a length such as 425, 0.425 m or 425 mm",
    "angle": "an angle such as 90, -pi/2 or 90 deg",
}


class Cell(NamedTuple):
    """A number in mm or deg, and whether its text (or its column) says in which unit it stood."""

    value: float
    unit_said: bool


def cell(text: str, dimension: str, unit: str, where: str, *, variable: bool = False) -> Cell:
    """Return a number of ``dimension`` (length, angle) in mm or deg; ``unit`` is the column's, empty if it names none.

    With ``variable`` the joint's own variable may stand before it (``θ1 - 90``). Empty text and a dash are 0.
    Raises InputError, opened by ``where``, for what is no number, and for an angle that looks like radians although
    nothing says so.
    """
    plain = _normal(text)
    if variable:
        plain = _without_variable(plain, where, text)
    if plain in ("", "-"):
        return Cell(0.0, unit_said=True)
    found, usual = _CELL.fullmatch(plain), _USUAL[dimension]
    said = ((found and found["unit"]) or unit).lower()
    turned = found is not None and found["pi"] is not None
    if (
        found is None
        or not (found["number"] or turned)
        or (turned and dimension == "length")
        or (said and not compatible(said, usual))
    ):
        raise InputError(f"{where}: found {text!r}, expected {_EXPECTED[dimension]}")
    value = _float(found["sign"] + (found["number"] or "1"))
    if turned:
        return Cell(value * 180.0 / _float(found["by"] or "1"), unit_said=True)
    if dimension == "angle" and not said and any(abs(abs(value) - r) < 5e-4 * r for r in _RADIANS):
        raise InputError(
            f"{where}: found {text!r} without a unit, which looks like radians, expected a header such as "
            "`alpha [rad]` or `alpha [deg]`"
        )
    return Cell(convert(value, said or usual, usual), unit_said=bool(said))


def interval(text: str, dimension: str, unit: str, where: str) -> tuple[float, float]:
    """Return a range in mm or deg: ``-170..170``, ``-170 to 170``, ``±170``, ``[-170, 170]``. Raises InputError otherwise."""
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
    """Return the joint's variable that a cell names, as in ``θ1``, ``q2 - 90``, ``90 + q2``; empty if it names none."""
    plain = _normal(text)
    found = _VARIABLE.match(plain) or _VARIABLE_LAST.match(plain)
    return found[2].lower() if found else ""


def _without_variable(text: str, where: str, found: str) -> str:
    """Return what a cell adds to the joint's variable."""
    match, last = _VARIABLE.match(text), _VARIABLE_LAST.match(text)
    if match is None:
        return last[1] if last else text
    if match[1] == "-":
        raise InputError(
            f"{where}: found {found!r}, a joint that turns against its axis, expected a positive variable: turn its "
            "axis round in the table (alpha + 180)"
        )
    rest = text[match.end() :].strip()
    return re.sub(r"^([-+])\s+", r"\1", rest).removeprefix("+")


def _normal(text: str) -> str:
    """Return a text with plain minus signs and digits, without spaces at its ends."""
    return text.strip().translate(_PRINTED)


def _float(text: str) -> float:
    return float(text.replace(",", "."))


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


FIELDS: Mapping[str, tuple[str, ...]] = {
    "standard": ("a", "alpha", "d", "theta"),
    "modified": ("a", "alpha", "d", "theta"),
    "khalil": ("beta", "alpha", "d", "theta", "r"),
}
"""Columns of each convention."""
_ALIASES = {
    "α": "alpha", "θ": "theta", "β": "beta", "joint": "name", "link": "name", "i": "name", "type": "kind", "lower": "min",
    "upper": "max", "theta_offset": "offset", "θ_offset": "offset", "q_offset": "offset", "limits": "range",
}  # fmt: skip
_DIMENSION = {
    **dict.fromkeys(("a", "d", "r"), "length"), **dict.fromkeys(("alpha", "beta", "theta", "offset"), "angle"),
}  # fmt: skip
_KNOWN = ("name", "kind", *_DIMENSION, "min", "max", "range")
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

    def number(self, column: str, kind: str, dimension: str = "") -> Cell:
        """Return a cell of a joint of a kind; ``dimension`` is that of ends of its range."""
        variable = column in (("d", "r") if kind == "prismatic" else ("theta",))
        text, unit = self.cells.get(column, ""), self.units.get(column, "")
        where = f"{self.where}, column {column!r}"
        return cell(text, dimension or _DIMENSION[column], unit, where, variable=variable)

    def limits(self, kind: str) -> list[float] | None:
        """Return the joint's range, None where there is none."""
        dimension = "length" if kind == "prismatic" else "angle"
        text = self.cells.get("range", "").strip()
        if text:
            where = f"{self.where}, column 'range'"
            ends = interval(text, dimension, self.units.get("range", ""), where)
        elif any(self.cells.get(end, "").strip() for end in ("min", "max")):
            ends = self.number("min", kind, dimension).value, self.number("max", kind, dimension).value
        else:
            return None
        if ends[0] >= ends[1]:
            raise InputError(f"{self.where}: found the range {list(ends)}, expected its lower end first")
        return list(ends)


def table_start(path: Path, convention: str) -> Start:
    """Return the start of a table file. Raises InputError naming file, row and column."""
    try:
        check_input(path)
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as exc:
        reason = exc.strerror if isinstance(exc, OSError) else "not a text in UTF-8"
        raise InputError(f"{path}: cannot read the table: {reason}") from None
    rows = _rows(text, path)
    columns = {column for row in rows for column in row.cells}
    if not convention and "r" not in columns:
        raise InputError(
            f"{path}: found columns a, alpha, d and theta, which two conventions share, expected --convention standard "
            "(a and alpha lie beyond the joint: most data sheets) or modified (Craig's: a and alpha lie before it)"
        )
    convention = convention or "khalil"
    if convention not in FIELDS:
        raise InputError(f"--convention: found {convention!r}, expected one of {', '.join(FIELDS)}")
    kinds, notes = row_kinds([row.cells for row in rows], [row.where for row in rows])
    _refuse_shared_variables(rows)
    joints, lengths = [], []
    for k, (row, kind) in enumerate(zip(rows, kinds, strict=True), start=1):
        cells = {field: row.number(field, kind) for field in FIELDS[convention]}
        lengths += [found for field, found in cells.items() if _DIMENSION[field] == "length"]
        joint: dict[str, Any] = {
            "name": _name(row, k, kind),
            "kind": kind,
            **{f: found.value for f, found in cells.items()},
        }
        joint["theta"] += row.number("offset", kind).value
        limits = row.limits(kind)
        joints.append(joint if limits is None else joint | {"range": limits})
    _refuse_metres(lengths, path)
    names = [joint["name"] for joint in joints]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice or not joints:
        found = f"the joint {twice[0]!r} twice" if twice else "no rows"
        raise InputError(f"{path}: found {found}, expected a row for each joint, with a name of its own")
    missing = [field for field in FIELDS[convention] if field not in (*columns, "beta")]
    if missing:
        notes = (*notes, f"CHECK columns that the table has not, all 0 here: {', '.join(missing)}.")
    about = ("CHECK every number against the drawing.", *notes, *unranged(joints))
    mechanism = {"type": "serial", "convention": convention, "joints": joints}
    return Start(path.stem, f"The table {path.name}", mechanism, about)


def _name(row: Row, place: int, kind: str) -> str:
    """Return the name of a row: its own; of one that is only counted, q1 or, without a joint, row1."""
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


def _refuse_metres(lengths: Sequence[Cell], path: Path) -> None:
    """Refuse a table of short lengths of which none says its unit."""
    used = [length for length in lengths if length.value]
    largest = max((abs(length.value) for length in used), default=_METRES)
    if largest < _METRES and not any(length.unit_said for length in used):
        raise InputError(
            f"{path}: found no length above {largest:g} and no unit, which looks like metres, expected headers such as "
            "`a [m]`, `d [m]` (or [mm])"
        )


def _rows(text: str, path: Path) -> list[Row]:
    lines = [
        (k, line.strip().strip("|"))
        for k, line in enumerate(text.splitlines(), start=1)
        if line.strip() and line.lstrip()[0] != "#"
    ]
    if not lines:
        raise InputError(f"{path}: found no header, expected the columns a, alpha, d, theta")
    mark = next((mark for mark in "\t;|," if mark in lines[0][1]), ",")
    header, *table = (next(csv.reader([line], delimiter=mark, skipinitialspace=True)) for _, line in lines)
    names, units = _header(header, path)
    out = []
    for (k, _), cells in zip(lines[1:], table, strict=True):
        if all(set(text.strip()) <= set("-:") for text in cells):
            continue  # the rule under the header of a Markdown table
        if len(cells) > len(names):
            raise InputError(
                f"{path}: line {k}: found {len(cells)} cells, expected {len(names)}: one a column"
            )
        out.append(Row(dict(zip(names, cells, strict=False)), units, f"{path}: line {k}"))
    return out


def _header(cells: Sequence[str], path: Path) -> tuple[list[str], dict[str, str]]:
    """Return the columns' names, and the units of those that have one."""
    units: dict[str, str] = {}
    names: list[str] = []
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
            units[name] = parse_unit(
                with_unit[2].lower(), _DIMENSION.get(name, "reading"), f"{path}: column {name!r}"
            )
    return names, units
