"""Between which values parameters may be: what physics says, and what the user's machine file says.

Lengths of rods are positive, components of unit vectors stay within one, coefficients of effects keep their
physical bounds; ``bounds:`` of a machine file, ``{leg1.length: [499, 501]}`` in the file's units, narrows them.

Bounds that a fit left are kept: physical signs and sizes of effects hold in what is written.

Gauss-Newton knows no bounds. Where its minimum has coefficients of effects beyond theirs (a compliance below zero), the
linear problem there is solved once more under bounds (``scipy.optimize.lsq_linear``), what stands at a bound is held
there, and the rest is fitted again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate, result
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.problem import Prior, Problem
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Direction, Parameter
from truepose.models.units import convert
from truepose.wording import close_matches

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


AT_BOUND = 1e-9
"""Part of a step's size that still counts as standing at a bound."""


@dataclass(frozen=True)
class Bounds:
    """low, high (np,) of every entry of p (mm, rad, an effect's own unit); stated (np,): by the user."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: Array
    high: Array
    stated: Mask

    def steps(self, problem: Problem) -> tuple[Array, Array]:
        """(n_free,) the same for the scaled steps of a problem."""
        free, scale = problem.prior.free, problem.prior.scale[problem.prior.free]
        return (self.low[free] - problem.p[free]) / scale, (self.high[free] - problem.p[free]) / scale

    def notes(self, prior: Prior, p: Array, *, kept: bool) -> list[str]:
        """What of ``p`` (np,) stands at a bound, and, of a solver that keeps none, what is beyond one the user stated."""
        out = []
        for k in prior.free:
            margin = AT_BOUND * prior.scale[k]
            beyond = p[k] < self.low[k] - margin or p[k] > self.high[k] + margin
            at = not beyond and (p[k] < self.low[k] + margin or p[k] > self.high[k] - margin)
            value = f"{self.names[k]} = {p[k]:.9g} {self.units[k]}"
            if beyond and self.stated[k] and not kept:
                within = f"[{self.low[k]:.9g}, {self.high[k]:.9g}]"
                out.append(f"{value} is out of its bounds {within}; --solver ipopt keeps bounds")
            elif at and kept:
                out.append(f"{value} stands at its bound; its std is that without the bound")
        return out


def bounds_of(machine: Machine, effects: Sequence[PlacedEffect] = ()) -> Bounds:
    """Bounds of every parameter and coefficient.

    Raises InputError naming file and field for a name that means nothing and for bounds that are empty.
    """
    names = [*(p.name for p in machine.parameters), *(n for e in effects for n in e.parameter_names)]
    units = [*(p.unit for p in machine.parameters), *(c.unit for e in effects for c in e.coefficients)]
    low, high = coefficient_bounds(machine, effects)
    for rod in machine.mechanism.rods:
        if rod.length in names:
            low[names.index(rod.length)] = 0.0
    for direction in directions(machine):
        for name in direction:
            low[names.index(name)], high[names.index(name)] = -1.0, 1.0
    stated = np.zeros(len(names), dtype=bool)
    for name, given in (machine.file.bounds if machine.file else {}).items():
        k = _place(name, names, machine)
        first, last = _internal(given, machine.geometry.get(name), machine)
        low[k], high[k], stated[k] = max(low[k], first), min(high[k], last), True
        if low[k] >= high[k]:
            raise InputError(
                f"{_where(machine)}.{name}: found {list(given)}, expected bounds with values that physics allows"
            )
    return Bounds(tuple(names), tuple(units), low, high, stated)


def directions(machine: Machine) -> list[tuple[str, ...]]:
    """Names of the components that are parameters of each unit vector: their squares add to less than one."""
    axes = [joint.axis for joint in machine.mechanism.joints if isinstance(joint.axis, Direction)]
    return [tuple(name for name in axis.components if name is not None) for axis in axes]


def _where(machine: Machine) -> str:
    return f"{machine.file.path if machine.file else machine.name}: bounds"


def _place(name: str, names: Sequence[str], machine: Machine) -> int:
    if name not in names:
        raise InputError(f"{_where(machine)}.{name}: no such parameter; {close_matches(name, names)}")
    return names.index(name)


def _internal(
    given: tuple[float, float], parameter: Parameter | None, machine: Machine
) -> tuple[float, float]:
    """Bounds in mm and rad; those of effects, and plain numbers, are in their own unit already."""
    if parameter is None:
        return given
    own = parameter.written_in(machine.units)
    return convert(given[0], own, parameter.unit), convert(given[1], own, parameter.unit)
