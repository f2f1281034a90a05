"""Frequencies of an effect at its places, which are alike but not the same: a tree of three levels, summed out on grids.

    t_e  ~ N(m, FLEET_ODDS^2)          how far the log odds of the effect are from today's prior l
    l_p + t_p,  t_p ~ N(t_e, FLEET_PLACES^2)     those of each place p;   usual size j ~ slab, one for the effect
    machines ~ ``likelihood.of_frequency`` given both

m is such that without any machine the expected frequency is today's prior. A place hears of the others through t_e alone, so
each is summed out once, and its own posterior is the others' message times what its own machines say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import expit, logit, logsumexp

from truepose.arrays import Array
from truepose.identification.leaves.fleet.likelihood import KERNEL, LOG_ODDS, SLAB
from truepose.identification.prior import FLEET_ODDS, FLEET_PLACES

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
        return self._at(
            float(np.mean(self.usual)),
            self._effect + self._messages.sum(axis=0),
            np.zeros((len(SLAB), len(FINE))),
        )

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
