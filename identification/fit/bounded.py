"""Bounds that a fit left are kept: physical signs and sizes of effects hold in what is written.

Gauss-Newton knows no bounds. Where its minimum has coefficients of effects beyond theirs (a compliance below zero), the
linear problem there is solved once more under bounds (``scipy.optimize.lsq_linear``), what stands at a bound is held
there, and the rest is fitted again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from truepose.arrays import Array, Mask
from truepose.identification.fit.estimate import Estimate, estimate, result
from truepose.identification.fit.problem import Problem
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

ROUNDS = 5
"""Most times that further coefficients are held at their bounds."""
ROUNDING = 1e-9
"""Share of a coefficient's scale by which it may lie beyond a bound: that is rounding."""


def coefficient_bounds(machine: Machine, effects: Sequence[PlacedEffect]) -> tuple[Array, Array]:
    """(np,) lowest and highest value of every entry of p: those of effects' coefficients; geometry has none here."""
    free = np.full(len(machine.parameters), np.inf)
    coefficients = [c for effect in effects for c in effect.coefficients]
    low = np.append(-free, [c.lower for c in coefficients])
    return low, np.append(free, [c.upper for c in coefficients])


def beyond(fit: Estimate) -> Mask:
    """(np,) entries of p beyond their bounds."""
    low, high = coefficient_bounds(fit.nominal, fit.effects)
    margin = ROUNDING * fit.prior.scale
    return np.asarray((fit.p < low - margin) | (fit.p > high + margin))


def within_bounds(fit: Estimate, recording: Recording, exclude: Mask) -> Estimate:
    """The fit, or the one that keeps all bounds where it does not; ``exclude`` (n,): rows that were left out of it.

    Its covariance is that at the bounded minimum without the bounds: a coefficient at its bound has the 1-sigma that
    readings and prior give it. Raises ConvergenceError where the rest finds no minimum.
    """
    if not beyond(fit).any():
        return fit
    low, high = coefficient_bounds(fit.nominal, fit.effects)
    held, current = np.zeros(len(fit.p), dtype=bool), fit
    for _ in range(ROUNDS):
        start = _bounded_step(current, low, high)
        held |= np.isclose(start, low, rtol=0.0, atol=ROUNDING * fit.prior.scale) & np.isfinite(low)
        held |= np.isclose(start, high, rtol=0.0, atol=ROUNDING * fit.prior.scale) & np.isfinite(high)
        prior = fit.prior.with_sigma(np.where(held, 0.0, fit.prior.sigma))
        current = estimate(fit.nominal, recording, fit.effects, start=start, exclude=exclude, prior=prior)
        if not beyond(current).any():
            break
    predictor = Predictor(fit.nominal, recording, fit.effects)
    problem = Problem(predictor, fit.prior, np.clip(current.p, low, high), current.used, slim=True)
    kept = result(problem, replace(current.solution, t=problem.nothing), fit.effects)
    return replace(kept, noise=fit.noise)


def _bounded_step(fit: Estimate, low: Array, high: Array) -> Array:
    """(np,) the minimum of the linear problem at a fit, within bounds."""
    free = fit.prior.free
    scale = fit.prior.scale[free]
    weight = fit.prior_weight
    pull = np.where(weight > 0.0, weight * (fit.p - fit.prior.mean)[free] / scale, 0.0)
    rows = np.vstack([fit.slopes, np.diag(weight)])
    left = np.append(fit.factor[:, -1], pull)
    here = fit.p[free]
    least, most = (low[free] - here) / scale, (high[free] - here) / scale
    step = lsq_linear(rows, -left, (least, np.maximum(most, least + 1e-12)), method="bvls").x
    out = np.clip(fit.p, low, high)
    out[free] = np.clip(here + scale * step, low[free], high[free])
    return np.asarray(out)


__all__ = ["beyond", "coefficient_bounds", "within_bounds"]
