"""Frequencies of an effect at its places, which are alike but not the same: a tree of three levels, summed out on grids.

    t_e  ~ N(m, FLEET_ODDS^2)          how far the log odds of the effect are from today's prior l
    l_p + t_p,  t_p ~ N(t_e, FLEET_PLACES^2)     those of each place p;   usual size j ~ slab, one for the effect
    machines ~ ``of_frequency`` given both

m is such that without any machine the expected frequency is today's prior. A place hears of the others through t_e alone, so
each is summed out once, and its own posterior is the others' message times what its own machines say.

What one machine adds to the log likelihood of a fleet's unknowns, on grids: how frequent and how large an effect is, how
far constants are from their drawing.

An effect is there with a frequency q, and its size is drawn around the fleet's usual size j by the kernel K. One machine says

    p(readings | q, j) / p(readings | absent) = 1 - q + q sum_s K(s | j) B_s

with B_s the Bayes factor of the effect at size s, 1 at sizes that its recording would not show. Where rivals explain the same
with a probability r, the machine counts 1 - r as above, with B against nothing at all, and r as one in which no size that would
be noticed is there: a step of EM over which of them it is, so that rivals together are counted once.

A constant's deviation x +- e (in tolerances) says N(x; 0, r^2 + e^2), with r the true spread over the stated tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import expit, logit, logsumexp

from truepose.arrays import Array
from truepose.identification.prior import FLEET_ODDS, FLEET_PLACES, FLEET_SIZES, SIZES

# -- What one machine adds to the log likelihood of a fleet's unknowns, on grids: how frequent and how large an effect is, how

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


# -- Frequencies of an effect at its places, which are alike but not the same: a tree of three levels, summed out on grids

FINE: Array = np.linspace(LOG_ODDS[0], LOG_ODDS[-1], 641)
"""(f,) grid that posteriors are summed on, of log odds."""
STEPS: Array = np.linspace(-9.0, 9.0, 181)
"""(t,) grid of how far an effect is from today's prior."""
TAIL = 0.05
"""Of a posterior beyond each end of an interval."""


@dataclass(frozen=True)
class Posterior:
    """Of a frequency. usual: log odds expected before any machine; shares (f,): probability of each of ``FINE``, ``before``
    any machine, too."""

    usual: float
    shares: Array
    before: Array

    @property
    def mean(self) -> float:
        """Expected frequency: the probability that the next machine has it."""
        return float(self.shares @ expit(FINE))

    @property
    def usual_frequency(self) -> float:
        """Frequency expected before any machine."""
        return float(1.0 / (1.0 + np.exp(-self.usual)))

    @property
    def interval(self) -> tuple[float, float]:
        """90 % credible."""
        low, high = quantiles(FINE, self.shares, [TAIL, 1.0 - TAIL])
        return float(expit(low)), float(expit(high))

    @property
    def log_factor(self) -> float:
        """Log of how many times the odds are what they were before any machine."""
        return float(logit(self.mean) - logit(self.before @ expit(FINE)))


@dataclass(frozen=True)
class Hierarchy:
    """usual (p,): today's log prior odds at each place; likely (p, j, g): log likelihood of what all machines said."""

    usual: Array
    likely: Array

    @cached_property
    def sizes(self) -> Array:
        """(s,) share of each size among machines that have the effect."""
        joint = self._effect + self._messages.sum(axis=0)
        shares = np.exp(joint - logsumexp(joint)).sum(axis=0)
        return np.asarray(shares @ KERNEL)

    def place(self, k: int) -> Posterior:
        """Of one place."""
        others = self._effect + np.delete(self._messages, k, axis=0).sum(axis=0)
        return self._at(float(self.usual[k]), others, self._fine[k])

    @cached_property
    def elsewhere(self) -> Posterior:
        """Of a place that no machine has, whose prior is the mean of the others'."""
        nothing = np.zeros((len(SLAB), len(FINE)))
        return self._at(float(np.mean(self.usual)), self._effect + self._messages.sum(axis=0), nothing)

    def _at(self, usual: float, effect: Array, likely: Array) -> Posterior:
        """From log weights (t, j) of the effect and the log likelihood (j, f) of the place's own machines."""
        around = _around(usual)
        weight = np.exp(effect - logsumexp(effect))
        shares = np.sum((around.T @ weight).T * np.exp(likely - likely.max()), axis=0)
        start = np.exp(self._effect - logsumexp(self._effect)).sum(axis=1)
        before = around.T @ start
        return Posterior(usual, shares / shares.sum(), before / before.sum())

    @cached_property
    def _effect(self) -> Array:
        """(t, j) log prior of an effect."""
        return np.asarray(effect_steps(float(np.mean(self.usual)))[:, None] + np.log(SLAB))

    @cached_property
    def _fine(self) -> Array:
        """(p, j, f) log likelihoods on the fine grid."""
        return np.asarray(CubicSpline(LOG_ODDS, self.likely, axis=2)(FINE))

    @cached_property
    def _messages(self) -> Array:
        """(p, t, j) what the machines of each place say of the effect."""
        out = np.empty((len(self.usual), len(STEPS), len(SLAB)))
        for k, usual in enumerate(self.usual.tolist()):
            top = self._fine[k].max()
            told = _around(usual) @ np.exp(self._fine[k] - top).T
            out[k] = np.log(np.maximum(told, 1e-300)) + top
        return out


def single(usual: float, likely: Array) -> Posterior:
    """The same of one frequency that has no like, from log likelihoods (g,)."""
    around = _around(usual)
    before = around.T @ np.exp(effect_steps(usual))
    fine = CubicSpline(LOG_ODDS, likely)(FINE)
    shares = before * np.exp(fine - fine.max())
    return Posterior(usual, shares / shares.sum(), before / before.sum())


def _around(usual: float) -> Array:
    """(t, f) how places of log prior odds ``usual`` scatter about their effect."""
    log = -0.5 * ((FINE - usual - STEPS[:, None]) / FLEET_PLACES) ** 2
    weight = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def effect_steps(usual: float) -> Array:
    """(t,) log prior of an effect's step, about the m of which the expected frequency is the usual one."""
    frequency = _around(usual) @ expit(FINE)

    def weights(m: float) -> Array:
        log = -0.5 * ((STEPS - m) / FLEET_ODDS) ** 2
        return np.asarray(np.exp(log - logsumexp(log)))

    def excess(m: float) -> float:
        return float(weights(m) @ frequency - expit(usual))

    low, high = -6.0, 6.0
    m = brentq(excess, low, high) if excess(low) * excess(high) < 0.0 else low
    return np.log(np.maximum(weights(float(m)), 1e-300))


def quantiles(values: Array, shares: Array, at: Sequence[float]) -> list[float]:
    """Of a distribution on a grid, each share spread evenly around its value."""
    middle = np.cumsum(shares) - 0.5 * shares
    return [float(value) for value in np.interp(at, middle, values)]
