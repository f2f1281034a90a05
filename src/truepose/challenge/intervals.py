"""Shares with their uncertainty."""

from __future__ import annotations

import numpy as np


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """95 % Wilson interval of a share ``hits / n``; (0, 1) when nothing was counted (Wilson 1927)."""
    if n == 0:
        return 0.0, 1.0
    p, d = hits / n, 1 + z * z / n
    centre, half = (p + z * z / (2 * n)) / d, z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / d
    # the ends are exact where nothing, or everything, was hit: rounding must not move them
    low = 0.0 if hits == 0 else max(0.0, float(centre - half))
    return low, 1.0 if hits == n else min(1.0, float(centre + half))


__all__ = ["wilson"]
