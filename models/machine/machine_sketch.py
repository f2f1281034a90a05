"""A machine at home, drawn by the lines of its skeleton, seen from the side and a little from above."""

from __future__ import annotations

import numpy as np

from truepose.arrays import Array
from truepose.errors import TrueposeError
from truepose.models.machine.machine import Machine
from truepose.models.machine.skeleton import Kind, at_home
from truepose.shown.drawing import Segment, lines

_TURN, _RISE = np.radians(-35.0), np.radians(20.0)
_SHOWN: dict[str, tuple[Kind, ...]] = {
    "links": ("link", "plate", "rail"),
    "legs": ("leg",),
    "tool": ("tool",),
}


def sketch(machine: Machine) -> str:
    """SVG of the links, legs and tool; empty where the machine cannot be assembled at home."""
    try:
        ends = segments(machine)
    except TrueposeError:
        return ""
    drawn = {name: [_seen(a, b) for a, b in found] for name, found in ends.items()}
    return lines(drawn, title=f"{machine.name} at home")


def segments(machine: Machine) -> dict[str, Array]:
    """Ends (k, 2, 3), mm, in the base's frame, of ``links``, ``legs`` and the ``tool`` at the machine's home."""
    found = at_home(machine)
    out = {}
    for name, kinds in _SHOWN.items():
        pairs = [pair for kind in kinds for line in found.get(kind, []) for pair in _pairs(kind, line)]
        out[name] = np.array(pairs).reshape(-1, 2, 3)
    return out


def _pairs(kind: Kind, line: Array) -> list[Array]:
    """The segments of a line, each once, without those of no length."""
    closed = np.vstack([line, line[:1]]) if kind == "plate" else line
    return [pair for pair in np.stack([closed[:-1], closed[1:]], axis=1) if np.ptp(pair, axis=0).any()]


def _seen(a: Array, b: Array) -> Segment:
    return _projected(a), _projected(b)


def _projected(point: Array) -> tuple[float, float]:
    x, y, z = (float(value) for value in point)
    across, away = (
        x * np.cos(_TURN) - y * np.sin(_TURN),
        x * np.sin(_TURN) + y * np.cos(_TURN),
    )
    return float(across), float(z * np.cos(_RISE) + away * np.sin(_RISE))
