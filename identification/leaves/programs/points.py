"""Tables of points (CSV): joints, or poses ``x y z rx ry rz`` of the tool in the base's frame, corrected cell by cell."""

from __future__ import annotations

import codecs
import functools
import re
from collections.abc import Mapping, Sequence

from truepose.errors import InputError
from truepose.identification.leaves.programs.pose_forms import RotationVector
from truepose.identification.leaves.programs.program import (
    WHOLE_NUMBER,
    Kind,
    Left,
    Number,
    Program,
    Target,
    in_order,
    shown,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXIS_UNITS
from truepose.models.units import convert, parse_unit

_LINE = re.compile(r"([^\r\n]*)(?:\r\n|\n|\r|$)")
_HEADER = re.compile(r'^"?(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?"?$')
HEADER_MOST = 200
"""Characters of a header; a longer one names no column that counts."""
_MARKS = ";\t,"
_MARK_OF_UTF_8 = codecs.BOM_UTF8.decode("latin-1")
"""What some programs put before a text, as it reads here."""
_STEP = 1e-4
"""mm; a written coordinate is no coarser, and an angle no coarser than this at a metre."""
Cells = list[tuple[int, int]]


class Points:
    """CSV with a header; comma, semicolon or tab between cells, ``#`` before comments."""

    name, title = "csv", "table of points"

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        header, rows = _table(text)
        cells = [text[a:b].strip().removeprefix(_MARK_OF_UTF_8) for a, b in header]
        named = [_HEADER.match(cell) if len(cell) <= HEADER_MOST else None for cell in cells]
        units = {m["name"]: m["unit"] for m in named if m}
        place = {m["name"]: k for k, m in enumerate(named) if m}
        readings = machine.mechanism.readings
        joints = any(name in place for name in readings)
        wanted = readings if joints else tuple(AXIS_UNITS)
        missing = [name for name in wanted if name not in place]
        if missing:
            raise InputError(
                f"table: missing column {missing[0]!r}, expected the joints {', '.join(readings)}, or the tool's poses in "
                f"{', '.join(AXIS_UNITS)}"
            )
        kinds = machine.mechanism.reading_units if joints else AXIS_UNITS
        own = {n: _unit(machine, n, kinds[n], units[n], joints=joints) for n in wanted}
        targets, left = _targets(text, rows, [place[n] for n in wanted], "joints" if joints else "pose")
        again = functools.partial(self.read, machine=machine)
        return Program(
            text, targets, in_order(left), _form(own, joints=joints), own if joints else {}, again=again
        )


def _targets(
    text: str, rows: Sequence[tuple[int, Cells]], columns: Sequence[int], kind: Kind
) -> tuple[tuple[Target, ...], list[Left]]:
    """The points of a table, numbers in ``columns``, and rows that lack one."""
    targets: list[Target] = []
    left: list[Left] = []
    for count, (line, cells) in enumerate(rows, start=1):
        numbers = [_number(text, *cells[k]) if k < len(cells) else None for k in columns]
        known = tuple(n for n in numbers if n is not None)
        if len(known) < len(columns):
            row = shown(text[cells[0][0] : cells[-1][1]])
            left.append(Left(line, row, "not every cell of the point is a number"))
        else:
            targets.append(
                Target(line, f"row {count}", kind, known, place=cells[0][0], places=(cells[0][0],))
            )
    return tuple(targets), left


def _table(text: str) -> tuple[Cells, list[tuple[int, Cells]]]:
    """The header's cells, and the cells of each line of data with its number."""
    lines = [(k, m.start(1), m.end(1)) for k, m in enumerate(_LINE.finditer(text), start=1)]
    held = [one for one in lines if _tells(text[one[1] : one[2]])]
    if not held:
        raise InputError("table: found no line, expected a header and points")
    _, start, end = held[0]
    mark = max(_MARKS, key=lambda m: text.count(m, start, end))
    return _cells(text, start, end, mark), [(k, _cells(text, a, b, mark)) for k, a, b in held[1:]]


def _tells(line: str) -> bool:
    """Whether a line is neither empty nor a comment."""
    bare = line.removeprefix(_MARK_OF_UTF_8).strip()
    return bool(bare) and not bare.startswith("#")


def _cells(text: str, start: int, end: int, mark: str) -> Cells:
    out, begin = [], start
    while (k := text.find(mark, begin, end)) >= 0:
        out.append((begin, k))
        begin = k + 1
    return [*out, (begin, end)]


def _number(text: str, start: int, end: int) -> Number | None:
    cell = text[start:end]
    bare = cell.strip().strip('"').strip()
    if not WHOLE_NUMBER.fullmatch(bare):
        return None
    at = start + cell.index(bare)
    return Number(at, at + len(bare), bare)


def _unit(machine: Machine, name: str, kind: str, stated: str | None, *, joints: bool) -> str:
    if stated is not None:
        return parse_unit(stated, kind, f"table: column {name!r}")
    return machine.column_unit(name) if joints else machine.units.written(kind)


def _form(units: Mapping[str, str], *, joints: bool) -> RotationVector:
    """How poses are written; where the table has joints nothing is."""
    if joints:
        return RotationVector(("mm",) * 3, ("deg",) * 3, (4,) * 3 + (6,) * 3, "x,y,z,rx,ry,rz in mm and deg")
    names = tuple(AXIS_UNITS)
    x, y, z, rx, ry, rz = (units[name] for name in names)
    decimals = tuple(decimals_of(units[name], AXIS_UNITS[name]) for name in names)
    return RotationVector((x, y, z), (rx, ry, rz), decimals, f"x,y,z,rx,ry,rz in {x} and {rx}")


def decimals_of(unit: str, kind: str) -> int:
    """Decimals of a number in a unit: ``_STEP`` of a length (mm), a thousandth of that of an angle (rad)."""
    step = convert(_STEP if kind == "mm" else _STEP / 1000.0, kind, unit)
    out = 0
    while float(step) < 0.999 and out < 12:
        step, out = step * 10.0, out + 1
    return out
