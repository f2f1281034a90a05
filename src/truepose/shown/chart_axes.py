"""The axes of a chart as SVG: how long they are, where their ticks stand, and names that have room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from truepose.arrays import Array
from truepose.shown.chart import Axis, Band, Chart, Layer, Level, Line, Marks
from truepose.shown.scale import Scale, ends, ticks
from truepose.shown.text import printable

WIDTH = 380.0
LETTER = 6.6
"""Width of a letter, about, at the font's 12 px."""
TOP, BOTTOM, RIGHT = 14.0, 44.0, 14.0
NAME = 30
"""Most letters of a name beside an axis."""


@dataclass(frozen=True)
class Frame:
    """Where values of both axes stand."""

    x: Scale
    y: Scale


def frame_of(chart: Chart) -> Frame:
    xs, ys = _values(chart.layers, "x"), _values(chart.layers, "y")
    low, high = _ends(chart.y, ys)
    if chart.y.names:
        low, high = high, low  # the first name stands on top
    labels = [text for _, text in _y_ticks(chart.y, low, high, chart.height)]
    left = 26.0 + LETTER * max((min(len(text), NAME) for text in labels), default=1)
    across = Scale(*_ends(chart.x, xs), left, WIDTH - RIGHT)
    return Frame(across, Scale(low, high, chart.height - BOTTOM, TOP))


def _ends(axis: Axis, values: Sequence[Array]) -> tuple[float, float]:
    if axis.names:
        return (-0.5, len(axis.names) - 0.5)
    return ends(values, axis.low, axis.high)


def _values(layers: Sequence[Layer], axis: str) -> list[Array]:
    """What an axis has to show."""
    out: list[Array] = []
    for layer in layers:
        if isinstance(layer, Marks | Line):
            out.append(layer.x if axis == "x" else layer.y)
        elif isinstance(layer, Band):
            out += [layer.x] if axis == "x" else [layer.low, layer.high]
        elif isinstance(layer, Level) and layer.axis == axis:
            out.append(np.array([layer.value]))
    return out


def _y_ticks(axis: Axis, low: float, high: float, height: float) -> list[tuple[float, str]]:
    if axis.names:
        return [(float(k), _short(name)) for k, name in enumerate(axis.names)]
    return ticks(low, high, max(3, int(height / 45)))


def axes(chart: Chart, frame: Frame) -> list[str]:
    x, y = frame.x, frame.y
    out = [f'<path class="axis" d="M{x.start:.1f} {y.end:.1f}V{y.start:.1f}H{x.end:.1f}"/>']
    for value, text in _y_ticks(chart.y, y.low, y.high, chart.height):
        at = y.at(value)
        if not chart.y.names:
            out.append(f'<path class="grid" d="M{x.start:.1f} {at:.1f}H{x.end:.1f}"/>')
        out.append(label(x.start - 6, at + 4, text, "end"))
    out += _below(frame)
    middle = 0.5 * (y.start + y.end)
    if chart.y.title:
        turn = f'transform="translate(11 {middle:.1f}) rotate(-90)" text-anchor="middle"'
        out.append(f'<text class="name" {turn}>{escape(printable(chart.y.title))}</text>')
    out.append(label(0.5 * (x.start + x.end), chart.height - 5, chart.x.title, "middle", "name"))
    return out


def _below(frame: Frame) -> list[str]:
    """Draw the ticks of the axis across."""
    out = []
    for value, text in _fitting(frame.x):
        at, half = frame.x.at(value), 0.5 * LETTER * len(text)
        out.append(f'<path class="grid" d="M{at:.1f} {frame.y.end:.1f}V{frame.y.start:.1f}"/>')
        out.append(label(min(at, WIDTH - half - 1), frame.y.start + 16, text, "middle"))
    return out


def _fitting(x: Scale) -> list[tuple[float, str]]:
    """As many ticks as have room for their numbers."""
    for most in (8, 7, 6, 5, 4, 3, 2):
        found = ticks(x.low, x.high, most)
        widest = max((len(text) for _, text in found), default=1)
        step = (found[1][0] - found[0][0]) if len(found) > 1 else x.high - x.low
        if (widest + 1.5) * LETTER < abs(x.at(x.low + step) - x.start):
            return found
    return found


def _short(name: str) -> str:
    return name if len(name) <= NAME else f"{name[: NAME - 1]}\u2026"


def label(x: float, y: float, text: str, anchor: str, kind: str = "") -> str:
    own = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{own}>{escape(printable(text))}</text>'
