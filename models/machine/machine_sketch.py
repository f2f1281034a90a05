"""A machine at home, drawn by the lines of its skeleton, seen from the side and a little from above."""

from __future__ import annotations

import numpy as np

from truepose.arrays import Array
from truepose.errors import TrueposeError
from truepose.models.machine.machine import Machine
from truepose.models.machine.skeleton import Kind, at_home
from truepose.shown.chart import Axis, Chart, Line, Tone

_TURN, _RISE = np.radians(-35.0), np.radians(20.0)
_SHOWN: dict[str, tuple[Tone, tuple[Kind, ...]]] = {
    "links": ("ink", ("link", "plate", "rail")),
    "legs": ("after", ("leg",)),
    "tool": ("before", ("tool",)),
}
HEIGHT, PLOT = 300.0, (320.0, 240.0)
"""Of the chart, and of what its axes leave, about, in pixels: a millimetre is as long upwards as across."""


def sketch(machine: Machine) -> list[Chart]:
    """Links, legs and tool; nothing where the machine cannot be assembled at home."""
    try:
        ends = segments(machine)
    except TrueposeError:
        return []
    seen = {name: _seen(found) for name, found in ends.items() if len(found)}
    if not seen:
        return []
    every = np.concatenate(list(seen.values())).reshape(-1, 2)
    low, high = every.min(axis=0), every.max(axis=0)
    scale = max(float(np.max((high - low) / PLOT)), 1e-9)
    (x, y), (wide, tall) = 0.5 * (low + high), (0.55 * scale * size for size in PLOT)
    layers = []
    for name, lines in seen.items():
        broken = np.insert(lines, 2, np.nan, axis=1).reshape(-1, 2)
        layers.append(Line(broken[:, 0], broken[:, 1], _SHOWN[name][0], name))
    axes = Axis("across [mm]", x - wide, x + wide), Axis("up [mm]", y - tall, y + tall)
    return [Chart(f"{machine.name} at home", *axes, layers, height=HEIGHT)]


def segments(machine: Machine) -> dict[str, Array]:
    """Ends (k, 2, 3), mm, in the base's frame, of ``links``, ``legs`` and the ``tool`` at the machine's home."""
    found = at_home(machine)
    out = {}
    for name, (_, kinds) in _SHOWN.items():
        pairs = [pair for kind in kinds for line in found.get(kind, []) for pair in _pairs(kind, line)]
        out[name] = np.array(pairs).reshape(-1, 2, 3)
    return out


def _pairs(kind: Kind, line: Array) -> list[Array]:
    """The segments of a line, each once, without those of no length."""
    closed = np.vstack([line, line[:1]]) if kind == "plate" else line
    return [pair for pair in np.stack([closed[:-1], closed[1:]], axis=1) if np.ptp(pair, axis=0).any()]


def _seen(points: Array) -> Array:
    """(k, 2, 2) points as they are seen."""
    x, y, z = np.moveaxis(points, -1, 0)
    across, away = x * np.cos(_TURN) - y * np.sin(_TURN), x * np.sin(_TURN) + y * np.cos(_TURN)
    return np.stack([across, z * np.cos(_RISE) + away * np.sin(_RISE)], axis=-1)
