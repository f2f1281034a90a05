"""A volumetric table after ISO 230-1 as text: one row for each axis and position, um and urad."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.export.held import held_tools
from truepose.models.leaves.export.links import clean
from truepose.models.leaves.export.volumetric import (
    CHECKED,
    Axis,
    Losses,
    Table,
    losses_of,
    references,
    table_of,
)
from truepose.models.leaves.export.write import ALL, LISTED, Exported, Format, formats, listed_sizes
from truepose.models.machine.kinematics import driver_default
from truepose.models.machine.machine import Machine

_ERRORS = (*(f"E{d} [um]" for d in "XYZ"), *(f"E{d} [urad]" for d in "ABC"))
_HEADER = ["axis", "joint", "position", "unit", *_ERRORS]
_MICRO = 1e-6 * np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
"""um and urad in mm and rad."""
_SHOWN = [1e3, 1e3, 1e3, 1e6, 1e6, 1e6]
Rows = dict[str, Array]
"""Positions (mm, deg) and errors (mm, rad) of axes by letter, (k, 7)."""
_DIGITS = (5e-10, 5e-13, 5e-12)
"""Half of the last digit of an error, mm and rad, and of a position, as a share of it."""
_NONE = 1e-15
"""mm or rad; a position that is no more is zero."""
_KEPT = 1e-6
"""mm; what a table loses of an effect less than this it holds."""
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


@formats.add("iso230")
class Iso230(Format):
    """The long table: mm or deg of the position as ``unit`` says. It holds effects of one axis by itself, in straight lines."""

    name, title, suffixes = "iso230", "the volumetric table", (".csv",)

    def render(self, machine: Machine) -> Exported:
        poses, table = table_of(machine)
        losses = losses_of(machine, poses, table)
        left = {label: size for label, size in losses.each.items() if size > _KEPT}
        frozen = held_tools(machine) | {
            placed.label: {name: driver_default(machine, name) for name in placed.drivers}
            for placed in machine.effects
            if placed.drivers
        }

        def notes(most: int) -> list[str]:
            """Return the notes, in which so many effects are named, largest first."""
            lost = (
                f"{self.title} leaves up to {losses.lost[0]:.3g} mm and {losses.lost[1] * 1e6:.3g} urad at the tool, of "
                f"{losses.uncompensated[0]:.3g} mm and {losses.uncompensated[1] * 1e6:.3g} urad ({CHECKED} places)"
            )
            return [
                lost + (f"; it cannot wholly hold: {listed_sizes(left, most)}" if left else ""),
                *self.frozen_lines(frozen, most),
            ]

        lines = [f"# {line}" for line in _head(machine.name, table, losses, notes(ALL))]
        lines.append(",".join(_HEADER))
        for axis in table.axes:
            unit, joint = "mm" if axis.unit == "mm" else "deg", _cell(axis.joint)
            positions = axis.positions if unit == "mm" else np.degrees(axis.positions)
            for position, errors in zip(positions.tolist(), axis.errors * _SHOWN, strict=True):
                told = ",".join(f"{clean(v):.6f}" for v in errors.tolist())
                lines.append(f"{axis.letter},{joint},{position:.12g},{unit},{told}")
        return Exported(
            self.name, "\n".join(lines) + "\n", left, losses.lost[0], frozen, tuple(notes(LISTED))
        )

    def differences(self, text: str, machine: Machine) -> Iterator[str]:
        """Yield how a volumetric table differs from a machine at its positions, each axis by itself."""
        length, angle, share = _DIGITS
        table, (poses, meant) = read_table(text, machine.mechanism.readings), table_of(machine)
        for axis, other in zip(table.axes, meant.axes, strict=True):
            found, drawn = (np.append(one.positions, one.reference) for one in (axis, other))
            if axis.letter != other.letter or axis.sign != other.sign or len(found) != len(drawn):
                yield f"{axis.joint} is axis {axis.letter} at {len(axis.positions)} positions"
            elif not np.allclose(found, drawn, rtol=share, atol=_NONE):
                yield f"the positions of axis {axis.letter} are others"
        pairs = zip(table.axes, meant.axes, strict=True)
        axes = [replace(axis, positions=other.positions, reference=other.reference) for axis, other in pairs]
        table, reference = replace(table, axes=tuple(axes)), references(axes)
        for k, axis in enumerate(axes):
            q = np.tile(reference, (len(axis.positions), 1))
            q[:, k] = axis.positions
            expected = poses(q, poses.model.p_home)
            away = np.abs(table.pose(q) - expected).max(axis=0)
            reach = max(1.0, float(np.max(np.abs(expected[:, :3, 3]))), float(np.max(np.abs(axis.centre))))
            worst, turn = float(np.max(away[:3, 3])), float(np.max(away[:3, :3]))
            if not (worst <= 2.0 * (length + reach * angle) and turn <= 4.0 * angle):
                yield f"with axis {axis.letter} alone its tool is off by {worst:.1e} mm and {turn:.1e} rad"


def _cell(name: str) -> str:
    """Return a name as a cell of a CSV."""
    return '"' + name.replace('"', '""') + '"' if set(name) & {",", '"'} else name


def _head(name: str, table: Table, losses: Losses, notes: Sequence[str]) -> list[str]:
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
        f"largest error of the tool at {CHECKED} places: {losses.uncompensated[0]:.4g} mm, "
        f"{losses.uncompensated[1] * 1e6:.4g} urad without this table; "
        f"{losses.lost[0]:.4g} mm, {losses.lost[1] * 1e6:.4g} urad with it"
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


def read_table(text: str, joints: Sequence[str]) -> Table:
    """Return the table of a text of a machine whose joints from the base to the tool are ``joints``.

    Raises InputError where a line is not as the format has it.
    """
    head = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# ")]
    rows = _read_rows([line for line in text.splitlines() if not line.startswith("# ")])
    chain, starts = _line_after(head, "axes from the base to the tool: "), _line_after(head, "reference: ")
    axes = []
    for joint in joints:
        name = re.escape(" ".join(joint.split()))
        letter, way, chain = _take_next(chain, rf"([XYZABC]) \({name}(, reversed)?\)")
        value, unit, starts = _take_next(starts, rf"{name} (\S+) (mm|deg)")
        turns = unit == "deg"
        sign, scale = (-1.0 if way else 1.0), (np.pi / 180.0 if turns else 1.0)
        table, centre = rows[letter], np.zeros(3)
        if turns:
            point = _line_after(head, f"axis {letter} turns about a line through ").removesuffix(" mm")
            centre = np.array([float(v) for v in point.split()])
        where = (centre, scale * float(value), scale * table[:, 0], table[:, 1:])
        axes.append(Axis(letter, joint, "rad" if turns else "mm", sign, *where))
    home = np.eye(4)
    placed = _line_after(head, "T(reference), tool in the base, rows of [R|p], mm: ")
    home[:3] = [[float(v) for v in row.split()] for row in placed.split(";")]
    return Table(tuple(axes), home)


def _read_rows(body: Sequence[str]) -> Rows:
    header, *lines = csv.reader(body)
    if header != _HEADER:
        raise InputError(f"found the columns {', '.join(header)}, expected {', '.join(_HEADER)}")
    rows: dict[str, list[list[float]]] = {}
    for letter, _, position, _, *errors in lines:
        rows.setdefault(letter, []).append([float(v) for v in (position, *errors)])
    return {letter: np.array(table) * [1.0, *_MICRO] for letter, table in rows.items()}


def _line_after(head: Sequence[str], start: str) -> str:
    for line in head:
        if line.startswith(start):
            return line.removeprefix(start)
    raise InputError(f"found no line {start.strip()!r} in its head, expected one")


def _take_next(text: str, pattern: str) -> tuple[str, str, str]:
    """Return the two groups of what a list begins with, and the rest of the list."""
    found = re.match(pattern + "(?:, |$)", text)
    if found is None:
        raise InputError(f"found {text[:80]!r} in its head, expected {pattern}")
    return found[1], found[2], text[found.end() :]
