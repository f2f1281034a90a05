"""Whether probabilities mean what they say: how often statements made with some probability were right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from challenge.statements import Statement

Array = NDArray[np.float64]
TENTHS = 10
HONEST = 400
"""Simulations of chance."""


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

    @property
    def holds(self) -> bool:
        """Whether what was said is what the share may be."""
        return self.interval[0] <= self.said <= self.interval[1]


def reliability(statements: Sequence[Statement]) -> tuple[Bin, ...]:
    """Tenths that hold anything; a probability of exactly 0.3 is in the tenth above it."""
    p, right, place = _placed(statements)
    out = []
    for k in range(TENTHS):
        some = place == k
        n, hits = int(some.sum()), int(right[some].sum())
        if n:
            out.append(Bin(float(p[some].mean()), n, hits, wilson(hits, n)))
    return tuple(out)


def calibration_error(statements: Sequence[Statement]) -> float | None:
    """Expected calibration error: mean over statements of |said - right| of their tenth (Naeini et al. 2015)."""
    if not statements:
        return None
    p, right, place = _placed(statements)
    off = np.bincount(place, p - right, TENTHS)
    return float(np.sum(np.abs(off)) / len(p))


def error_of_cases(said: Sequence[Sequence[Statement]]) -> float:
    """The same of the statements of several cases; 0 without any."""
    return calibration_error([x for own in said for x in own]) or 0.0


def _placed(statements: Sequence[Statement]) -> tuple[Array, Array, NDArray[np.int64]]:
    """(n,) probabilities, 1 for what was right, and the tenth of each."""
    p = np.array([min(max(s.probability, 0.0), 1.0) for s in statements], dtype=float)
    right = np.array([s.right for s in statements], dtype=float)
    place = np.clip(np.floor(p * TENTHS + 1e-9), 0, TENTHS - 1).astype(np.int64)
    return p, right, place


def honest_error(statements: Sequence[Statement]) -> float | None:
    """Calibration error that as many statements show by chance when every probability is honest: mean of simulated ones."""
    if not statements:
        return None
    p, _, place = _placed(statements)
    right = np.random.default_rng(1).random((HONEST, len(p))) < p
    off = [np.abs(np.bincount(place, p - some, TENTHS)).sum() / len(p) for some in right]
    return float(np.mean(off))


def brier(statements: Sequence[Statement]) -> float | None:
    """Mean squared difference of probability and outcome (Brier 1950); None without statements."""
    if not statements:
        return None
    return float(np.mean([(s.probability - s.right) ** 2 for s in statements]))


__all__ = ["Bin", "brier", "calibration_error", "error_of_cases", "honest_error", "reliability", "wilson"]
