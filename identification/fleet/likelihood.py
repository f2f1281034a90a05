"""What one machine adds to the log likelihood of a fleet's unknowns, on grids: how frequent and how large an effect is, how
far constants are from their drawing.

An effect is there with a frequency q, and its size is drawn around the fleet's usual size j by the kernel K. One machine says

    p(readings | q, j) / p(readings | absent) = 1 - q + q sum_s K(s | j) B_s

with B_s the Bayes factor of the effect at size s, 1 at sizes that its recording would not show. Where rivals explain the same
with a probability r, the machine counts 1 - r as above, with B against nothing at all, and r as one in which no size that would
be noticed is there: a step of EM over which of them it is, so that rivals together are counted once.

A constant's deviation x +- e (in tolerances) says N(x; 0, r^2 + e^2), with r the true spread over the stated tolerance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from truepose.identification.prior import FLEET_SIZES, SIZES

Array = NDArray[np.float64]
LOG_ODDS: Array = np.linspace(-11.0, 5.0, 33)
"""(g,) grid of the log odds of a frequency; between its points a log likelihood is smooth."""
RATIOS: Array = np.geomspace(0.05, 20.0, 61)
"""(r,) grid of true spreads over stated tolerances."""
LARGEST = 15.0
"""Log Bayes factor beyond which a posterior tells no more."""
SLAB: Array = np.exp(SIZES.log_prior)
"""(s,) prior share of each size."""


def _kernel() -> Array:
    """(j, s) how sizes of machines scatter about the fleet's usual one. The slab is what it leaves unchanged (detailed
    balance), so that a fleet of which nothing is known has the sizes of the slab."""
    steps = np.abs(np.subtract.outer(np.arange(len(SLAB)), np.arange(len(SLAB))))
    offered = FLEET_SIZES**steps
    out = offered / offered.sum(axis=1).max() * np.minimum(1.0, SLAB / SLAB[:, None])
    np.fill_diagonal(out, 0.0)
    np.fill_diagonal(out, 1.0 - out.sum(axis=1))
    return np.asarray(out)


KERNEL: Array = _kernel()


@dataclass(frozen=True)
class Told:
    """What machines say of an effect each (p,): log Bayes factor against nothing, prior share of sizes that are not seen,
    and the probability that a rival explains what it would."""

    log_factor: Array
    unseen: Array
    rival: Array

    @classmethod
    def of(cls, kept: Sequence[Sequence[Any]]) -> Told:
        """From ``[probability, prior, log Bayes factor, unseen, credit]`` of each."""
        p, _, log_factor, unseen, credit = np.array([one[:5] for one in kept], dtype=float).reshape(-1, 5).T
        rival = np.minimum(p * (1.0 - credit) / np.maximum(credit, 1e-9), 1.0 - p)
        nothing = np.maximum(1.0 - p - rival, np.exp(-LARGEST))
        against = log_factor + np.log(np.maximum(1.0 - p, np.exp(-LARGEST))) - np.log(nothing)
        return cls(np.minimum(against, LARGEST), unseen, rival)


def by_size(log_factor: float, unseen: float, more: Mapping[str, Any]) -> Array:
    """(s,) Bayes factor of an effect at each size, from what is kept of it."""
    shown = np.clip((np.cumsum(SLAB) - unseen) / SLAB, 0.0, 1.0)  # small sizes are those that are not seen
    share = np.array(more["sizes"]) if "sizes" in more else SLAB * shown
    share = share / max(float(share.sum()), 1e-300)
    return np.asarray((1.0 - shown) + np.exp(log_factor) * (1.0 - unseen) * share / SLAB)


def of_frequency(told: Told, more: Sequence[Mapping[str, Any]]) -> Array:
    """(p, j, g) log likelihood of frequencies and usual sizes."""
    pairs = list(zip(told.log_factor.tolist(), told.unseen.tolist(), strict=True))
    own = np.array([by_size(*pair, one) for pair, one in zip(pairs, more, strict=True)])
    other = np.array([by_size(-np.inf, unseen, {}) for _, unseen in pairs])
    r = told.rival[:, None, None]
    mixed, without = (_log_mixed((part @ KERNEL.T)[:, :, None]) for part in (own, other))
    return np.asarray((1.0 - r) * mixed + r * without)


def of_presence(told: Told) -> Array:
    """(p, g) log likelihood of frequencies, whatever the size."""
    there = told.unseen + (1.0 - told.unseen) * np.exp(told.log_factor)
    r = told.rival[:, None]
    return np.asarray((1.0 - r) * _log_mixed(there[:, None]) + r * _log_mixed(told.unseen[:, None]))


def _log_mixed(there: Array) -> Array:
    """(..., g) of an effect that is there with each frequency, from its Bayes factors (..., 1)."""
    q = expit(LOG_ODDS)
    return np.asarray(np.log(1.0 - q + q * there))


def of_spread(deviation: Array, std: Array) -> Array:
    """(r,) log likelihood of a class's spread from deviations (k,) and their 1-sigmas, in tolerances."""
    variance = RATIOS**2 + std[:, None] ** 2
    return np.asarray(-0.5 * np.sum(np.log(variance) + deviation[:, None] ** 2 / variance, axis=0))


__all__ = [
    "KERNEL",
    "LOG_ODDS",
    "RATIOS",
    "SLAB",
    "Told",
    "by_size",
    "of_frequency",
    "of_presence",
    "of_spread",
]
