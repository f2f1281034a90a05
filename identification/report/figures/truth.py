"""Truth beside what was found (bundled demonstrations only)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose.arrays import Array
from truepose.identification.report.figures.effects import matrix
from truepose.shown.chart import Axis, Chart, Layer, Line, Marks, Shape, Tone

Departed = tuple[str, Tone, Array]


def matrices(true: Array, found: Array, rows: Sequence[str], columns: Sequence[str]) -> list[Chart]:
    """True matrix (r, c), estimated matrix (r, c) and their difference, in thousandths."""
    titles = ("truth", "estimate", "estimate less truth")
    axes = ("actuator that travels [1]", "end that moves [10⁻³]")
    pairs = zip(titles, (true, found, found - true), strict=True)
    return [matrix(title, 1e3 * values, rows, columns, axes) for title, values in pairs]


def departures(true: Array, fits: Sequence[Departed]) -> Chart:
    """True departure (n,) from the drawing against the estimated one (n,) of each fit, in tolerances."""
    reach = 1.1 * max(1.0, *(float(np.max(np.abs(v), initial=0.0)) for v in (true, *(f[2] for f in fits))))
    ends = np.array([-reach, reach])
    layers: list[Layer] = [Line(ends, ends, "ink", "estimate = truth", dashed=True)]
    shapes: tuple[Shape, Shape] = ("ring", "dot")
    layers += [
        Marks(true, values, tone, name, shape)
        for (name, tone, values), shape in zip(fits, shapes, strict=False)
    ]
    side = 1.1 * max(float(np.max(np.abs(true), initial=1.0)), 1.0)
    x = Axis("true departure from the drawing [tolerances]", -side, side)
    return Chart("", x, Axis("estimated departure [tolerances]", -reach, reach), layers, height=280.0)
