"""Whether probabilities mean what they say: how often statements made with some probability were right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truepose.challenge.intervals import wilson
from truepose.challenge.score import Statement
from truepose.charts import Series, write_chart

EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)


@dataclass(frozen=True)
class Bin:
    """Statements of about one probability: mean of it, how many, how many were right, 95 % Wilson interval."""

    said: float
    n: int
    hits: int
    interval: tuple[float, float]


def reliability(statements: Sequence[Statement]) -> tuple[Bin, ...]:
    """Bins that hold anything."""
    p = np.array([min(max(s.probability, 0.0), 1.0) for s in statements])
    right = np.array([s.right for s in statements], dtype=bool)
    place = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)
    out = []
    for k in range(len(EDGES) - 1):
        some = place == k
        n, hits = int(some.sum()), int(right[some].sum())
        if n:
            out.append(Bin(float(p[some].mean()), n, hits, wilson(hits, n)))
    return tuple(out)


def brier(statements: Sequence[Statement]) -> float | None:
    """Mean squared difference of probability and outcome (Brier 1950); None without statements."""
    if not statements:
        return None
    return float(np.mean([(s.probability - s.right) ** 2 for s in statements]))


def write_reliability(path: Path, statements: Sequence[Statement], title: str) -> None:
    """The reliability diagram (SVG). Nothing is written without statements."""
    bins = reliability(statements)
    if not bins:
        return
    said = [b.said for b in bins]
    middle = [sum(b.interval) / 2 for b in bins]
    half = [(b.interval[1] - b.interval[0]) / 2 for b in bins]
    series = [
        Series("as said", [0.0, 1.0], [0.0, 1.0], "line"),
        Series("share that was right", said, [b.hits / b.n for b in bins], "points"),
        Series("95 % Wilson interval", said, middle, "none", half),
    ]
    write_chart(path, title, "probability said", "share that was right", series)


__all__ = ["Bin", "brier", "reliability", "write_reliability"]
