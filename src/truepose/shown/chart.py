"""What a chart holds, free of any form: two axes and layers of marks, lines and bands.

``truepose.shown.chart_svg`` draws it. A tone is the name of a colour that the page's style sheet defines: ``before``,
``after``, ``free``, ``accent``, ``ink``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from truepose.arrays import Array

Tone = Literal["before", "after", "free", "accent", "ink"]
Shape = Literal["dot", "stroke", "ring", "tick"]


@dataclass(frozen=True)
class Axis:
    """An axis: title with unit, ends (None: those of the data), or names in place of numbers."""

    title: str
    low: float | None = None
    high: float | None = None
    names: Sequence[str] = ()


@dataclass(frozen=True)
class Marks:
    """Points (n,). ``by_row``: the k-th point is of the k-th row of the page."""

    x: Array
    y: Array
    tone: Tone
    name: str = ""
    shape: Shape = "dot"
    by_row: bool = False


@dataclass(frozen=True)
class Line:
    """A line through points (n,); it breaks where one is not finite."""

    x: Array
    y: Array
    tone: Tone
    name: str = ""
    dashed: bool = False


@dataclass(frozen=True)
class Band:
    """What lies between ``low`` and ``high`` (n,)."""

    x: Array
    low: Array
    high: Array
    tone: Tone
    name: str = ""


@dataclass(frozen=True)
class Level:
    """A straight line across the chart, at a value of one axis."""

    value: float
    axis: Literal["x", "y"]
    name: str = ""
    dashed: bool = True
    tone: Tone = "ink"


Layer = Marks | Line | Band | Level


@dataclass(frozen=True)
class Chart:
    """One panel. ``title`` stands above it."""

    title: str
    x: Axis
    y: Axis
    layers: Sequence[Layer] = field(default_factory=tuple)
    height: float = 230.0


def legend(charts: Sequence[Chart]) -> list[tuple[str, str, str]]:
    """Tone, shape and name of what the charts show, each once: for a legend that they share."""
    found: dict[str, tuple[str, str, str]] = {}
    for chart in charts:
        for layer in chart.layers:
            if layer.name:
                found.setdefault(layer.name, (layer.tone, _glyph(layer), layer.name))
    return list(found.values())


def _glyph(layer: Layer) -> str:
    if isinstance(layer, Marks):
        return layer.shape
    if isinstance(layer, (Line, Level)):
        return "dash" if layer.dashed else "line"
    return "area"
