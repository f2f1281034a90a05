"""Where the evidence points: log Bayes factor of the best explanation at each place."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import plotly.graph_objects as go

from truepose.identification.diagnosis.alone import NOTABLE
from truepose.identification.report.figures import style
from truepose.identification.report.numbers import known, significant

SHOWN = 24
_TICKS = (-1000, -100, -30, -10, -3, -1, 0, 1, 3, 10, 30, 100, 300, 1000, 3000, 10_000, 100_000, 1_000_000)

_DECADES = tuple(10**k for k in range(1, 7))


def squeeze(value: float) -> float:
    """A logarithm on either side of zero, so that 3 and 3,000 are both readable."""
    return math.copysign(math.log10(1.0 + abs(value)), value)


def evidence_map(evidence: Mapping[str, float], named: Collection[str]) -> go.Figure:
    """Bars of the strongest places, best on top; places of findings stand out."""
    best = sorted(((p, v) for p, v in evidence.items() if known(v)), key=lambda item: -item[1])[:SHOWN]
    places, values = [style.label(p) for p, _ in best], [v for _, v in best]
    figure = go.Figure()
    for name, colour, wanted in (
        ("place of a finding", style.BEFORE, True),
        ("other places", style.FREE, False),
    ):
        at = [k for k, (place, _) in enumerate(best) if (place in named) is wanted]
        if not at:
            continue
        bar = go.Bar(
            x=[squeeze(values[k]) for k in at],
            y=[places[k] for k in at],
            orientation="h",
            name=name,
            marker={"color": colour},
            text=[significant(values[k]) for k in at],
            textposition="outside",
            cliponaxis=False,
            hovertemplate="%{y}: %{text}<extra></extra>",
        )
        figure.add_trace(bar)
    _axis(figure, min([*values, -1.0]), max([*values, NOTABLE]))
    figure.update_yaxes(title_text="place", categoryorder="array", categoryarray=places[::-1])
    figure.update_layout(barmode="overlay")
    return style.finish(figure, height=130 + 21 * max(len(best), 4), left=110, top=45, legend=bool(named))


def _axis(figure: go.Figure, low: float, high: float) -> None:
    """The squeezed axis with its true values, zero and what is worth a name."""
    ticks = [t for t in _TICKS if 1.6 * low <= t <= 2.5 * high]
    if len(ticks) > 12:
        ticks = [t for t in ticks if t in (0, 3) or abs(t) in _DECADES]
    span = squeeze(high) - squeeze(low)
    figure.update_xaxes(
        title_text="log Bayes factor against nothing missing [1], logarithmic on both sides of 0",
        tickvals=[squeeze(t) for t in ticks],
        ticktext=[f"{t:,}" for t in ticks],
        range=[squeeze(low) - 0.09 * span, squeeze(high) + 0.1 * span],
    )
    figure.add_vline(x=0.0, line={"color": style.INK, "width": 1})
    line = {"color": style.ACCENT, "dash": "dash", "width": 1.5}
    mark = {"annotation_text": "worth a name: 3", "annotation_position": "top"}
    figure.add_vline(x=squeeze(NOTABLE), line=line, layer="below", **mark)
