"""Charts as SVG: one picture a panel, so that a page sets them side by side or below each other and texts keep their size.

Colours are classes that the page's style sheet defines, for light, dark and print. Points of a series are one path, which
keeps a page of thousands of them small; a script finds the k-th point as the k-th move of the path. Same chart, same bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from html import escape

import numpy as np

from truepose.arrays import Array
from truepose.shown.chart import Band, Chart, Level, Line, Marks
from truepose.shown.chart_axes import WIDTH, Frame, axes, frame_of
from truepose.shown.text import printable

SIZE = {"dot": 4.5, "stroke": 2.0, "ring": 1.3, "tick": 1.2}
"""Width of the stroke that draws a mark, pixels."""
POINTS: dict[str, Callable[[float, float], str]] = {
    "dot": lambda x, y: f"M{x:.1f} {y:.1f}h0",
    "stroke": lambda x, y: f"M{x - 3:.1f} {y:.1f}h6",
    "tick": lambda x, y: f"M{x:.1f} {y:.1f}v-7",
    "ring": lambda x, y: f"M{x - 2.5:.1f} {y:.1f}a2.5 2.5 0 1 0 5 0a2.5 2.5 0 1 0-5 0",
}
"""Path of a mark at a place, pixels."""
FAR = 1e5
"""Pixels beyond which a point is drawn no farther away."""


@np.errstate(over="ignore", invalid="ignore")
def svg(chart: Chart) -> str:
    """Return the chart as one SVG element; numbers that no axis can hold are left out."""
    frame = frame_of(chart)
    below = sorted(chart.layers, key=lambda layer: not isinstance(layer, Level))
    drawn = [part for layer in below for part in _DRAWN[type(layer)](layer, frame)]
    title = escape(printable(f"{chart.title}: {chart.y.title} against {chart.x.title}"))
    return (
        f'<svg class="chart" role="img" viewBox="0 0 {WIDTH:.0f} {chart.height:.0f}"><title>{title}</title>'
        f"{''.join(axes(chart, frame))}{''.join(drawn)}</svg>"
    )


def _marks(layer: Marks, frame: Frame) -> list[str]:
    x, y = frame.x.all(layer.x), frame.y.all(layer.y)
    top, floor = frame.y.end, frame.y.start
    gone = ~(np.isfinite(x) & np.isfinite(y))
    x, y = np.where(gone, -99.0, x), np.where(gone, -99.0, np.clip(y, top, floor))
    path = "".join(map(POINTS[layer.shape], x.tolist(), y.tolist()))
    rows = ' data-rows=""' if layer.by_row else ""
    name = f' data-name="{escape(printable(layer.name))}"' if layer.by_row else ""
    return [
        f'<path class="marks {layer.shape} t-{layer.tone}"{rows}{name} stroke-width="{SIZE[layer.shape]}" d="{path}"/>'
    ]


def _line(layer: Line, frame: Frame) -> list[str]:
    dash = " dashed" if layer.dashed else ""
    return [
        f'<path class="line{dash} t-{layer.tone}" d="{_way(frame.x.all(layer.x), frame.y.all(layer.y))}"/>'
    ]


def _way(x: Array, y: Array) -> str:
    """Return a line through points, which breaks where one is not finite."""
    known = np.isfinite(x) & np.isfinite(y)
    begins = known & ~np.concatenate([[False], known[:-1]])
    letters = np.where(begins, "M", "L")[known]
    places = np.clip(np.stack([x, y], axis=1)[known], -FAR, FAR).tolist()
    return "".join(f"{letter}{a:.1f} {b:.1f}" for letter, (a, b) in zip(letters, places, strict=True))


def _band(layer: Band, frame: Frame) -> list[str]:
    """One area for each stretch of points that are known."""
    every = np.stack([frame.x.all(layer.x), frame.y.all(layer.low), frame.y.all(layer.high)])
    known = np.flatnonzero(np.isfinite(every).all(axis=0))
    if not len(known):
        return []
    ways = []
    for own in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        x, low, high = every[:, own]
        ways.append(f"{_way(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]))}Z")
    return [f'<path class="band t-{layer.tone}" d="{"".join(ways)}"/>']


def _level(layer: Level, frame: Frame) -> list[str]:
    """None where its value lies beyond the axis."""
    scale = frame.x if layer.axis == "x" else frame.y
    at = scale.at(layer.value)
    if not min(scale.start, scale.end) - 0.1 <= at <= max(scale.start, scale.end) + 0.1:
        return []
    if layer.axis == "x":
        way = f"M{at:.1f} {frame.y.start:.1f}V{frame.y.end:.1f}"
    else:
        way = f"M{frame.x.start:.1f} {at:.1f}H{frame.x.end:.1f}"
    dash = " dashed" if layer.dashed else ""
    return [f'<path class="level{dash} t-{layer.tone}" d="{way}"/>']


_DRAWN: dict[type, Callable[..., list[str]]] = {
    Marks: _marks,
    Line: _line,
    Band: _band,
    Level: _level,
}
