"""What one machine adds to the log likelihood of a fleet's unknowns, on grids: how frequent and how large an effect is, how
far constants are from their drawing.

An effect is there with a frequency q, and its size is drawn around the fleet's usual size j by the kernel K. One machine says

    p(readings | q, j) / p(readings | absent) = 1 - q + q sum_s K(s | j) B_s

with B_s the Bayes factor of the effect at size s, 1 at sizes that its recording would not show. Where rivals may explain the
same, each takes its share c of the machine as above, and with 1 - c the machine says of it at most that it may be there as
well (B = 1), so that rivals together are counted once: a step of EM over which of them it is. A constant's deviation x +- e
(in tolerances) says N(x; 0, r^2 + e^2), with r the true spread over the stated tolerance.
"""

from __future__ import annotations

from collections.abc import Mapping
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


def by_size(log_factor: float, unseen: float, more: Mapping[str, Any]) -> Array:
    """(s,) Bayes factor of an effect at each size, from what is kept of it."""
    shown = np.clip((np.cumsum(SLAB) - unseen) / SLAB, 0.0, 1.0)  # small sizes are those that are not seen
    share = np.array(more["sizes"]) if "sizes" in more else SLAB * shown
    share = share / max(float(share.sum()), 1e-300)
    return np.asarray((1.0 - shown) + np.exp(log_factor) * (1.0 - unseen) * share / SLAB)


def of_frequency(factors: Array, neutral: Array, credit: Array) -> Array:
    """(p, j, g) log likelihood of frequencies and usual sizes, from Bayes factors (p, s) with a credit (p,), and without."""
    own, other = (_log_mixed((part @ KERNEL.T)[:, :, None]) for part in (factors, neutral))
    c = credit[:, None, None]
    return np.asarray(c * own + (1.0 - c) * other)


def of_presence(log_factor: Array, unseen: Array, credit: Array) -> Array:
    """(p, g) log likelihood of frequencies, whatever the size."""
    own, other = (
        _log_mixed((unseen + (1.0 - unseen) * np.exp(part))[:, None])
        for part in (log_factor, np.minimum(log_factor, 0.0))
    )
    return np.asarray(credit[:, None] * own + (1.0 - credit[:, None]) * other)


def _log_mixed(there: Array) -> Array:
    """(..., g) of an effect that is there with each frequency, from its Bayes factors (..., 1)."""
    q = expit(LOG_ODDS)
    return np.asarray(np.log(1.0 - q + q * there))


def of_spread(deviation: Array, std: Array) -> Array:
    """(r,) log likelihood of a class's spread from deviations (k,) and their 1-sigmas, in tolerances."""
    variance = RATIOS**2 + std[:, None] ** 2
    return np.asarray(-0.5 * np.sum(np.log(variance) + deviation[:, None] ** 2 / variance, axis=0))


__all__ = ["KERNEL", "LOG_ODDS", "RATIOS", "SLAB", "by_size", "of_frequency", "of_presence", "of_spread"]
