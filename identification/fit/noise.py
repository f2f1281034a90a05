"""How noisy the readings were, as a fit found them: what its covariance follows, and what its model leaves unexplained.

A posterior takes each sigma as stated. Where readings scatter more, or less, or a robust loss gave up some of them, the
estimate errs otherwise than that posterior says. Its error is A^-1 (b r'r part + prior part) A^-1, a sandwich of what
the estimator does (A) and of what the noise did (Huber and Ronchetti, Robust Statistics, 2009, ch. 7).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from truepose.arrays import Array
from truepose.identification.prediction.covariance import Quantity
from truepose.models.effects.common import sensor_names
from truepose.models.machine.machine import Machine

STATED = 6.0
"""The stated sigma counts like so many readings beside those of the fit: a few of them say little of their noise."""
WILD = 4.0
"""Readings beyond so many robust sigmas are no part of the model's noise."""
NORMAL = 1.4826
"""1-sigma over the median of absolute values, of a normal distribution."""
SURE = 0.01
"""A model's own noise is said where chance alone would leave so much in so few of all fits."""


def channel_groups(machine: Machine) -> dict[str, list[int]]:
    """Places of the channels of each sensor and kind of reading, which share a noise: ``sensor.position``."""
    out: dict[str, list[int]] = {}
    names = [n for n, s in zip(sensor_names(machine), machine.sensors, strict=True) for _ in s.channels]
    for k, (name, channel) in enumerate(zip(names, machine.channels, strict=True)):
        out.setdefault(f"{name}.{channel.kind}", []).append(k)
    return out


@dataclass(frozen=True)
class Scatter:
    """Noise of a fit: ``variance`` (g,) of the loss's slope in each group of channels, ``slope`` of its derivative.

    Both are over those of the weighted Jacobian. Plain least squares: variance is chi2 per degree of freedom, slope is 1.
    """

    variance: tuple[float, ...]
    slope: float = 1.0

    @property
    def as_stated(self) -> bool:
        """Whether nothing differs from what sigma and plain least squares say."""
        return self.slope == 1.0 and set(self.variance) == {1.0}

    @classmethod
    def of(
        cls, residual: Array, weights: Array, groups: Sequence[Sequence[int]], used: Sequence[float]
    ) -> Scatter:
        """From whitened residuals (n, m) of the fitted rows and their weights (n,).

        ``groups``: channels that share a noise; ``used``: degrees of freedom that parameters and shared levels take
        of each.
        """
        if not np.isfinite(residual).all() or not len(residual):
            return cls((1.0,) * len(groups))
        mean, weighed = float(np.mean(weights)), float(np.mean(weights**2))
        slopes = np.where(weights < 1.0, weights * (1.0 - 1.0 / residual.shape[1]), 1.0)
        slope = float(np.mean(slopes))
        variance = []
        for at, taken in zip(groups, used, strict=True):
            n = int(np.sum(residual[:, at] != 0.0))  # a row that refers to itself says nothing
            # small samples: Huber's K, by how much the slopes differ
            factor = 1.0 + taken / max(n, 1) * float(np.var(slopes)) / slope**2
            moved = float(np.sum((weights[:, None] * residual[:, at]) ** 2)) * factor**2
            free = max(n - taken, 0.0)
            variance.append((moved + STATED * weighed) / (free + STATED) / mean)
        return cls(tuple(variance), slope / mean)


def unexplained(machine: Machine, residual: Array, effective: float) -> dict[str, Quantity]:
    """The model's own 1-sigma beside the sensors', by sensor and kind: ``sensor.position`` in mm, ``.rotation`` in rad.

    residual (n, m) are the whitened ones of the fitted rows. Wild readings are left out. Only what is more than chance
    is there.
    """
    share = effective / max(int(np.sum(residual != 0.0)), 1)
    out: dict[str, Quantity] = {}
    for name, at in channel_groups(machine).items():
        own = _beyond(residual[:, at], [machine.channels[k].sigma for k in at], share)
        if own > 0.0:
            out[name] = own, machine.channels[at[0]].unit
    return out


def _beyond(residual: Array, sigma: Sequence[float], share: float) -> float:
    """What readings of stated ``sigma`` (m,) scatter beside it; 0 where that may be chance."""
    told = (residual != 0.0) & np.isfinite(residual)
    if not told.any():
        return 0.0
    kept = told & (np.abs(residual) <= _farthest(residual[told]))
    n = int(kept.sum())
    free = n * (1.0 - share)
    square = float(np.sum(residual[kept] ** 2))
    if free < 1.0 or chdtrc(free, square) > SURE:
        return 0.0
    stated = np.broadcast_to(np.asarray(sigma) ** 2, residual.shape)
    left = float(np.sum(residual[kept] ** 2 * stated[kept])) / free - float(np.mean(stated[kept]))
    return float(np.sqrt(max(left, 0.0)))


def _farthest(values: Array) -> float:
    """The size beyond which readings are wild: a multiple of what is left when the wild are left out."""
    size = NORMAL * float(np.median(np.abs(values)))
    for _ in range(20):
        kept = np.abs(values) <= WILD * size
        after = float(np.sqrt(np.mean(values[kept] ** 2))) if kept.any() else size
        if abs(after - size) <= 1e-6 * size:
            break
        size = after
    return WILD * size
