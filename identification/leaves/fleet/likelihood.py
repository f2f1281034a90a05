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

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import expit

from truepose.arrays import Array
from truepose.identification.prior import FLEET_SIZES, SIZES

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
    def of(cls, rows: pd.DataFrame) -> Told:
        """From rows of a table of ``Pooled``."""
        columns = ("probability", "log_factor", "unseen", "credit")
        p, log_factor, unseen, credit = (rows[name].to_numpy() for name in columns)
        rival = np.minimum(p * (1.0 - credit) / np.maximum(credit, 1e-9), 1.0 - p)
        nothing = np.maximum(1.0 - p - rival, np.exp(-LARGEST))
        against = log_factor + np.log(np.maximum(1.0 - p, np.exp(-LARGEST))) - np.log(nothing)
        return cls(np.minimum(against, LARGEST), unseen, rival)


def _shown(unseen: Array) -> Array:
    """(p, s) share of each size that a recording would show: small ones are those that are not seen."""
    return np.clip((np.cumsum(SLAB) - unseen[:, None]) / SLAB, 0.0, 1.0)


def by_size(log_factor: Array, unseen: Array, sizes: Array) -> Array:
    """(p, s) Bayes factor of effects (p,) at each size. sizes (p, s): how probable each is, rows of NaN where nobody knows."""
    shown = _shown(unseen)
    share = np.where(np.isnan(sizes), SLAB * shown, sizes)
    share /= np.maximum(share.sum(axis=1, keepdims=True), 1e-300)
    return np.asarray((1.0 - shown) + (np.exp(log_factor) * (1.0 - unseen))[:, None] * share / SLAB)


def of_frequency(told: Told, sizes: Array) -> Array:
    """(p, j, g) log likelihood of frequencies and usual sizes; sizes (p, s) as in ``by_size``."""
    out = _log_mixed(_scattered(by_size(told.log_factor, told.unseen, sizes)))
    at = np.flatnonzero(told.rival > 0.0)  # few: where a recording cannot tell two effects apart
    r = told.rival[at, None, None]
    out[at] = (1.0 - r) * out[at] + r * _log_mixed(_scattered(1.0 - _shown(told.unseen[at])))
    return out


def _scattered(factors: Array) -> Array:
    """(p, j) Bayes factors by the fleet's usual size, from those by size (p, s). No product of matrices: its rounding would
    depend on how many rows there are, and sums of machines have to be the same in any grouping."""
    return np.asarray(sum(factors[:, s, None] * KERNEL[:, s] for s in range(len(SLAB))))


def of_presence(told: Told) -> Array:
    """(p, g) log likelihood of frequencies, whatever the size."""
    there = told.unseen + (1.0 - told.unseen) * np.exp(told.log_factor)
    r = told.rival[:, None]
    return np.asarray((1.0 - r) * _log_mixed(there) + r * _log_mixed(told.unseen))


def _log_mixed(there: Array) -> Array:
    """(..., g) of an effect that is there with each frequency, from its Bayes factors (...)."""
    q = expit(LOG_ODDS)
    out = q * there[..., None]
    out += 1.0 - q
    return np.asarray(np.log(out, out=out))


def of_spread(deviation: Array, std: Array) -> Array:
    """(p, r) log likelihood of a spread from each deviation (p,) with its 1-sigma, in tolerances; those of a class add."""
    variance = RATIOS**2 + std[:, None] ** 2
    return np.asarray(-0.5 * (np.log(variance) + deviation[:, None] ** 2 / variance))
