"""Parameters against their tolerances: where each fit puts them; and how estimates go together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.report.numbers import known
from truepose.shown.chart import Axis, Cells, Chart, Layer, Level, Marks, Shape, Span, Tone

MOST, PER_PANEL = 60, 20
LETTERS = 13
"""Most letters of a name beside a map, whose cells need the room."""


@dataclass(frozen=True)
class Departures:
    """A fit's departures (k,) from the drawing, in tolerances; clipped: it may run off the scale."""

    name: str
    tone: Tone
    shape: Shape
    values: Array
    clipped: bool = False


def dot_plot(names: Sequence[str], series: Sequence[Departures], allowed: float | None) -> list[Chart]:
    """One line a parameter, the farthest on top, some a panel; clipped series stand at the edge beyond the scale."""
    sizes = np.nan_to_num(np.array([np.abs(s.values) for s in series if not s.clipped]))
    order = np.argsort(-np.round(np.max(sizes, axis=0), 6), kind="stable")[:MOST]
    limit = allowed if allowed is not None and known(allowed) else 0.0
    reach = 1.12 * max(2.0, limit, float(np.max(sizes, initial=0.0)))
    return [
        _panel(names, series, order[k : k + PER_PANEL], reach, limit) for k in range(0, len(order), PER_PANEL)
    ]


def _panel(
    names: Sequence[str], series: Sequence[Departures], rows: Index, reach: float, limit: float
) -> Chart:
    layers: list[Layer] = [Span(-1.0, 1.0, "accent", "one tolerance")]
    layers.append(Level(0.0, "x", dashed=False, tone="free"))
    if limit > 0:
        layers += [Level(side * limit, "x", "allowed to the farthest", tone="ink") for side in (-1, 1)]
    at = np.arange(len(rows), dtype=float)
    for one in series:
        values = np.clip(one.values[rows], -0.99 * reach, 0.99 * reach)
        layers.append(Marks(values, at, one.tone, one.name, one.shape))
    return Chart(
        "",
        Axis("estimate less drawing [tolerances]", -reach, reach),
        Axis("", names=[names[k] for k in rows]),
        layers,
        height=62.0 + 17.0 * len(rows),
    )


def correlation_map(names: Sequence[str], correlation: Array) -> Chart:
    """Correlations (k, k) of estimates as cells."""
    height = 90.0 + 15.5 * len(names)
    own = correlation - np.diag(np.diag(correlation))
    cells = Cells(own, largest=1.0)
    short = [name if len(name) <= LETTERS else f"{name[:5]}\u2026{name[6 - LETTERS :]}" for name in names]
    return Chart("", Axis("", names=short), Axis("", names=short), [cells], height=max(height, 180.0))
