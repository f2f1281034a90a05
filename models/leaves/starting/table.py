"""Denavit-Hartenberg tables from a CSV: the columns a, alpha, d, theta (and r, beta for Khalil's), one row a joint
or a fixed frame (``truepose.models.leaves.starting.row_kinds``).

Optional columns: name (or joint), kind, offset (added to theta), min and max, or range. A unit may stand in a header
(``a [m]``, ``alpha (rad)``) or in a cell (``pi/2``, ``90°``); without one lengths are mm and angles deg, and what looks
like metres or radians is refused rather than guessed.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from truepose.bounded import check_input
from truepose.errors import InputError
from truepose.models.leaves.starting.cells import UNITS, Cell, cell, interval, variable_in
from truepose.models.leaves.starting.row_kinds import row_kinds
from truepose.models.leaves.starting.start import Start, unranged
from truepose.wording import close_matches

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
