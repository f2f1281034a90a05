"""Small line and bar charts as SVG files, for the pages in ``docs/``: the same bytes from the same numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
COLOURS = ("#1f5fa8", "#c2452d", "#2f8f4e", "#8a5bb5", "#b8860b", "#444444")
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640, 340, 66, 14, 30, 46
RIGHT_LEGEND = 480


@dataclass(frozen=True)
class Series:
    """One curve: abscissae and ordinates (n,), a name for the legend, ``error`` (n,) half-lengths of bars."""

    name: str
    x: Sequence[float] | Array
    y: Sequence[float] | Array
    style: Literal["line", "points", "both", "none"] = "line"
    error: Sequence[float] | Array | None = None


def write_chart(
    path: Path,
    title: str,
    x_label: str,
    y_label: str,
    series: Sequence[Series],
    *,
    log_y: bool = False,
    legend_right: bool = False,
) -> None:
    """Draw the series on common linear axes (ordinates logarithmic on request) and write the SVG."""
    frame = _Frame.around(series, log_y)
    body = [_axes(frame, title, x_label, y_label)]
    for k, one in enumerate(series):
        body.append(_curve(frame, one, COLOURS[k % len(COLOURS)]))
    if len(series) > 1 or series[0].name:
        body.append(_legend([one.name for one in series], RIGHT_LEGEND if legend_right else LEFT))
    _write(path, body)


def write_bars(
    path: Path,
    title: str,
    y_label: str,
    groups: Sequence[str],
    series: Sequence[tuple[str, Sequence[float]]],
    *,
    room: float = 1.08,
) -> None:
    """Grouped bars: ``series`` holds a name and one value a group; the axis reaches ``room`` times the highest."""
    top = max(max(values) for _, values in series)
    frame = _Frame(0.0, float(len(groups)), 0.0, room * top, False)
    body = [_axes(frame, title, "", y_label, x_ticks=False)]
    wide = 0.8 / len(series)
    for k, (_, values) in enumerate(series):
        for g, value in enumerate(values):
            x0, x1 = frame.x(g + 0.1 + k * wide), frame.x(g + 0.1 + (k + 1) * wide)
            y0, y1 = frame.y(0.0), frame.y(value)
            body.append(
                f'<rect x="{x0:.1f}" y="{y1:.1f}" width="{x1 - x0 - 1:.1f}" height="{y0 - y1:.1f}" '
                f'fill="{COLOURS[k % len(COLOURS)]}"/>'
            )
    for g, name in enumerate(groups):
        body.append(_text(frame.x(g + 0.5), HEIGHT - BOTTOM + 16, name, "middle"))
    body.append(_legend([name for name, _ in series]))
    _write(path, body)


@dataclass(frozen=True)
class _Frame:
    x_low: float
    x_high: float
    y_low: float
    y_high: float
    log_y: bool

    @classmethod
    def around(cls, series: Sequence[Series], log_y: bool) -> _Frame:
        xs = np.concatenate([np.asarray(s.x, dtype=float) for s in series])
        low = [np.asarray(s.y, float) - (0.0 if s.error is None else np.asarray(s.error)) for s in series]
        high = [np.asarray(s.y, float) + (0.0 if s.error is None else np.asarray(s.error)) for s in series]
        y_low, y_high = float(np.concatenate(low).min()), float(np.concatenate(high).max())
        if log_y:
            positive = np.concatenate([np.asarray(s.y, float) for s in series])
            y_low = np.log10(max(y_low, 0.3 * float(positive[positive > 0].min())))
            y_high = np.log10(y_high)
        margin = 0.05 * ((y_high - y_low) or abs(y_high) or 1.0)
        x_low, x_high = float(xs.min()), float(xs.max())
        return cls(x_low, x_high if x_high > x_low else x_low + 1, y_low - margin, y_high + margin, log_y)

    def x(self, value: float) -> float:
        return LEFT + (value - self.x_low) / (self.x_high - self.x_low) * (WIDTH - LEFT - RIGHT)

    def y(self, value: float) -> float:
        if self.log_y:
            value = float(np.log10(max(value, 1e-300)))
        share = (value - self.y_low) / (self.y_high - self.y_low)
        return HEIGHT - BOTTOM - min(max(share, -0.02), 1.02) * (HEIGHT - TOP - BOTTOM)


def _ticks(low: float, high: float, log: bool) -> list[float]:
    if log:
        whole = range(int(np.ceil(low)), int(np.floor(high)) + 1)
        return [10.0**k for k in whole] or [10.0**low, 10.0**high]
    raw = (high - low) / 5
    step = 10 ** np.floor(np.log10(raw))
    step *= min((1, 2, 5, 10), key=lambda m: abs(m * step - raw))
    first = np.ceil(low / step)
    return [float(k * step) for k in np.arange(first, np.floor(high / step) + 1)]


def _axes(frame: _Frame, title: str, x_label: str, y_label: str, *, x_ticks: bool = True) -> str:
    out = [_text(WIDTH / 2, 18, title, "middle", 14)]
    for value in _ticks(frame.y_low, frame.y_high, frame.log_y):
        y = frame.y(value)
        out.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e4e4e4"/>')
        out.append(_text(LEFT - 6, y + 4, f"{value:g}", "end"))
    for value in _ticks(frame.x_low, frame.x_high, False) if x_ticks else ():
        x = frame.x(value)
        out.append(
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{HEIGHT - BOTTOM}" y2="{HEIGHT - BOTTOM + 4}" stroke="#666"/>'
        )
        out.append(_text(x, HEIGHT - BOTTOM + 17, f"{value:g}", "middle"))
    out.append(
        f'<rect x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" height="{HEIGHT - TOP - BOTTOM}" '
        'fill="none" stroke="#666"/>'
    )
    out.append(_text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 10, x_label, "middle"))
    turned = f'transform="rotate(-90 14 {HEIGHT / 2:.0f})"'
    out.append(_text(14, HEIGHT / 2, y_label, "middle", extra=turned))
    return "\n".join(out)


def _curve(frame: _Frame, one: Series, colour: str) -> str:
    points = [(frame.x(float(x)), frame.y(float(y))) for x, y in zip(one.x, one.y, strict=True)]
    out = []
    if one.style in ("line", "both"):
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        out.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.4"/>')
    if one.style in ("points", "both"):
        out += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.6" fill="{colour}"/>' for x, y in points]
    if one.error is not None:
        for (x, _), value, half in zip(points, one.y, one.error, strict=True):
            y0, y1 = frame.y(float(value) - float(half)), frame.y(float(value) + float(half))
            out.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{y0:.1f}" y2="{y1:.1f}" stroke="{colour}"/>')
    return "\n".join(out)


def _legend(names: Sequence[str], left: float = LEFT) -> str:
    out = []
    for k, name in enumerate(names):
        y = TOP + 16 + 16 * k
        out.append(
            f'<rect x="{left + 10}" y="{y - 8}" width="14" height="4" fill="{COLOURS[k % len(COLOURS)]}"/>'
        )
        out.append(_text(left + 30, y, name))
    return "\n".join(out)


def _text(x: float, y: float, text: str, anchor: str = "start", size: int = 11, extra: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" {extra}>{escape(text)}</text>'


def _write(path: Path, body: Sequence[str]) -> None:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'font-family="Helvetica, Arial, sans-serif">\n<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>'
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([head, *body, "</svg>"]) + "\n", encoding="utf-8")
