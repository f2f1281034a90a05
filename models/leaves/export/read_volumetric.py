"""Read an exported volumetric table: its axes from the rows, and from the head what a reader must know of them."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.export.volumetric import Axis, Table

_HEADER = [
    "axis",
    "joint",
    "position",
    "unit",
    *(f"E{d} [um]" for d in "XYZ"),
    *(f"E{d} [urad]" for d in "ABC"),
]
_MICRO = 1e-6 * np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
"""um and urad in mm and rad."""
Rows = dict[str, Array]
"""Positions (mm, deg) and errors (mm, rad) of axes by letter, (k, 7)."""


def read_table(text: str, joints: Sequence[str]) -> Table:
    """Return the table of a text, either format, of a machine whose joints from the base to the tool are ``joints``.

    Raises InputError where a line is not as the format has it.
    """
    mark = "// " if text.startswith("//") else "# "
    head = [line.removeprefix(mark) for line in text.splitlines() if line.startswith(mark)]
    body = [line for line in text.splitlines() if not line.startswith(mark)]
    rows = _read_blocks(body) if mark == "// " else _read_rows(body)
    chain, starts = _line_after(head, "axes from the base to the tool: "), _line_after(head, "reference: ")
    axes = []
    for joint in joints:
        name = re.escape(" ".join(joint.split()))
        letter, way, chain = _take_next(chain, rf"([XYZABC]) \({name}(, reversed)?\)")
        value, unit, starts = _take_next(starts, rf"{name} (\S+) (mm|deg)")
        turns = unit == "deg"
        sign, scale = (-1.0 if way else 1.0), (np.pi / 180.0 if turns else 1.0)
        table = rows[letter] if mark == "# " or sign > 0 else rows[letter][::-1] * [-1.0, *[1.0] * 6]
        centre = (
            _read_point(_line_after(head, f"axis {letter} turns about a line through "))
            if turns
            else np.zeros(3)
        )
        where = (centre, scale * float(value), scale * table[:, 0], table[:, 1:])
        axes.append(Axis(letter, joint, "rad" if turns else "mm", sign, *where))
    home = np.eye(4)
    placed = _line_after(head, "T(reference), tool in the base, rows of [R|p], mm: ")
    home[:3] = [[float(v) for v in row.split()] for row in placed.split(";")]
    return Table(tuple(axes), home, (0.0, 0.0), (0.0, 0.0), {})


def _read_rows(body: Sequence[str]) -> Rows:
    header, *lines = csv.reader(body)
    if header != _HEADER:
        raise InputError(f"found the columns {', '.join(header)}, expected {', '.join(_HEADER)}")
    rows: dict[str, list[list[float]]] = {}
    for letter, _, position, _, *errors in lines:
        rows.setdefault(letter, []).append([float(v) for v in (position, *errors)])
    return {letter: np.array(table) * [1.0, *_MICRO] for letter, table in rows.items()}


def _read_blocks(body: Sequence[str]) -> Rows:
    out = {}
    for block in "\n".join(body).split("\n#\n"):
        header, *lines = [line.split("\t") for line in block.splitlines()]
        expected = [header[0], *(f"E{d}{header[0]}" for d in "XYZABC")]
        if header != expected:
            raise InputError(f"found the columns {' '.join(header)}, expected {' '.join(expected)}")
        out[header[0]] = np.array(lines, dtype=float)
    return out


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


def _read_point(text: str) -> Array:
    return np.array([float(v) for v in text.removesuffix(" mm").split()])
