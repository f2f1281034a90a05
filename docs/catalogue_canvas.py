"""The paper that the catalogue's drawings are made on: 160 by 90, thin strokes, colours that show on white and on black.

Grey is the machine as drawn, blue what it really does, orange the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Point = tuple[float, float]
WIDTH, HEIGHT = 160, 90
DRAWN, REAL, ERROR = "#808080", "#0072B2", "#D55E00"
"""Mid-grey, and blue and vermillion of Okabe and Ito."""
FRAME: Final = (16.0, 148.0, 78.0, 12.0)
"""Left, right, bottom and top of a curve."""


class Canvas:
    """Strokes of one drawing. Lengths are in its units, y points down."""

    def __init__(self) -> None:
        self.parts: list[str] = []

    def line(
        self,
        *points: Point,
        colour: str = REAL,
        width: float = 1.6,
        dashed: bool = False,
        closed: bool = False,
    ) -> None:
        """Straight strokes from point to point."""
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + ("Z" if closed else "")
        dash = ' stroke-dasharray="4 3"' if dashed else ""
        self.parts.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"{dash}/>')

    def box(
        self, x: float, y: float, width: float, height: float, colour: str = DRAWN, *, dashed: bool = False
    ) -> None:
        """A rectangle from its upper left corner."""
        corners = ((x, y), (x + width, y), (x + width, y + height), (x, y + height))
        self.line(*corners, colour=colour, width=1.2, dashed=dashed, closed=True)

    def circle(self, x: float, y: float, r: float, colour: str = DRAWN, *, dashed: bool = False) -> None:
        dash = ' stroke-dasharray="4 3"' if dashed else ""
        at = f'cx="{x:.1f}" cy="{y:.1f}" r="{r:g}"'
        self.parts.append(f'<circle {at} fill="none" stroke="{colour}" stroke-width="1.4"{dash}/>')

    def dot(self, x: float, y: float, colour: str = REAL, r: float = 2.2) -> None:
        self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:g}" fill="{colour}"/>')

    def arc(
        self,
        x: float,
        y: float,
        r: float,
        ends: tuple[float, float],
        colour: str = ERROR,
        *,
        arrow: bool = True,
    ) -> None:
        """Part of a circle between two angles in degrees, counted clockwise from the right, with an arrow at its end."""
        turn = np.radians(np.linspace(*ends, 40))
        points = [(x + r * float(np.cos(t)), y + r * float(np.sin(t))) for t in turn]
        self.line(*points, colour=colour)
        if arrow:
            self._tip(points[-1], np.subtract(points[-1], points[-6]), colour)

    def arrow(self, start: Point, end: Point, colour: str = ERROR, *, both: bool = False) -> None:
        """A straight arrow; ``both`` with a tip at either end."""
        way = np.subtract(end, start)
        self.line(start, end, colour=colour, width=1.4)
        self._tip(end, way, colour)
        if both:
            self._tip(start, -way, colour)

    def text(self, x: float, y: float, text: str, colour: str = DRAWN, anchor: str = "middle") -> None:
        style = f'fill="{colour}" text-anchor="{anchor}" font-family="sans-serif" font-size="9"'
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" {style}>{escape(text)}</text>')

    def axes(self, across: str, up: str, *, zero: float = FRAME[2]) -> None:
        """Axes of a curve with the names of what they count; ``zero``: height of the horizontal one."""
        left, right, bottom, top = FRAME
        self.line((left, bottom + 2), (left, top - 6), colour=DRAWN, width=0.9)
        self.line((left - 2, zero), (right + 6, zero), colour=DRAWN, width=0.9)
        self.text(right + 6, HEIGHT - 2, across, anchor="end")
        self.text(left + 4, top - 2, up, anchor="start")

    def hatch(self, left: float, right: float, y: float) -> None:
        """The ground."""
        self.line((left, y), (right, y), colour=DRAWN, width=1.2)
        for x in np.arange(left + 5, right + 1, 8.0):
            self.line((float(x), y), (float(x) - 5, y + 5), colour=DRAWN, width=0.8)

    def svg(self, title: str) -> str:
        """The file."""
        size = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" stroke-linecap="round" stroke-linejoin="round">'
        return "\n".join([head, f"<title>{escape(title)}</title>", *self.parts, "</svg>", ""])

    def _tip(self, end: Point, way: Sequence[float] | Array, colour: str) -> None:
        along = np.asarray(way, dtype=float) / max(float(np.hypot(*way)), 1e-9)
        across = np.array([-along[1], along[0]])
        corners = [np.asarray(end), *(np.asarray(end) - 5 * along + side * 2.2 * across for side in (1, -1))]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        self.parts.append(f'<polygon points="{points}" fill="{colour}"/>')


def fitted(
    x: Array, y: Array, ends: tuple[float, float, float, float] = FRAME, over: Array | None = None
) -> list[Point]:
    """Points of a curve, scaled into left, right, bottom, top; ``over``: heights that span the frame where not its own."""
    left, right, bottom, top = ends
    span = y if over is None else over
    low, high = float(span.min()), float(span.max())
    across = left + (x - x.min()) / (float(np.ptp(x)) or 1.0) * (right - left)
    up = bottom - (y - low) / ((high - low) or 1.0) * (bottom - top)
    return [(float(a), float(b)) for a, b in zip(across, up, strict=True)]
