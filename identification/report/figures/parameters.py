"""Parameters against their tolerances: where each fit puts them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from truepose.identification.report.figures import style
from truepose.identification.report.numbers import known, significant

Array = NDArray[np.float64]
Series = tuple[str, str, str, Array]  # name, colour, symbol, departures (k,) in tolerances
MOST = 60


def dot_plot(
    names: Sequence[str], series: Sequence[Series], allowed: float | None, clip: Sequence[int]
) -> go.Figure:
    """One line a parameter; series in ``clip`` may run off the scale and are then drawn at its edge."""
    sizes = np.nan_to_num(np.array([np.abs(s[3]) for k, s in enumerate(series) if k not in clip]))
    order = np.argsort(-np.max(sizes, axis=0))[:MOST]
    limit = allowed if allowed is not None and known(allowed) else 0.0
    reach = 1.15 * max(2.0, limit, float(np.max(sizes, initial=0.0)))
    shown = [style.label(names[k]) for k in order]
    figure = go.Figure([_dots(one, order, shown, reach) for one in series])
    _guides(figure, limit)
    figure.update_xaxes(title_text="estimate less drawing [tolerances]", range=[-1.02 * reach, 1.02 * reach])
    figure.update_yaxes(title_text="parameter", categoryorder="array", categoryarray=shown[::-1])
    figure.update_yaxes(range=[-0.8, len(shown) - 0.2], dtick=1, tickfont={"size": 11})
    return style.finish(figure, height=140 + 16 * len(shown), left=110, top=50)


def _dots(one: Series, order: NDArray[np.intp], shown: Sequence[str], reach: float) -> go.Scatter:
    name, colour, symbol, values = one
    v = values[order]
    edge = np.where(v > 0, "triangle-right", "triangle-left")
    marks = np.where(np.abs(v) > reach, edge, symbol).tolist()
    return go.Scatter(
        x=np.clip(v, -reach, reach),
        y=shown,
        mode="markers",
        name=name,
        marker={"color": colour, "symbol": marks, "size": 9, "line": {"width": 1.5, "color": colour}},
        customdata=[significant(float(value)) for value in v],
        hovertemplate="%{y}: %{customdata} tolerances<extra>" + name + "</extra>",
        cliponaxis=False,
    )


def _guides(figure: go.Figure, allowed: float) -> None:
    """One tolerance either side, and what a true model stays within (0: not known)."""
    figure.add_vrect(x0=-1.0, x1=1.0, fillcolor=style.ACCENT, opacity=0.1, line={"width": 0}, layer="below")
    figure.add_vline(x=0.0, line={"color": style.MUTED, "width": 1})
    marks = [(side, f"{side:+.0f}", {"color": style.ACCENT, "width": 1}) for side in (-1.0, 1.0)]
    if allowed > 0:
        dashed = {"color": style.INK, "dash": "dash", "width": 1.3}
        marks += [(side, f"allowed {side:+.1f}", dashed) for side in (-allowed, allowed)]
    for at, text, line in marks:
        figure.add_vline(x=at, line=line, annotation_text=text, annotation_position="top")
