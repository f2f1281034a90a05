"""What findings add to the machine: functions with their band and what the rows say of them, and matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose.arrays import Array
from truepose.identification.report.curves import Curve
from truepose.shown.chart import Axis, Band, Cells, Chart, Layer, Level, Line, Marks

COLUMNS_WITH_NUMBERS = 8
"""Columns of a matrix up to which its numbers stand in the cells."""
BAND = 1.96


def curve_charts(curves: Sequence[Curve]) -> list[Chart]:
    """A panel a function: what was identified, its 95 % band, and what each row says of it."""
    return [_curve(curve) for curve in curves]


def _curve(curve: Curve) -> Chart:
    layers: list[Layer] = [Level(0.0, "y", dashed=False)]
    if len(curve.x):
        low, high = curve.y - BAND * curve.std, curve.y + BAND * curve.std
        layers.append(Band(curve.x, low, high, "after", "95 % band"))
    low_y, high_y = None, None
    if curve.rows is not None:
        layers.append(Marks(curve.measured, curve.rows, "before", "each row", by_row=True))
        low_y, high_y = _shown(curve)
    if len(curve.x):
        layers.append(Line(curve.x, curve.y, "after", "identified"))
    if curve.fitted is not None:
        layers.append(Marks(curve.measured, curve.fitted, "after", "identified, in each row", by_row=True))
    if curve.rows is None:
        floor = np.full(len(curve.measured), float(np.min(curve.y - BAND * curve.std, initial=0.0)))
        layers.append(Marks(curve.measured, floor, "ink", "where it was measured", "tick"))
    return Chart(curve.title, Axis(curve.x_title), Axis(curve.y_title, low_y, high_y), layers)


def _shown(curve: Curve) -> tuple[float, float]:
    """Ends that show the function and all but the wildest rows."""
    assert curve.rows is not None
    known = curve.rows[np.isfinite(curve.rows)]
    ends = np.quantile(known, [0.01, 0.99]) if known.size else np.zeros(2)
    lowest = min(float(ends[0]), float(np.min(curve.y - BAND * curve.std, initial=0.0)))
    highest = max(float(ends[1]), float(np.max(curve.y + BAND * curve.std, initial=0.0)))
    room = 0.08 * (highest - lowest) or 1.0
    return lowest - room, highest + room


def matrix(
    title: str, values: Array, rows: Sequence[str], columns: Sequence[str], axes: tuple[str, str]
) -> Chart:
    """A matrix (r, c) as a heat map, with its numbers where there is room; ``axes``: titles across and up."""
    numbers = len(columns) <= COLUMNS_WITH_NUMBERS
    texts = [[f"{v:.2g}" for v in line] for line in values.tolist()] if numbers else []
    height = 70.0 + max(len(rows), 4) * (22.0 if numbers else 300.0 / max(len(rows), 12))
    cells = Cells(values, texts)
    return Chart(title, Axis(axes[0], names=columns), Axis(axes[1], names=rows), [cells], height=height)
