"""Estimates of a machine's parameters from a recording: maximum a posteriori, drawing tolerances the prior.

Use ``estimate`` for a fit under tolerances, with ``widen`` for the free fit beside it and ``loss="huber"``
against outliers. Parameters are scaled by their tolerance, readings by sigma, before anything is decomposed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.leastsquares import Solution, Status, minimise, triangular, triangular_parts
from truepose.identification.fit.noise import Scatter, channel_groups
from truepose.identification.fit.problem import Prior, Problem, prior_of
from truepose.identification.fit.relinearised import Shrunk
from truepose.identification.fit.robust import robust
from truepose.identification.fit.widening import widened
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.load import Sources, as_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine
from truepose.shown.result import Shown, frame_of

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
Solver = Callable[[Problem, Array], Solution]
"""A problem and where it starts, scaled steps (n_free,), to its minimum."""
FREE_WIDENING = 100.0
"""The free fit's tolerances, in drawing tolerances: they decide nothing, and the fit stays solvable.

Frames keep theirs: moving the whole chain between base and tool changes no reading, so widening them too
would only add a long curved valley to walk down.
"""
TOLERANCE = 1e-9
"""A fit ends when half the sum of squares has less to gain; a step is then 1e-4 of a 1-sigma at most."""
FREE_TOLERANCE = 1e-4
"""The free fit ends when what is left to gain is below this share of the readings; it serves to show chi2."""
STUBBORN = 1e-4
"""Damping of the free fit, and of one that found no minimum with full steps."""
TRIES = ((0.0, 100), (STUBBORN, 400))
"""Damping of the first step and most iterations, one try after another. Under tolerances a fit is well posed and takes full
steps, unless readings and tolerances conflict badly."""
FREE_TRIES = ((STUBBORN, 400),)
"""The same of the free fit, which walks down curved valleys."""
UNKNOWN = 1e15
"""1-sigma, in steps, of a direction that nothing determines."""


@dataclass(frozen=True, repr=False)
class Estimate(Shown):
    """Result of a fit.

    p (np,) parameters then effect coefficients, x (n, nx) passive coordinates, residual (n, m) whitened by
    sigma (NaN where a row cannot be assembled), used (n,) rows that were fitted, weights (n,) of the robust
    loss, factor: triangular factor of [J r] of the readings, columns scaled by ``prior.scale`` and restricted
    to ``prior.free``.
    """

    machine: Machine
    effects: tuple[PlacedEffect, ...]
    prior: Prior
    p: Array
    x: Array
    residual: Array
    used: NDArray[np.bool_]
    weights: Array
    factor: Array
    solution: Solution
    unassembled: tuple[int, ...]
    shrunk: Shrunk | None = None
    """What a linear (biased) estimator knows of itself; it has no prior, and its variance is not J'J's."""
    levels: int = 0
    """Unknowns that compared rows share; they cost readings."""
    lost: NDArray[np.bool_] | None = None
    """(n, m) channels whose reading was lost, with a residual of zero; None where none was."""
    parts: tuple[Array, ...] = ()
    """``factor`` of each sensor's kinds of reading alone, where there are several (``noise.channel_groups``)."""

    def lost_among(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> NDArray[np.bool_] | None:
        """(k, m) channels of some rows whose reading was lost; None where none was."""
        return None if self.lost is None else self.lost[rows]

    @property
    def prior_weight(self) -> Array:
        """(n,) scale over tolerance of each free entry; 0 without a prior."""
        free = self.prior.free
        return np.where(
            np.isinf(self.prior.sigma[free]), 0.0, self.prior.scale[free] / self.prior.sigma[free]
        )

    @cached_property
    def decomposition(self) -> Decomposition:
        """What readings and prior know of the free entries, in steps of ``prior.scale``: one SVD."""
        return Decomposition.of(self.factor[:, : len(self.prior.free)], self.prior_weight)

    @property
    def known(self) -> Decomposition | Shrunk:
        """Whose root and unknown directions are this estimate's: readings and prior, or a biased estimator."""
        return self.decomposition if self.shrunk is None else self.shrunk

    @cached_property
    def scatter(self) -> Scatter:
        """The noise that the fitted readings were found to have, by sensor and kind of reading."""
        if not self.used.any():
            return Scatter((1.0,) * max(len(self.parts), 1))
        residual, n = self.residual[self.used], len(self.prior.free)
        groups, taken = [list(range(residual.shape[1]))], [self.effective_parameters]
        if len(self.parts) > 1 and self.shrunk is None:
            groups = list(channel_groups(self.machine).values())
            taken = [float(np.sum((part[:, :n] @ self.decomposition.root) ** 2)) for part in self.parts]
        levels = [self.levels * len(at) / residual.shape[1] for at in groups]
        used = [a + b for a, b in zip(taken, levels, strict=True)]
        return Scatter.of(residual, self.weights[self.used], groups, used)

    @cached_property
    def root(self) -> Array:
        """(n_free, k) F, in steps of ``prior.scale``: F F' is the covariance of what is determined, with the noise found."""
        found, n = self.scatter, len(self.prior.free)
        if found.as_stated:
            return self.known.root
        if self.shrunk is not None:
            return np.asarray(np.sqrt(found.variance[0]) * self.shrunk.root)
        pairs = zip(found.variance, self.parts or (self.factor,), strict=True)
        return self.decomposition.root_with(found.slope, [np.sqrt(v) * part[:, :n] for v, part in pairs])

    @cached_property
    def posterior(self) -> Array:
        """(n_free, n_free) covariance if every sigma were as stated and the loss plain."""
        return self._spread(self.known.root)

    @cached_property
    def covariance(self) -> Array:
        """(n_free, n_free) covariance with the noise found; directions nothing determines have a variance of 1e30.

        Tolerances are taken as stated; readings as noisy as they were (``truepose.identification.fit.noise``).
        """
        return self._spread(self.root)

    def _spread(self, root: Array) -> Array:
        scale = self.prior.scale[self.prior.free][:, None]
        out = np.hstack([root, UNKNOWN * self.known.unknown.T]) * scale
        return np.asarray(out @ out.T)

    @property
    def std(self) -> Array:
        """(np,) 1-sigma with the noise found; 0 for what is fixed."""
        out = np.zeros(len(self.p))
        out[self.prior.free] = np.sqrt(np.diag(self.covariance))
        return out

    @property
    def null_space(self) -> Array:
        """(k, n_free) directions, in steps of ``prior.scale``, that the readings alone cannot see."""
        return self.decomposition.null_space

    @property
    def rank(self) -> int:
        """How many directions of the free parameters the readings determine."""
        return self.decomposition.rank

    @property
    def effective_parameters(self) -> float:
        """Trace of the readings' share of the information: degrees of freedom that were really used."""
        return self.known.effective

    @property
    def n_observations(self) -> int:
        """Number of fitted readings, less the levels that compared rows share."""
        return int(np.sum(self.residual[self.used] != 0.0)) - self.levels

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals of the fitted rows."""
        return float(np.sum(self.residual[self.used] ** 2))

    @property
    def chi2_per_dof(self) -> float:
        """chi2 over readings less effective parameters."""
        return self.chi2 / max(self.n_observations - self.effective_parameters, 1.0)

    @property
    def in_tolerances(self) -> Array:
        """(np,) (estimate - nominal) / drawing tolerance; 0 where the tolerance is zero or infinite."""
        nominal = np.array([p.nominal for p in self.machine.parameters])
        tolerance = np.array([p.tolerance for p in self.machine.parameters])
        ok = (tolerance > 0) & np.isfinite(tolerance)
        out = np.zeros(len(self.p))
        out[: len(ok)][ok] = (self.p[: len(ok)][ok] - nominal[ok]) / tolerance[ok]
        return out

    @property
    def worst_parameter_sigma(self) -> float:
        """Largest |estimate - nominal| / tolerance."""
        return float(np.max(np.abs(self.in_tolerances), initial=0.0))

    def to_frame(self) -> pd.DataFrame:
        """Free constants, one a row: ``parameter``, ``value``, ``std`` (1-sigma), ``nominal`` (of the drawing), ``unit``,
        ``tolerance``, ``in_tolerances`` ((value - nominal) / tolerance), ``identifiable``.

        mm, rad; coefficients of effects follow in their own units. std is inf where neither readings nor tolerances hold.
        """
        return frame_of(self)

    def fitted_effects(self) -> tuple[PlacedEffect, ...]:
        """The effects with their estimated coefficients."""
        offset, out = len(self.machine.parameters), []
        for effect in self.effects:
            size = len(effect.coefficients)
            out.append(effect.with_values(self.p[offset : offset + size].tolist()))
            offset += size
        return tuple(out)


def estimate(
    machine: Machine,
    recording: Recording | Sources,
    effects: Sequence[PlacedEffect] = (),
    *,
    widen: float = 1.0,
    loss: str = "gauss",
    start: Array | None = None,
    exclude: NDArray[np.bool_] | None = None,
    prior: Prior | None = None,
    predictor: Predictor | None = None,
    damping: float | None = None,
    tolerance: float = TOLERANCE,
    solver: Solver | None = None,
) -> Estimate:
    """Fit ``machine`` (with ``effects``) to the calibration rows of ``recording`` (or of a path, DataFrame or dict).

    ``damping`` is that of the first step; without it full steps are taken, and damped ones where those find no
    minimum. ``start`` (np,) are parameters and
    coefficients to begin with; ``exclude`` (n,) leaves rows out; rows that cannot be assembled are left out and listed.
    A fit that is not widened ends when half the sum of squares has less than ``tolerance`` left to gain. ``solver`` takes the
    place of damped Gauss-Newton. Raises InputError for too few rows, ConvergenceError naming the parameters
    responsible when no minimum is reached.
    """
    recording = as_recording(machine, recording)
    predictor = predictor or Predictor(machine, recording, effects, visits=FIT)
    prior = prior or prior_of(machine, effects)
    p = predictor.model.p_home.copy() if start is None else start.astype(float)
    used = ~recording.validation if exclude is None else ~recording.validation & ~exclude
    problem = Problem(predictor, prior, p, used)
    if widen != 1.0:
        prior = widened(problem, widen)
        problem = Problem(predictor, prior, p, used)
        tolerance = FREE_TOLERANCE * problem.n_observations
    tries = TRIES if widen == 1.0 else FREE_TRIES
    descents = [
        partial(minimise, problem.blocks, damping=steps, tolerance=tolerance, limit=limit)
        for steps, limit in (tries if damping is None else [(damping, tries[0][1])])
    ]
    for descend in [partial(solver, problem)] if solver else descents:
        solution = robust(problem, loss, descend)
        if solution.status.ok:
            break
    else:
        raise ConvergenceError("; ".join([blame(solution, prior), *predictor.cautions]))
    return result(problem, solution, tuple(effects))


def result(problem: Problem, solution: Solution, effects: tuple[PlacedEffect, ...]) -> Estimate:
    """What a solution says of the parameters, with the readings' factor and all residuals there."""
    p = wrapped(problem.predictor.machine, problem.at(solution.t))
    x, _ = problem.predictor.assemble(p, problem.x)
    groups = list(channel_groups(problem.predictor.machine).values())
    parts = triangular_parts(problem.data(p, x), len(problem.prior.free) + 1, groups)
    return Estimate(
        machine=problem.predictor.machine,
        effects=effects,
        prior=problem.prior,
        p=p,
        x=x,
        residual=problem.residuals(p, x),
        used=problem.used,
        weights=problem.weights,
        factor=parts[0] if len(parts) == 1 else triangular(parts, len(problem.prior.free) + 1),
        solution=solution,
        unassembled=problem.unassembled,
        levels=problem.levels,
        lost=problem.lost,
        parts=tuple(parts),
    )


def wrapped(machine: Machine, p: Array) -> Array:
    """(np,) the same parameters, angles (rad) less whole turns that they are from their drawing: at most half a turn stays.

    Every angle of a machine's geometry turns about one axis, so that whole turns change nothing.
    """
    turn, out = 2.0 * np.pi, p.copy()
    for k, parameter in enumerate(machine.parameters):
        if parameter.unit == "rad" and abs(p[k] - parameter.nominal) > np.pi:
            away = p[k] - parameter.nominal
            out[k] -= turn * np.ceil(away / turn - 0.5)
    return out


def blame(solution: Solution, prior: Prior) -> str:
    """Name the parameters that still move most, in their own scale."""
    names = np.array(prior.names)[prior.free]
    moved = np.abs(solution.movement)
    worst = [str(n) for n in names[np.argsort(-moved)[:3]]]
    return (
        f"the fit did not converge: {solution.status.value} after {solution.iterations} iterations; "
        f"responsible: {', '.join(worst)} (largest last steps); "
        "check their nominal values and units, or state tolerances for them"
    )


__all__ = ["Estimate", "Prior", "Solver", "Status", "blame", "estimate", "prior_of", "result", "wrapped"]
