"""What a chart holds, free of any form: two axes and layers of marks, lines, bands, bars and cells.

``truepose.shown.chart_svg`` draws it. A tone is the name of a colour that the page's style sheet defines: ``before``,
``after``, ``free``, ``accent``, ``ink``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from truepose.arrays import Array

Tone = Literal["before", "after", "free", "accent", "ink", "l1", "l2", "l3", "l4"]
Shape = Literal["dot", "stroke", "ring", "tick"]
MOST = 300
"""Marks of a line of a picture for a notebook; of more, every so many-th is drawn."""


@dataclass(frozen=True)
class Axis:
    """An axis: title with unit, ends (None: those of the data), or names in place of numbers."""

    title: str
    low: float | None = None
    high: float | None = None
    names: Sequence[str] = ()


@dataclass(frozen=True)
class Marks:
    """Points (n,); ``error`` (n,) draws bars either side. ``by_row``: the k-th point is of the k-th row of the page."""

    x: Array
    y: Array
    tone: Tone
    name: str = ""
    shape: Shape = "dot"
    error: Array | None = None
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
class Bars:
    """Level bars from zero, at the names of the y axis (``at``, n), with texts at their ends."""

    length: Array
    at: Array
    tone: Tone
    name: str = ""
    texts: Sequence[str] = ()


@dataclass(frozen=True)
class Level:
    """A straight line across the chart, at a value of one axis."""

    value: float
    axis: Literal["x", "y"]
    name: str = ""
    dashed: bool = True
    tone: Tone = "ink"


@dataclass(frozen=True)
class Span:
    """A strip across the chart, between two values of the x axis."""

    low: float
    high: float
    tone: Tone
    name: str = ""


@dataclass(frozen=True)
class Cells:
    """A matrix (r, c) as coloured cells: rows are names of the y axis, columns of the x axis; ``texts`` stand in them."""

    values: Array
    texts: Sequence[Sequence[str]] = ()
    largest: float | None = None


Layer = Marks | Line | Band | Bars | Level | Span | Cells


@dataclass(frozen=True)
class Chart:
    """One panel. ``title`` stands above it, ``told`` is what a screen reader says of it beside."""

    title: str
    x: Axis
    y: Axis
    layers: Sequence[Layer] = field(default_factory=tuple)
    height: float = 230.0
    told: str = ""


def legend(charts: Sequence[Chart]) -> list[tuple[str, str, str]]:
    """Tone, shape and name of what the charts show, each once: for a legend that they share."""
    found: dict[str, tuple[str, str, str]] = {}
    for chart in charts:
        for layer in chart.layers:
            name = getattr(layer, "name", "")
            if name:
                found.setdefault(name, (layer_tone(layer), _glyph(layer), name))
    return list(found.values())


def layer_tone(layer: Layer) -> str:
    """The tone of a layer; cells have none of their own."""
    return getattr(layer, "tone", "ink")


def _glyph(layer: Layer) -> str:
    if isinstance(layer, Marks):
        return layer.shape
    if isinstance(layer, (Line, Level)):
        return "dash" if layer.dashed else "line"
    return "bar" if isinstance(layer, Bars) else "area"


def strips(
    values: Mapping[str, Sequence[float]], ends: Mapping[str, tuple[float, float, str]], title: str
) -> list[Chart]:
    """A line for each name with a tick for each value, between the ends of its range (with their unit)."""
    names = [f"{name} {low:.4g} .. {high:.4g} {unit}".rstrip() for name, (low, high, unit) in ends.items()]
    layers = []
    for k, (name, (low, high, _)) in enumerate(ends.items()):
        step = max(1, -(-len(values[name]) // MOST))
        x = (np.asarray(values[name], dtype=float)[::step] - low) / ((high - low) or 1.0)
        layers.append(Marks(x, np.full(len(x), k + 0.3), "after", shape="tick"))
    axes = Axis("share of the range [1]", -0.02, 1.02), Axis("", names=names)
    return [Chart(title, *axes, layers, height=62.0 + 17.0 * len(names))]
