"""How large an imperfection is drawn: in detection limits, so that every machine and kind is as hard as said.

The detection limit is the size whose signal-to-noise ratio is 5 after geometry has adapted within its tolerances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from challenge.adaptation import Adaptation
from challenge.simulator.base import Imperfection

Array = NDArray[np.float64]
Change = Callable[[Imperfection], Array]
"""The whitened change of readings (N,) that an imperfection makes."""
LIMIT_SNR = 5.0
LARGEST = 8.0
"""Typical sizes beyond which an imperfection would be absurd."""
CLOSE = 0.01
STEPS = 12


@dataclass(frozen=True)
class Sized:
    """An imperfection at a drawn size: its detection limit, signal-to-noise ratio and whitened change (N,)."""

    imperfection: Imperfection
    limit: float
    snr: float
    change: Array

    @property
    def factor(self) -> float:
        """Size in detection limits."""
        return abs(self.imperfection.size) / self.limit


def detection_limit(bench: Adaptation, change: Change, imperfection: Imperfection) -> float | None:
    """Size at which the signal-to-noise ratio is 5, by secants in the logarithm; None when no sensible size has it.

    ``imperfection`` starts the search at a size that a shop would call usual.
    """
    typical = abs(imperfection.size)
    size, seen = typical, list[tuple[float, float]]()
    for _ in range(STEPS):
        snr = bench.snr(change(imperfection.scaled(size / typical)))
        if not np.isfinite(snr) or snr <= 0.0:
            return None
        if abs(snr / LIMIT_SNR - 1) < CLOSE:
            return size
        seen.append((np.log(size), np.log(snr)))
        size = _next(seen)
        if not 1e-6 * typical < size < 2 * LARGEST * typical:
            return None
    return None


def _next(seen: list[tuple[float, float]]) -> float:
    """Where the last secant (slope 1 at first: the ratio grows with the size) meets the wanted ratio."""
    (x, y), slope = seen[-1], 1.0
    if len(seen) > 1 and seen[-2][0] != x:
        slope = (y - seen[-2][1]) / (x - seen[-2][0])
    slope = slope if 0.2 < slope < 5.0 else 1.0
    return float(np.exp(x + np.clip((np.log(LIMIT_SNR) - y) / slope, -3.0, 3.0)))


def draw_factor(
    rng: np.random.Generator, low: float, high: float, limit: float, typical: float
) -> float | None:
    """Size in detection limits, log-uniform, never more than ``LARGEST`` typical sizes; None where that leaves nothing."""
    high = min(high, LARGEST * abs(typical) / limit)
    return float(np.exp(rng.uniform(np.log(low), np.log(high)))) if high > low else None


def sized(bench: Adaptation, change: Change, imperfection: Imperfection, limit: float) -> Sized:
    """What an imperfection of some size does."""
    delta = change(imperfection)
    return Sized(imperfection, limit, bench.snr(delta), delta)


__all__ = ["LARGEST", "LIMIT_SNR", "Sized", "detection_limit", "draw_factor", "sized"]
