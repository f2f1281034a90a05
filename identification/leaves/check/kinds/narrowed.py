"""The size of a slip that fits best: a grid, then halved steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_HALVED = 8


def narrowed(misfit: Callable[[float], float], grid: NDArray[np.float64]) -> float:
    """Return where a misfit is least: the best of a grid, then halved steps around it."""
    tried = {float(size): misfit(float(size)) for size in grid}
    best = min(tried, key=lambda size: tried[size])
    order = sorted(tried)
    at = order.index(best)
    step = max(abs(order[min(at + 1, len(order) - 1)] - best), abs(best - order[max(at - 1, 0)]))
    for _ in range(_HALVED):
        step /= 2
        for size in (best - step, best + step):
            tried[size] = misfit(size)
        best = min((best - step, best, best + step), key=lambda size: tried[size])
    return best


__all__ = ["narrowed"]
