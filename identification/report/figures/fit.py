"""Fit before and after: misfit in sigma and in um or urad; held-out ratio with its interval."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from truepose.identification.diagnosis.result import Proof
from truepose.identification.report.figures import style
from truepose.identification.report.fits import FitColumn
from truepose.identification.report.numbers import finer, known, significant, unit_symbol

_ROLES = (("calibration rows", 0, style.AFTER, ""), ("validation rows", 1, style.ACCENT, "/"))


def fit_bars(columns: Sequence[FitColumn], noise: Mapping[str, float], own: Mapping[str, str]) -> go.Figure:
    """Grouped bars of every fit: rms in sigma, then rms by kind (in units ``own``) with the stated noise as a line."""
    kinds = list(dict.fromkeys(kind for column in columns for kind in column.rms))
    units = {kind: _display(own[kind], [c.rms[kind] for c in columns if kind in c.rms]) for kind in kinds}
    titles = ["in units of the stated sigma", *kinds]
    figure = make_subplots(1, len(titles), subplot_titles=titles, horizontal_spacing=0.09)
    lines = [1.0, *(_times(noise.get(kind), units[kind][0]) for kind in kinds)]
    tallest = [level or 0.0 for level in lines]
    for role, at, colour, shape in _ROLES:
        panels = [[column.sigma[at] for column in columns]]
        panels += [[_times(column.rms_of(at, kind), units[kind][0]) for column in columns] for kind in kinds]
        if not any(known(value) for value in panels[0]):
            continue
        pattern = {"shape": shape, "fillmode": "overlay", "fgcolor": style.PAPER, "solidity": 0.25}
        marker = {"color": colour, "pattern": pattern}
        for k, values in enumerate(panels):
            bar = _bars([c.short for c in columns], values, role, marker, k == 0)
            figure.add_trace(bar, row=1, col=k + 1)
            tallest[k] = max(tallest[k], *(v for v in values if v is not None and math.isfinite(v)), 0.0)
    dashed = {"color": style.INK, "width": 1.2, "dash": "dash"}
    for k, (level, unit) in enumerate(zip(lines, ["σ", *(units[kind][1] for kind in kinds)], strict=True)):
        cell = {"row": 1, "col": k + 1}
        figure.update_yaxes(title_text=f"rms residual [{unit}]", range=[0, 1.16 * tallest[k]], **cell)
        if known(level):
            figure.add_hline(y=level, line=dashed, **cell)
    figure.update_xaxes(title_text="fit")
    style.finish(figure, height=360, top=50)
    return figure.update_xaxes(showgrid=False)


def _bars(
    names: Sequence[str], values: Sequence[float | None], role: str, marker: Mapping[str, Any], legend: bool
) -> go.Bar:
    return go.Bar(
        x=names,
        y=[value if known(value) else None for value in values],
        name=role,
        legendgroup=role,
        showlegend=legend,
        marker=marker,
        text=[significant(value) if known(value) else "" for value in values],
        textposition="auto",
        textangle=0,
    )


def _display(own: str, values: Sequence[float]) -> tuple[float, str]:
    """Factor and unit in which the largest of some rms values reads well."""
    largest = max((abs(v) for v in values if math.isfinite(v)), default=1.0)
    factor, unit = finer(largest, own)
    return factor, unit_symbol(unit)


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None or not math.isfinite(value) else value * factor


def proof_plot(proof: Proof) -> go.Figure:
    """Held-out misfit after over before: the named physics with its interval, and the black box."""
    low, high = proof.ratio_interval
    bars = {
        "type": "data",
        "symmetric": False,
        "array": [max(high - proof.ratio, 0)],
        "arrayminus": [max(proof.ratio - low, 0)],
        "thickness": 2,
        "width": 8,
    }
    marker = {"size": 13, "color": style.AFTER}
    traces = [
        go.Scatter(
            x=[proof.ratio],
            y=["named physics"],
            error_x=bars,
            mode="markers",
            marker=marker,
            name="named physics",
        )
    ]
    if known(proof.black_box_ratio):
        marker = {"size": 12, "color": style.MUTED, "symbol": "diamond"}
        traces.append(
            go.Scatter(
                x=[proof.black_box_ratio], y=["black box"], mode="markers", marker=marker, name="black box"
            )
        )
    figure = go.Figure(traces)
    figure.add_vline(
        x=1.0,
        line={"color": style.INK, "dash": "dash", "width": 1.2},
        annotation_text="no gain",
        annotation_position="top",
    )
    figure.update_xaxes(title_text="held-out rms, after over before [1]", rangemode="tozero")
    figure.update_yaxes(title_text="model", autorange="reversed", range=[1.6, -0.6])
    return style.finish(figure, height=230, legend=False, left=130, top=60)
