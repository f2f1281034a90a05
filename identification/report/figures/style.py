"""Colours (Okabe and Ito's, safe for the colour-blind), markers and the layout that all figures share."""

from __future__ import annotations

from html import escape
from typing import Any

import plotly.graph_objects as go

INK, MUTED, GRID, PAPER = "#1f2933", "#8a949e", "#e4e7eb", "#ffffff"
FREE, BEFORE, AFTER, ACCENT = "#9aa5b1", "#d55e00", "#0072b2", "#009e73"
DIVERGING = ((0.0, "#b35806"), (0.25, "#f1a340"), (0.5, "#ffffff"), (0.75, "#67a9cf"), (1.0, "#2166ac"))
FONT = "system-ui, -apple-system, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif"


def finish(figure: Any, *, height: int, legend: bool = True, left: int = 70, top: int = 40) -> go.Figure:
    """The common look: white paper, thin grid, legend above."""
    figure.update_layout(
        template=go.layout.Template(),
        height=height,
        margin={"l": left, "r": 25, "t": top, "b": 55},
        paper_bgcolor=PAPER,
        plot_bgcolor=PAPER,
        font={"family": FONT, "size": 13, "color": INK},
        showlegend=legend,
        legend={
            "orientation": "h",
            "x": 0,
            "y": 1.0,
            "yanchor": "bottom",
            "xanchor": "left",
            "yref": "container",
        },
        hoverlabel={"font": {"family": FONT}},
        bargap=0.25,
        bargroupgap=0.08,
    )
    if legend:
        figure.update_layout(legend={"y": 0.995, "yanchor": "top"}, margin={"t": top + 25})
    line = {
        "showline": True,
        "linecolor": MUTED,
        "gridcolor": GRID,
        "zeroline": False,
        "ticks": "outside",
        "tickcolor": MUTED,
        "automargin": True,
        "title": {"font": {"size": 13}, "standoff": 10},
    }
    figure.update_xaxes(**line)
    figure.update_yaxes(**line)
    figure.update_annotations(font={"family": FONT, "size": 13})
    return figure


def label(text: object) -> str:
    """Text from users, safe within plotly's own markup."""
    return escape(str(text))
