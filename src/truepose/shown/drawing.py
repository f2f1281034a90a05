"""Small pictures as inline SVG, in the notebook's own text colour: bars, dots, strips and lines.

Use ``bars`` for a few named numbers, ``dots`` for numbers by row before and after something, ``strips`` for where values
lie in their ranges, ``lines`` for a machine drawn by its axes. Same numbers, same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

from truepose.shown.view import printable

WIDTH = 560.0
LABEL = 170.0
ROW = 18.0
MOST = 300
"""Marks of a kind that a picture has at most; of more, every so many-th is drawn."""
BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
"""Okabe and Ito's, told apart by the colour-blind; they show on white and on black."""
Segment = tuple[tuple[float, float], tuple[float, float]]


def bars(values: Mapping[str, float], *, title: str, limit: float | None = None) -> str:
    """Horizontal bars from 0; ``limit``: a size that is marked on both sides, such as 1 tolerance."""
    finite = {name: value for name, value in values.items() if math.isfinite(value)}
    top = 1.08 * max([abs(v) for v in finite.values()] + [limit or 0.0], default=0.0) or 1.0
    signed = any(v < 0 for v in finite.values())
    zero, half = (0.5 * (LABEL + WIDTH), 0.5 * (WIDTH - LABEL)) if signed else (LABEL, WIDTH - LABEL - 60.0)
    half -= 60.0 if signed else 0.0
    parts = []
    for k, (name, value) in enumerate(finite.items()):
        y, long = ROW * (k + 1.5), half * (value / top)
        x = zero + min(long, 0.0)
        parts.append(_label(name, y))
        parts.append(
            f'<rect x="{x:.1f}" y="{y - 5:.1f}" width="{max(abs(long), 0.5):.1f}" height="10" fill="{BLUE}"/>'
        )
        end = zero + long + (4 if value >= 0 else -4)
        parts.append(_text(end, y + 4, f"{value:.3g}", "start" if value >= 0 else "end"))
    height = ROW * (len(finite) + 1.5)
    for side in ([1.0, -1.0] if signed else [1.0]) if limit else []:
        x = zero + side * half * ((limit or 0.0) / top)
        parts.append(_rule(x, ROW, x, height - 5, dashed=True))
    parts.append(_rule(zero, ROW, zero, height - 5))
    return _svg(height, title, parts)


def dots(series: Mapping[str, Sequence[float]], *, title: str) -> str:
    """Numbers by row, one colour a series, on a logarithmic scale; not finite and not positive ones are left out."""
    sizes = [v for values in series.values() for v in values if math.isfinite(v) and v > 0]
    low, high = _decades(sizes)
    height, left, right, floor = 190.0, 60.0, WIDTH - 10, 165.0
    count = max((len(values) for values in series.values()), default=0)

    def at(k: int, value: float) -> tuple[float, float]:
        x = left + (right - left) * (k + 0.5) / max(count, 1)
        return x, floor - (floor - 30.0) * max(math.log10(value) - low, 0.0) / (high - low)

    parts = [_rule(left, floor, right, floor), _rule(left, 30.0, left, floor)]
    for decade in range(low, high + 1):
        y = floor - (floor - 30.0) * (decade - low) / (high - low)
        parts.append(_text(left - 5, y + 4, f"1e{decade}" if abs(decade) > 3 else f"{10.0**decade:g}", "end"))
    for number, (name, values) in enumerate(series.items()):
        colour = (ORANGE, BLUE, GREEN)[number % 3]
        step = max(1, -(-len(values) // MOST))
        marks = [
            "M{:.1f} {:.1f}h0".format(*at(k, v))
            for k, v in enumerate(values)
            if k % step == 0 and math.isfinite(v) and v > 0
        ]
        parts.append(
            f'<path d="{"".join(marks)}" stroke="{colour}" stroke-width="5" stroke-linecap="round" fill="none"/>'
        )
        parts.append(_text(left + 10 + 120 * number, height - 6, name, "start", colour))
    parts.append(_text(right, height - 6, "row", "end"))
    return _svg(height, title, parts)


def strips(
    values: Mapping[str, Sequence[float]], ends: Mapping[str, tuple[float, float]], *, title: str
) -> str:
    """A line for each name with a tick for each value, between the ends of its range (written beside it by ``ends``)."""
    parts, left, right = [], LABEL, WIDTH - 70.0
    for k, (name, seen) in enumerate(values.items()):
        y, (low, high) = ROW * (k + 1.5), ends[name]
        wide = high - low or 1.0
        step = max(1, -(-len(seen) // MOST))
        ticks = "".join(
            f"M{left + (right - left) * ((v - low) / wide):.1f} {y - 6:.1f}v12"
            for v in list(seen)[::step]
            if math.isfinite(v)
        )
        parts += [_label(name, y), _rule(left, y, right, y)]
        parts.append(f'<path d="{ticks}" stroke="{BLUE}" stroke-width="1.5" fill="none"/>')
        parts.append(_text(right + 5, y + 4, f"{low:.4g} .. {high:.4g}", "start"))
    return _svg(ROW * (len(values) + 1.0), title, parts, width=WIDTH + 60.0)


def lines(groups: Mapping[str, Sequence[Segment]], *, title: str, height: float = 240.0) -> str:
    """Segments in the plane (y upwards), scaled to fit; one colour a group, with a dot at each end."""
    points = [point for segments in groups.values() for segment in segments for point in segment]
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    if not points or max(xs) - min(xs) + max(ys) - min(ys) == 0.0:
        return ""
    wide, tall = WIDTH - 120.0, height - 60.0
    size = max((max(xs) - min(xs)) / wide, (max(ys) - min(ys)) / tall) or 1.0
    mid = 0.5 * (max(xs) + min(xs)), 0.5 * (max(ys) + min(ys))

    def at(point: tuple[float, float]) -> tuple[float, float]:
        return WIDTH / 2 + (point[0] - mid[0]) / size, height / 2 + 5 - (point[1] - mid[1]) / size

    parts = []
    for number, (name, segments) in enumerate(groups.items()):
        if not segments:
            continue
        colour = ("currentColor", BLUE, ORANGE)[number % 3]
        path = "".join("M{:.1f} {:.1f}L{:.1f} {:.1f}".format(*at(a), *at(b)) for a, b in segments)
        parts.append(f'<path d="{path}" stroke="{colour}" stroke-width="2.5" fill="none"/>')
        ends = "".join("M{:.1f} {:.1f}h0".format(*at(p)) for segment in segments for p in segment)
        parts.append(
            f'<path d="{ends}" stroke="{colour}" stroke-width="6" stroke-linecap="round" fill="none"/>'
        )
        parts.append(_text(10 + 110.0 * number, height - 6, name, "start", colour))
    return _svg(height, title, parts)


def _decades(sizes: Sequence[float]) -> tuple[int, int]:
    if not sizes:
        return 0, 1
    low, high = math.floor(math.log10(min(sizes))), math.ceil(math.log10(max(sizes)))
    return max(low, high - 6), max(high, low + 1)


def _label(name: str, y: float) -> str:
    short = name if len(name) <= 26 else name[:23] + "..."
    return _text(LABEL - 8, y + 4, short, "end")


def _text(x: float, y: float, text: str, anchor: str, colour: str = "currentColor") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{escape(printable(text))}</text>'


def _rule(x1: float, y1: float, x2: float, y2: float, *, dashed: bool = False) -> str:
    dash = ' stroke-dasharray="4 3"' if dashed else ""
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="currentColor"'
        f' stroke-opacity="0.45"{dash}/>'
    )


def _svg(height: float, title: str, parts: Sequence[str], width: float = WIDTH) -> str:
    said = escape(printable(title))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{width:.0f}" height="{height + 16:.0f}"'
        f' viewBox="0 -16 {width:.0f} {height + 16:.0f}" style="max-width:100%" font-family="sans-serif"'
        f' font-size="11"><title>{said}</title>{_text(4, -3, title, "start")}{"".join(parts)}</svg>'
    )
