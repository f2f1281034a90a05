"""Volumetric tables as text: a long table after ISO 230-1, and the CSV that ISG kernels (Beckhoff TwinCAT CNC) read.

Source of the second: documentation of the ISG kernel, FCT-C26, and of Beckhoff TF5280, "Volumetric compensation": "ISG CSV
format", "Units of measure", "List of parameters supported": mm and rad, arguments in mm and deg, ``//`` before comments, ``#``
between blocks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose.arrays import Array
from truepose.models.leaves.export.numbers import clean
from truepose.models.leaves.export.volumetric import CHECKED, Axis, Table

_DIRECTIONS = "XYZABC"
_SLOPES = {
    "X": (("B0X", 2, -1.0), ("C0X", 1, 1.0)),
    "Y": (("A0Y", 2, 1.0), ("C0Y", 0, -1.0)),
    "Z": (("A0Z", 1, -1.0), ("B0Z", 0, 1.0)),
}
"""Turns of a linear axis against the base: name, the straightness error that grows with it along the axis, and its sign."""
_SQUARE = (("C0Y", "C0X", "Y to X"), ("B0Z", "B0X", "Z to X"), ("A0Z", "A0Y", "Z to Y"))
_MEANING = (
    "error = actual - nominal; drivers of effects (temperature, load) at their defaults",
    "directions are those of the base's frame with all axes at their reference",
    "T(q) = X_1(q_1) ... X_n(q_n) T(reference), from the base to the tool",
    "X(q) = D(q) E(q): the axis without errors, then Trans(EX EY EZ) Exp(EA EB EC), a rotation vector, at the axis's point",
    "the point of a linear axis is the base's origin, carried along; of a rotary axis the point named below",
    "between positions: straight lines",
)


def iso230_text(name: str, table: Table, notes: Sequence[str]) -> str:
    """The long table: one row for each axis and position, um and urad; mm or deg of the position as ``unit`` says."""
    lines = [f"# {line}" for line in _head(name, table, notes)]
    lines.append("axis,joint,position,unit,EX [um],EY [um],EZ [um],EA [urad],EB [urad],EC [urad]")
    for axis in table.axes:
        unit = "mm" if axis.unit == "mm" else "deg"
        joint = _cell(axis.joint)
        for position, errors in zip(_argument(axis).tolist(), axis.errors, strict=True):
            told = ",".join(f"{clean(v):.6f}" for v in (errors * [1e3, 1e3, 1e3, 1e6, 1e6, 1e6]).tolist())
            lines.append(f"{axis.letter},{joint},{position:.12g},{unit},{told}")
    return "\n".join(lines) + "\n"


def _cell(name: str) -> str:
    """Return a name as a cell of a CSV."""
    return '"' + name.replace('"', '""') + '"' if set(name) & {",", '"'} else name


def isg_text(name: str, table: Table, notes: Sequence[str]) -> str:
    """Component errors of each axis in a block: mm and rad, positions in mm and deg. Squareness is in EXY, EXZ, EYZ ..."""
    lines = [f"// {line}" for line in _head(name, table, notes)]
    lines.append(
        f"// chain {''.join(axis.letter for axis in table.axes)}, no workpiece axes; no position errors: straightness has them"
    )
    for k, axis in enumerate(table.axes):
        lines += ["#"] if k else []
        lines.append("\t".join([axis.letter, *(f"E{d}{axis.letter}" for d in _DIRECTIONS)]))
        rows = list(zip(_argument(axis).tolist(), axis.errors.tolist(), strict=True))
        for position, errors in rows if axis.sign > 0 else rows[::-1]:
            lines.append("\t".join([f"{axis.sign * position:.10g}", *(f"{clean(v):.12f}" for v in errors)]))
    return "\n".join(lines) + "\n"


def _argument(axis: Axis) -> Array:
    return axis.positions if axis.unit == "mm" else np.degrees(axis.positions)


def _head(name: str, table: Table, notes: Sequence[str]) -> list[str]:
    """What a reader must know, in the order in which it is needed."""
    chain = ", ".join(f"{a.letter} ({a.joint}{', reversed' if a.sign < 0 else ''})" for a in table.axes)
    out = [
        f"volumetric errors after ISO 230-1 of {name}",
        *_MEANING,
        f"axes from the base to the tool: {chain}",
    ]
    out.append("reference: " + ", ".join(f"{a.joint} {_shown(a, a.reference)}" for a in table.axes))
    for axis in table.axes:
        if axis.unit == "rad":
            point = " ".join(f"{v:.15g}" for v in axis.centre.tolist())
            out.append(f"axis {axis.letter} turns about a line through {point} mm")
    rows = "; ".join(" ".join(repr(clean(float(v))) for v in row) for row in table.home[:3])
    out.append(f"T(reference), tool in the base, rows of [R|p], mm: {rows}")
    turns = squareness(table)
    if turns:
        told = ", ".join(f"{label} {value * 1e6:.4g} urad" for label, value in turns.items())
        out.append(f"squareness, by lines of least squares, is in the straightness below: {told}")
    out.append(
        f"largest error of the tool at {CHECKED} places: {table.uncompensated[0]:.4g} mm, "
        f"{table.uncompensated[1] * 1e6:.4g} urad without this table; "
        f"{table.lost[0]:.4g} mm, {table.lost[1] * 1e6:.4g} urad with it"
    )
    return [" ".join(line.split()) for line in (*out, *notes)]


def squareness(table: Table) -> dict[str, float]:
    """Angles (rad) between linear axes less 90 deg, by least-squares lines: ``C0Y (Y to X)`` and so on, of those there are."""
    turns: dict[str, float] = {}
    for axis in table.axes:
        for label, column, sign in _SLOPES.get(axis.letter, ()):
            slope = float(np.polyfit(axis.sign * axis.positions, axis.errors[:, column], 1)[0])
            turns[label] = sign * slope
    pairs = [pair for pair in _SQUARE if pair[0] in turns and pair[1] in turns]
    return {f"{a} ({words})": clean(turns[a] - turns[b]) for a, b, words in pairs}


def _shown(axis: Axis, value: float) -> str:
    return f"{value:.15g} mm" if axis.unit == "mm" else f"{np.degrees(value):.15g} deg"
