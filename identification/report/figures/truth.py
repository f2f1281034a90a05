"""Truth beside what was found (bundled demonstrations only)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from truepose.identification.report.figures import style

Array = NDArray[np.float64]


def matrices(true: Array, found: Array, rows: Sequence[str], columns: Sequence[str]) -> go.Figure:
    """True matrix (r, c), estimated matrix (r, c) and their difference on one colour scale."""
    titles = ["truth", "estimate", "estimate less truth"]
    figure = make_subplots(1, 3, subplot_titles=titles, horizontal_spacing=0.06, shared_yaxes=True)
    reach = float(np.max(np.abs(np.concatenate([true.ravel(), found.ravel()])), initial=0.0)) or 1.0
    for k, value in enumerate((true, found, found - true)):
        heat = go.Heatmap(
            z=1e3 * value,
            x=[style.label(c) for c in columns],
            y=[style.label(r) for r in rows],
            zmin=-1e3 * reach,
            zmax=1e3 * reach,
            colorscale=[list(stop) for stop in style.DIVERGING],
            text=[[f"{1e3 * v:.1f}" for v in line] for line in value],
            texttemplate="%{text}",
            showscale=k == 2,
            colorbar={"title": {"text": "10⁻³"}, "thickness": 14},
        )
        figure.add_trace(heat, row=1, col=k + 1)
    figure.update_xaxes(title_text="actuator that travels [1]")
    figure.update_yaxes(autorange="reversed")
    figure.update_yaxes(title_text="end that moves [10⁻³]", row=1, col=1)
    return style.finish(figure, height=420, legend=False, left=90, top=65)


def departures(names: Sequence[str], true: Array, fits: Sequence[tuple[str, str, Array]]) -> go.Figure:
    """True departure (n,) from the drawing against the estimated one (n,) of each fit, in tolerances."""
    figure = go.Figure()
    reach = 1.1 * float(np.max(np.abs(np.concatenate([true, *(f[2] for f in fits)])), initial=1.0))
    figure.add_trace(
        go.Scatter(
            x=[-reach, reach],
            y=[-reach, reach],
            mode="lines",
            line={"color": style.INK, "width": 1},
            name="estimate = truth",
            hoverinfo="skip",
        )
    )
    for (name, colour, values), symbol in zip(fits, ("diamond-open", "circle"), strict=False):
        trace = go.Scatter(
            x=true,
            y=values,
            mode="markers",
            name=name,
            text=[style.label(n) for n in names],
            marker={"color": colour, "size": 8, "symbol": symbol},
            hovertemplate="%{text}: true %{x:.2f}, estimated %{y:.2f}<extra>" + name + "</extra>",
        )
        figure.add_trace(trace)
    side = 1.1 * max(float(np.max(np.abs(true), initial=1.0)), 1.0)
    figure.update_xaxes(title_text="true departure from the drawing [tolerances]", range=[-side, side])
    up = 1.1 * max(side / 1.1, *(float(np.max(np.abs(values), initial=0.0)) for _, _, values in fits))
    figure.update_yaxes(title_text="estimated departure [tolerances]", range=[-up, up])
    return style.finish(figure, height=430)
