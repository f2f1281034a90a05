"""Charts as SVG: one picture a panel, so that a page sets them side by side or below each other and texts keep their size.

Colours are classes that the page's style sheet defines, for light, dark and print. Points of a series are one path, which
keeps a page of thousands of them small; a script finds the k-th point as the k-th move of the path. Same chart, same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from truepose.arrays import Array
from truepose.shown.chart import Axis, Band, Chart, Layer, Level, Line, Marks
from truepose.shown.text import printable

ROOM = 0.04
"""What is left free beyond the data, as a share of the range."""
LARGEST, SMALLEST = 1e300, 1e-290
"""Sizes within which an axis is drawn: beyond them a range or a step is no number any more."""
NARROWEST = 1e-11
"""A range that is a smaller share of its values is rounding: it is drawn as one value."""


@dataclass(frozen=True)
class Scale:
    """From values between ``low`` and ``high`` to pixels between ``start`` and ``end``."""

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        """Pixels of a value."""
        return self.start + (self.end - self.start) * (value - self.low) / (self.high - self.low)

    def all(self, values: Array) -> Array:
        """(n,) pixels of values."""
        return np.asarray(self.start + (self.end - self.start) * (values - self.low) / (self.high - self.low))


def ends(values: Iterable[Array], low: float | None, high: float | None) -> tuple[float, float]:
    """Ends of an axis that shows all finite values, unless they are given; never the same twice."""
    known = [v[np.abs(v) <= LARGEST] for v in values]
    joined = np.concatenate(known) if known else np.zeros(0)
    first, last = (float(joined.min()), float(joined.max())) if joined.size else (0.0, 1.0)
    low, high = (end if end is not None and abs(end) <= LARGEST else None for end in (low, high))
    room = ROOM * (last - first)
    first, last = first - room if low is None else low, last + room if high is None else high
    if not last - first > max(NARROWEST * max(abs(first), abs(last)), SMALLEST):
        middle = first if high is None or low is not None else high
        half = 0.5 * abs(middle) if abs(middle) > SMALLEST else 0.5
        first, last = middle - half, middle + half
    return first, last


def ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Round numbers within the ends, one more than ``most`` at most, as they are written."""
    raw = (high - low) / max(most, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= raw * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    values = [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]
    return [(value, written(value, step)) for value in values]


def written(value: float, step: float) -> str:
    """A tick's number with as many decimals as its step needs: no two neighbours look alike."""
    if value == 0.0:
        return "0"
    size, place = max(abs(value), step), math.floor(math.log10(step) + 1e-9)
    if (size >= 1e5 and step >= 1e3) or (size < 1e-2 and step < 1e-4):
        digits = max(math.floor(math.log10(size)) - place + 1, 2)
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}".replace("-", "\u2212")
    places = max(0, -place)
    text = f"{value:.{places + 1}f}"
    text = text[:-1] if text.endswith("0") else text
    return text.rstrip(".").replace("-", "\u2212")


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
