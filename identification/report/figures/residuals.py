"""Residuals against joints and logged drivers, before and after; functions that were identified."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from truepose.identification.report.curves import Curve
from truepose.identification.report.drivers import Column
from truepose.identification.report.figures import style

Array = NDArray[np.float64]
Fit = tuple[str, str, Array, NDArray[np.bool_]]  # name, colour, residual (n, m), rows that may set the scale
LARGEST = 2000
_COLUMNS = 3
_SYMBOLS = {style.BEFORE: "circle", style.AFTER: "circle-open"}


def thinned(n: int, limit: int = LARGEST) -> NDArray[np.intp]:
    """(k,) numbers of at most ``limit`` of n rows, evenly spread."""
    return np.arange(n) if n <= limit else np.unique(np.linspace(0, n - 1, limit).astype(np.intp))


def row_sizes(residual: Array) -> Array:
    """(n,) rms of each row's whitened components; NaN where a row has none."""
    finite = np.isfinite(residual) & (residual != 0.0)  # a row that refers to itself reads nothing
    total = np.sum(np.where(finite, residual, 0.0) ** 2, axis=1)
    count = finite.sum(axis=1)
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def size_panels(columns: Sequence[Column], fits: Sequence[Fit]) -> go.Figure:
    """One panel a driver: rms of each row's residual in sigma; rows off the scale stand at its top edge."""
    rows = math.ceil(len(columns) / _COLUMNS)
    across = min(_COLUMNS, len(columns))
    figure = make_subplots(rows, across, horizontal_spacing=0.07, vertical_spacing=min(0.32 / rows, 0.18))
    sizes = [row_sizes(residual) for _, _, residual, _ in fits]
    top = 1.08 * max(
        [float(np.max(s[ok & np.isfinite(s)], initial=1.0)) for s, (*_, ok) in zip(sizes, fits, strict=True)]
    )
    pick = thinned(len(sizes[0]))
    for k, column in enumerate(columns):
        at = {"row": k // _COLUMNS + 1, "col": k % _COLUMNS + 1}
        for size, (name, colour, _, _) in zip(sizes, fits, strict=True):
            figure.add_trace(_points(column.values[pick], size[pick], top, name, colour, k == 0), **at)
        figure.update_xaxes(title_text=style.label(column.title), **at)
        figure.update_yaxes(range=[0, 1.04 * top], **at)
        if k % _COLUMNS == 0:
            figure.update_yaxes(title_text="row rms [σ]", **at)
        figure.add_hline(y=1.0, line={"color": style.INK, "dash": "dot", "width": 1}, **at)
    return style.finish(figure, height=90 + 235 * rows)


def _points(x: Array, size: Array, top: float, name: str, colour: str, legend: bool) -> Any:
    beyond = size > top
    usual = _SYMBOLS.get(colour, "circle")
    symbol = np.where(beyond, "triangle-up", usual).tolist() if beyond.any() else usual
    return go.Scatter(
        x=x,
        y=np.minimum(size, top),
        mode="markers",
        name=name,
        legendgroup=name,
        showlegend=legend,
        marker={"size": 6, "color": colour, "opacity": 0.75, "symbol": symbol},
        text=[f"{value:.3g} σ" for value in size] if beyond.any() else None,
        hovertemplate="%{x:.4g}: " + ("%{text}" if beyond.any() else "%{y:.3g} σ") + f"<extra>{name}</extra>",
    )


def component_panels(column: Column, groups: Mapping[str, Sequence[int]], fits: Sequence[Fit]) -> go.Figure:
    """Signed components against one driver, a panel an axis; before beside after where readings repeat."""
    rows, across = math.ceil(len(groups) / _COLUMNS), min(_COLUMNS, len(groups))
    titles = [style.label(group) for group in groups]
    figure = make_subplots(rows, across, horizontal_spacing=0.07, vertical_spacing=0.2, subplot_titles=titles)
    reach = max(_reach(residual[ok]) for _, _, residual, ok in fits)
    per_group = max(1, LARGEST // max(1, len(groups)))
    for g, channels in enumerate(groups.values()):
        at = {"row": g // _COLUMNS + 1, "col": g % _COLUMNS + 1}
        for k, (name, colour, residual, _) in enumerate(fits):
            y = residual[:, list(channels)].ravel()
            x = np.repeat(column.values, len(channels)) + (k - 0.5 * (len(fits) - 1)) * _dodge(column.values)
            pick = thinned(len(y), per_group)
            marker = {"size": 5, "color": colour, "opacity": 0.55, "symbol": _SYMBOLS.get(colour, "circle")}
            trace = go.Scatter(
                x=x[pick],
                y=np.clip(y[pick], -reach, reach),
                mode="markers",
                name=name,
                legendgroup=name,
                showlegend=g == 0,
                marker=marker,
            )
            figure.add_trace(trace, **at)
        figure.add_hline(y=0.0, line={"color": style.INK, "width": 1}, **at)
        figure.update_xaxes(title_text=style.label(column.title), **at)
        if g % _COLUMNS == 0:
            figure.update_yaxes(title_text="residual component [σ]", **at)
    figure.update_yaxes(range=[-1.05 * reach, 1.05 * reach])
    return style.finish(figure, height=110 + 260 * rows, top=50)


def _dodge(values: Array) -> float:
    """How far before and after stand apart: nothing, unless readings repeat."""
    return 0.022 * float(np.ptp(values)) if len(np.unique(values)) <= 20 else 0.0


def _reach(residual: Array) -> float:
    values = np.abs(residual[np.isfinite(residual)])
    return max(3.5, float(np.max(values, initial=0.0)))


def curve_plot(curves: Sequence[Curve]) -> go.Figure:
    """Functions of one reading that a finding adds, with their 95 % band."""
    figure = make_subplots(1, len(curves), horizontal_spacing=0.1)
    for k, curve in enumerate(curves):
        at = {"row": 1, "col": k + 1}
        for trace in _curve_traces(curve):
            figure.add_trace(trace.update(showlegend=k == 0), **at)
        figure.add_hline(y=0.0, line={"color": style.MUTED, "width": 1}, **at)
        figure.update_xaxes(title_text=style.label(curve.x_title), **at)
        figure.update_yaxes(title_text=style.label(curve.y_title), **at)
    return style.finish(figure, height=360)


def _curve_traces(curve: Curve) -> list[Any]:
    """Band, line, and a tick at every reading."""
    band = np.concatenate([curve.y - 1.96 * curve.std, (curve.y + 1.96 * curve.std)[::-1]])
    x = np.concatenate([curve.x, curve.x[::-1]])
    shade = {"fill": "toself", "fillcolor": "rgba(0,114,178,0.18)", "line": {"width": 0}, "hoverinfo": "skip"}
    line = {"color": style.AFTER, "width": 2.5}
    rug = {"color": style.INK, "symbol": "line-ns-open", "size": 7}
    floor = np.full(len(curve.measured), float(np.min(band)))
    return [
        go.Scatter(x=x, y=band, name="95 % band", **shade),
        go.Scatter(x=curve.x, y=curve.y, mode="lines", line=line, name="identified"),
        go.Scatter(x=curve.measured, y=floor, mode="markers", marker=rug, name="where it was measured"),
    ]
