"""Whether probabilities mean what they say: how often statements made with some probability were right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from truepose.challenge.score import Statement

EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)


def wilson(hits: int, n: int) -> tuple[float, float]:
    """95 % Wilson interval of a share ``hits / n``, n > 0 (Wilson 1927)."""
    low, high = binomtest(hits, n).proportion_ci(method="wilson")
    return float(low), float(high)


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


__all__ = ["Bin", "brier", "reliability", "wilson"]
