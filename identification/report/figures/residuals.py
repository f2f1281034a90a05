"""Residuals against joints and logged drivers, before and after, and how they are distributed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from truepose.arrays import Array, Index, Mask
from truepose.identification.report.drivers import Column
from truepose.shown.chart import Axis, Bars, Chart, Layer, Level, Line, Marks, Shape, Tone

MOVES = 30_000
"""Most points of all panels together: a page stays below a megabyte."""
FEWEST = 150
"""Index that are drawn in any case, where there are as many."""
WIDEST = 4.5
"""Sigmas to which a histogram reaches."""
QUANTILES = 300
_SHAPES: dict[Tone, Shape] = {"before": "stroke", "after": "dot"}


@dataclass(frozen=True)
class Drawn:
    """A fit as residuals: its name, tone, residual (n, m) whitened, and rows (n,) that set the scale."""

    name: str
    tone: Tone
    residual: Array
    counts: Mask


def picked(rows: int, series: int) -> Index:
    """Index that are drawn, evenly spread, where each is drawn in so many series."""
    most = max(FEWEST, MOVES // max(series, 1))
    return np.arange(rows) if rows <= most else np.unique(np.linspace(0, rows - 1, most).astype(np.intp))


def row_sizes(residual: Array) -> Array:
    """(n,) rms of each row's whitened components; NaN where a row has none."""
    finite = np.isfinite(residual) & (residual != 0.0)  # a row that refers to itself reads nothing
    total = np.sum(np.where(finite, residual, 0.0) ** 2, axis=1)
    count = finite.sum(axis=1)
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def size_panels(columns: Sequence[Column], fits: Sequence[Drawn], rows: Index) -> list[Chart]:
    """One panel a driver: rms of each row's residual in sigma; rows off the scale stand at its top edge."""
    sizes = [row_sizes(fit.residual) for fit in fits]
    top = 1.08 * max(
        float(np.max(s[fit.counts & np.isfinite(s)], initial=1.0)) for s, fit in zip(sizes, fits, strict=True)
    )
    return [
        Chart(
            "",
            Axis(column.title),
            Axis("row's residual, rms [σ]", 0.0, top),
            [
                *(
                    Marks(column.values[rows], size[rows], fit.tone, fit.name, _SHAPES[fit.tone], by_row=True)
                    for size, fit in zip(sizes, fits, strict=True)
                ),
                Level(1.0, "y", "noise as stated"),
            ],
            told=_trend(column, sizes),
        )
        for column in columns
    ]


def component_panels(
    column: Column, groups: Mapping[str, Sequence[int]], fits: Sequence[Drawn], rows: Index
) -> list[Chart]:
    """Signed components against one driver, a panel an axis."""
    reach = max(_reach(fit.residual[fit.counts]) for fit in fits)
    dodge = 0.022 * float(np.ptp(column.values)) if len(np.unique(column.values)) <= 20 else 0.0
    out = []
    for name, channels in groups.items():
        layers: list[Layer] = [Level(0.0, "y", dashed=False)]
        for k, fit in enumerate(fits):
            x = column.values[rows] + (k - 0.5 * (len(fits) - 1)) * dodge
            shape = _SHAPES[fit.tone]
            layers += [
                Marks(x, fit.residual[rows, c], fit.tone, fit.name, shape, by_row=True) for c in channels
            ]
        out.append(Chart(name, Axis(column.title), Axis("residual [σ]", -reach, reach), layers))
    return out


def distribution(fits: Sequence[Drawn]) -> list[Chart]:
    """A histogram a fit beside the normal curve, and the normal plot of all fits."""
    charts = [_histogram(fit) for fit in fits]
    reach = 4.0
    layers: list[Layer] = [
        Line(np.array([-3.5, 3.5]), np.array([-3.5, 3.5]), "ink", "normal, as stated", dashed=True)
    ]
    for fit in fits:
        values = np.sort(_values(fit))
        if values.size:
            share = (np.arange(values.size) + 0.5) / values.size
            at = np.unique(np.linspace(0, values.size - 1, min(QUANTILES, values.size)).astype(np.intp))
            layers.append(Marks(ndtri(share[at]), values[at], fit.tone, fit.name, _SHAPES[fit.tone]))
            reach = max(reach, min(1.05 * float(np.max(np.abs(values))), 12.0))
    told = "On the dashed line residuals are normal with the stated sigma; steeper is noisier, bent ends are outliers."
    axis = Axis("residual [σ]", -reach, reach)
    return [*charts, Chart("normal plot", Axis("normal quantile [σ]", -3.6, 3.6), axis, layers, told=told)]


def _histogram(fit: Drawn) -> Chart:
    values = np.clip(_values(fit), -WIDEST, WIDEST)
    edges = np.linspace(-WIDEST, WIDEST, 37 if values.size > 400 else 19)
    count, _ = np.histogram(values, edges)
    density = count / max(values.size, 1) / np.diff(edges)
    x = np.linspace(-WIDEST, WIDEST, 91)
    normal = Line(x, np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi), "ink", "normal, as stated", dashed=True)
    layers: list[Layer] = [Bars(density, fit.tone, fit.name, edges=edges), normal]
    return Chart(f"histogram, {fit.name}", Axis("residual [σ]"), Axis("density [1/σ]", 0.0), layers)


def _values(fit: Drawn) -> Array:
    """Residuals of the rows that count; a reading that was lost, or refers to itself, is none."""
    own = fit.residual[fit.counts]
    return np.asarray(own[np.isfinite(own) & (own != 0.0)])


def _trend(column: Column, sizes: Sequence[Array]) -> str:
    """How the size of residuals goes with a driver, for those who do not see the chart."""
    said = []
    for name, size in zip(("first", "second"), sizes, strict=False):
        ok = np.isfinite(size) & np.isfinite(column.values)
        if ok.sum() > 2 and np.ptp(column.values[ok]) > 0 and np.ptp(size[ok]) > 0:
            said.append(f"{name} series: correlation {np.corrcoef(column.values[ok], size[ok])[0, 1]:.2f}")
    return "; ".join(said)


def _reach(residual: Array) -> float:
    values = np.abs(residual[np.isfinite(residual)])
    return max(3.5, 1.05 * float(np.max(values, initial=0.0)))
