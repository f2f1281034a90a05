"""Estimates of a machine's parameters from a recording: maximum a posteriori, drawing tolerances the prior.

Use ``estimate`` for a fit under tolerances, with ``widen`` for the free fit beside it and ``loss="huber"``
against outliers. Parameters are scaled by their tolerance, readings by sigma, before anything is decomposed.

Huber's loss on whole rows, by least squares that are weighed again until the weights settle.

Which tolerances a fit may give up: those of parameters that the readings can tell from each other.

A description with more constants than readings can see (every joint frame of a graph has six) leaves
directions along which a fit under wide tolerances only wanders. Widening an independent set of the
parameters gives the readings all the freedom that they can use, to first order; the rest stay as stated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import qr

from truepose.arrays import Array, Index, Mask
from truepose.errors import ConvergenceError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import Solution, minimise, triangular, triangular_parts
from truepose.identification.fit.noise import channel_groups
from truepose.identification.fit.problem import Prior, Problem, prior_of
from truepose.identification.prediction.predictor import FIT, Predictor, told
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

HUBER = 1.345
REWEIGHTINGS = 12
SETTLED = 3e-3


def robust(problem: Problem, loss: str, solve: Callable[[Array], Solution]) -> Solution:
    """The minimum from scaled steps of zero: of plain least squares (``gauss``), or with ``problem.weights`` of the loss."""
    solution = solve(problem.nothing)
    if loss == "gauss":
        return solution
    for _ in range(REWEIGHTINGS):  # far rows may be why plain least squares found no rest
        squares = problem.residuals(problem.at(solution.t), problem.x) ** 2
        size = np.sqrt(np.sum(squares, axis=1) / told(squares, problem.lost))
        scale = max(float(np.median(size[problem.used])), 1e-300)
        weights = np.minimum(1.0, HUBER * 1.2 * scale / np.maximum(size, 1e-300))
        settled = np.max(np.abs(weights - problem.weights)[problem.used]) < SETTLED
        problem.weights = weights
        solution = solve(solution.t)
        if settled:
            break
    return solution


LEAST_SHOWN = 0.1
"""Sigmas that a widened tolerance must move the readings by, beside all others, to count."""
FRAME = "frame"


def widened(problem: Problem, factor: float) -> Prior:
    """The problem's prior with the tolerances of an independent set of parameters multiplied.

    The set is found by pivoted QR of the readings' Jacobian at the start, columns in widened tolerances.
    Frames keep theirs: moving the whole chain between base and tool changes no reading. Frames and unknown
    parameters (infinite tolerance) come first in the order, since they are free already.
    """
    prior, free = problem.prior, problem.prior.free
    sigma = prior.sigma[free]
    unknown = np.isinf(sigma)
    first = unknown | np.array([prior.parts[k] == FRAME for k in free], dtype=bool)
    size = np.where(unknown, 1.0, sigma / prior.scale[free])
    factored = triangular(problem.data(problem.p, problem.x), len(free) + 1)[:, : len(free)]
    jacobian = factored * size * factor
    chosen = free[~first][independent_columns(jacobian[:, first], jacobian[:, ~first])]
    multiplied = prior.sigma.copy()
    multiplied[chosen] *= factor
    return prior.with_sigma(multiplied)


def untied(problem: Problem) -> Prior:
    """No tolerances for an independent set of the parameters; the rest, and what is exactly known, are held.

    The set holds what the readings see by a tenth of a sigma a tolerance at least: what they see worse is left
    to the drawing, since an estimate from readings alone would stray by more than ten tolerances.
    """
    prior, free = problem.prior, problem.prior.free
    sigma = prior.sigma[free]
    size = np.where(np.isinf(sigma), 1.0, sigma / prior.scale[free])
    jacobian = triangular(problem.data(problem.p, problem.x), len(free) + 1)[:, : len(free)] * size
    chosen = np.zeros(len(prior.sigma))
    chosen[free[independent_columns(jacobian[:, :0], jacobian)]] = np.inf
    return prior.with_sigma(chosen)


def independent_columns(taken: Array, columns: Array) -> Index:
    """Places of the columns that show something new beside ``taken`` and each other."""
    if not columns.shape[1] or not np.isfinite(columns).all():
        return np.arange(columns.shape[1])
    if taken.shape[1]:
        left, size, _ = np.linalg.svd(taken, full_matrices=False)
        span = left[:, size > 1e-12 * max(float(np.max(size)), 1e-300)]
        columns = columns - span @ (span.T @ columns)
    upper, order = qr(columns, mode="r", pivoting=True)
    shown = np.abs(np.diag(upper)) > LEAST_SHOWN
    return np.asarray(order[: len(shown)][shown], dtype=np.intp)


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


def estimate(
    machine: Machine,
    recording: Recording,
    effects: Sequence[PlacedEffect] | None = None,
    *,
    widen: float = 1.0,
    loss: str = "gauss",
    start: Array | None = None,
    exclude: Mask | None = None,
    prior: Prior | None = None,
    predictor: Predictor | None = None,
    damping: float | None = None,
    tolerance: float = TOLERANCE,
    solver: Solver | None = None,
    noise: float = 1.0,
) -> Estimate:
    """Fit ``machine`` with ``effects``, by default its own, to the calibration rows of ``recording``.

    ``damping`` is that of the first step; without it full steps are taken, and damped ones where those find no minimum.
    ``start`` (np,) are parameters and coefficients to begin with, mm and rad; ``exclude`` (n,) leaves rows out; rows that
    cannot be assembled are left out. A fit that is not widened ends when half the sum of squares has less than ``tolerance``
    left to gain. ``solver`` takes the place of damped Gauss-Newton. ``noise``: how many times noisier than stated readings are
    (``Estimate.noise``), where that is known; it decides what tolerances and expected sizes weigh beside them. Raises
    InputError for too few rows, ConvergenceError naming the parameters responsible.
    """
    effects = machine.effects if effects is None else effects
    predictor = predictor or Predictor(machine, recording, effects, visits=FIT)
    prior = prior or prior_of(machine, effects)
    prior = prior.with_sigma(prior.sigma / noise) if noise != 1.0 else prior
    p = predictor.model.p_home.copy() if start is None else start.astype(float)
    used = ~recording.validation if exclude is None else ~recording.validation & ~exclude
    problem = Problem(predictor, prior, p, used, slim=solver is None and widen == 1.0)
    if widen != 1.0:
        prior = widened(problem, widen)
        problem = Problem(predictor, prior, p, used)
        tolerance = FREE_TOLERANCE * problem.n_observations
    solution = _first_that_ends(problem, loss, _tries(problem, widen != 1.0, solver, damping, tolerance))
    return replace(result(problem, solution, tuple(effects)), noise=noise)


def _first_that_ends(problem: Problem, loss: str, tries: Sequence[Callable[..., Solution]]) -> Solution:
    """The solution of the first try that finds a minimum. Raises ConvergenceError where none does."""
    for descend in tries:
        solution = robust(problem, loss, descend)
        if solution.status.ok:
            return solution
    moved = replace(solution, movement=problem.lifted(solution.movement))
    raise ConvergenceError("; ".join([blame(moved, problem.prior), *problem.predictor.cautions]))


def _tries(
    problem: Problem, free: bool, solver: Solver | None, damping: float | None, tolerance: float
) -> list[Callable[..., Solution]]:
    """The solver; without one damped Gauss-Newton, one try after another: fewer for a ``free`` fit, one at a given damping."""
    if solver is not None:
        return [partial(solver, problem)]
    tries = FREE_TRIES if free else TRIES
    if damping is not None:
        tries = ((damping, tries[0][1]),)
    common = partial(minimise, problem.blocks, tolerance=tolerance)
    return [partial(common, damping=first, limit=limit) for first, limit in tries]


@dataclass(frozen=True)
class Minimum:
    """Where a fit ended: p (np,), x (n, nx), used (n,) rows, and residual (n, m), NaN in rows that nobody asked for."""

    p: Array
    x: Array
    residual: Array
    used: Mask


def fit_without(
    model: Estimate,
    predictor: Predictor,
    exclude: Mask,
    rows: Mask,
    tolerance: float,
) -> Minimum:
    """Fit what ``model`` holds, from where it is, to all calibration rows but ``exclude`` (n,), for the residuals of ``rows``.

    What the fit knows of itself is not worked out, for that takes a pass over the rows. ``predictor`` is that of the model's
    effects. Raises InputError for too few rows and ConvergenceError where no minimum is found.
    """
    used = ~model.recording.validation & ~exclude
    problem = Problem(predictor, model.prior, model.p.astype(float), used, slim=True, turn=model.turn)
    solution = _first_that_ends(problem, "gauss", _tries(problem, False, None, None, tolerance))
    p, x = _there(problem, solution)
    return Minimum(p, x, problem.residuals_of(rows, p, x), problem.used)


def _there(problem: Problem, solution: Solution) -> tuple[Array, Array]:
    """Parameters (np,) and passive coordinates (n, nx) of a solution."""
    p = wrapped(problem.predictor.machine, problem.at(solution.t))
    return p, problem.predictor.assemble(p, problem.x)[0]


def result(problem: Problem, solution: Solution, effects: tuple[PlacedEffect, ...]) -> Estimate:
    """What a solution says of the parameters, with the readings' factor and all residuals there."""
    p, x = _there(problem, solution)
    groups = list(channel_groups(problem.predictor.machine).values())
    columns = len(problem.nothing) + 1
    parts = triangular_parts(problem.data(p, x), columns, groups)
    return Estimate(
        nominal=problem.predictor.machine,
        recording=problem.predictor.recording,
        effects=effects,
        prior=problem.prior,
        p=p,
        x=x,
        residual=problem.residuals(p, x),
        used=problem.used,
        weights=problem.weights,
        factor=parts[0] if len(parts) == 1 else triangular(parts, columns),
        solution=solution,
        unassembled=problem.unassembled,
        levels=problem.levels,
        lost=problem.lost,
        parts=tuple(parts),
        turn=problem.turn,
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
