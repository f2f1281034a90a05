"""Estimates of a machine's parameters from a recording: maximum a posteriori, drawing tolerances the prior.

Use ``estimate`` for a fit under tolerances, with ``widen`` for the free fit beside it and ``loss="huber"``
against outliers. Parameters are scaled by their tolerance, readings by sigma, before anything is decomposed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError, InputError
from truepose.identification.leastsquares import Solution, Status, minimise
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine

Array = NDArray[np.float64]
FREE_WIDENING = 100.0
"""The free fit's tolerances, in drawing tolerances: they decide nothing, and the fit stays solvable.

Frames keep theirs: moving the whole chain between base and tool changes no reading, so widening them too
would only add a long curved valley to walk down.
"""
FREE_TOLERANCE = 1e-4
"""The free fit ends when what is left to gain is below this share of the readings; it serves to show chi2."""
FREE_LIMIT = 400
ROUNDING = 1e-8
"""Components of undetermined directions below this are rounding."""
HUBER = 1.345
REWEIGHTINGS = 12
SETTLED = 3e-3


@dataclass(frozen=True)
class Prior:
    """Gaussian prior of every entry of p: mean, 1-sigma (0 fixed, inf none), scale of step, class of part."""

    names: tuple[str, ...]
    mean: Array
    sigma: Array
    scale: Array
    parts: tuple[str, ...]

    @property
    def free(self) -> NDArray[np.intp]:
        """Indices of what is estimated."""
        return np.flatnonzero(self.sigma > 0)

    def widened(self, factor: float) -> Prior:
        """Every tolerance multiplied, but those of frames."""
        wide = np.array([1.0 if part == "frame" else factor for part in self.parts])
        return replace(self, sigma=self.sigma * wide)


def prior_of(machine: Machine, effects: Sequence[PlacedEffect] = ()) -> Prior:
    """Tolerances for geometry; for effects their spread, by default 100 times their largest size."""
    parameters = machine.parameters
    names = [p.name for p in parameters]
    mean, sigma = [p.nominal for p in parameters], [p.tolerance for p in parameters]
    scale, parts = [p.scale for p in parameters], [p.part for p in parameters]
    for effect in effects:
        for c in effect.coefficients:
            names.append(f"{effect.label}:{c.name}")
            mean.append(0.0)
            sigma.append(effect.spread * c.scale)
            scale.append(c.scale)
            parts.append("effect")
    return Prior(tuple(names), np.array(mean), np.array(sigma), np.array(scale), tuple(parts))


@dataclass(frozen=True)
class Estimate:
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

    @property
    def prior_weight(self) -> Array:
        """Scale over tolerance of each free entry; 0 without a prior."""
        free = self.prior.free
        return np.where(
            np.isinf(self.prior.sigma[free]), 0.0, self.prior.scale[free] / self.prior.sigma[free]
        )

    @cached_property
    def covariance(self) -> Array:
        """(n_free, n_free) posterior covariance; directions nothing determines have a variance of 1e30."""
        free = self.prior.free
        rows = np.vstack([self.factor[:, : len(free)], np.diag(self.prior_weight)])
        _, s, vt = np.linalg.svd(rows, full_matrices=False)
        known = s > 1e-12 * np.max(s, initial=1e-300)
        vt = np.where(
            ~known[:, None] & (np.abs(vt) < ROUNDING), 0.0, vt
        )  # else rounding times 1e15 drowns all
        inverse = np.where(known, 1.0 / np.maximum(s, 1e-300), 1e15)
        root = (vt.T * inverse) * self.prior.scale[free][:, None]
        out: Array = root @ root.T
        return out

    @property
    def std(self) -> Array:
        """(np,) posterior 1-sigma; 0 for what is fixed."""
        out = np.zeros(len(self.p))
        out[self.prior.free] = np.sqrt(np.diag(self.covariance))
        return out

    @cached_property
    def null_space(self) -> Array:
        """(k, n_free) directions, in tolerances, that the readings alone cannot see."""
        _, s, vt = np.linalg.svd(self.factor[:, : len(self.prior.free)])
        out: Array = vt[s <= 1e-9 * max(float(s[0]), 1e-300)]
        return out

    @property
    def rank(self) -> int:
        """How many directions of the free parameters the readings determine."""
        return len(self.prior.free) - len(self.null_space)

    @property
    def effective_parameters(self) -> float:
        """Trace of the readings' share of the information: degrees of freedom that were really used."""
        n = len(self.prior.free)
        h = self.factor[:, :n].T @ self.factor[:, :n]
        total = h + np.diag(self.prior_weight**2)
        return float(np.trace(np.linalg.lstsq(total, h, rcond=1e-14)[0]))

    @property
    def readings(self) -> int:
        """Number of fitted readings."""
        return int(np.sum(self.residual[self.used] != 0.0))

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals of the fitted rows."""
        return float(np.sum(self.residual[self.used] ** 2))

    @property
    def chi2_per_dof(self) -> float:
        """chi2 over readings less effective parameters."""
        return self.chi2 / max(self.readings - self.effective_parameters, 1.0)

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
    recording: Recording,
    effects: Sequence[PlacedEffect] = (),
    *,
    widen: float = 1.0,
    loss: str = "gauss",
    start: Array | None = None,
    exclude: NDArray[np.bool_] | None = None,
    prior: Prior | None = None,
    predictor: Predictor | None = None,
    damping: float | None = None,
) -> Estimate:
    """Fit ``machine`` (with ``effects``) to the calibration rows of ``recording``.

    ``exclude`` leaves rows out; rows that cannot be assembled are left out and listed. Raises InputError for
    too few rows, ConvergenceError naming the parameters responsible when no minimum is reached.
    """
    predictor = predictor or Predictor(machine, recording, effects)
    prior = (prior or prior_of(machine, effects)).widened(widen)
    p = predictor.model.p_home.copy() if start is None else start.astype(float)
    used = ~recording.validation if exclude is None else ~recording.validation & ~exclude
    problem = _Problem(predictor, prior, p, used)
    _check_size(problem, recording)
    tolerance, limit = (1e-9, 100) if widen == 1.0 else (FREE_TOLERANCE * problem.readings, FREE_LIMIT)
    # a fit under tolerances is well posed and takes full steps; the free fit walks down curved valleys
    damping = (0.0 if widen == 1.0 else 1e-4) if damping is None else damping
    solution = _robust(
        problem, loss, partial(minimise, problem.blocks, damping=damping, tolerance=tolerance, limit=limit)
    )
    if not solution.status.ok:
        raise ConvergenceError(_blame(solution, prior))
    return problem.result(solution, tuple(effects))


class _Problem:
    """The whitened least-squares problem in scaled steps t from p: readings, then prior."""

    def __init__(self, predictor: Predictor, prior: Prior, p: Array, used: NDArray[np.bool_]) -> None:
        self.predictor, self.prior, self.p, self.used = predictor, prior, p, used
        self.weights = np.ones(len(used))
        self.x, good = predictor.assemble(p)
        self.unassembled = tuple(int(k) for k in np.flatnonzero(~good & used))
        self.used = used & good
        self.readings = int(self.used.sum()) * len(predictor.channels)

    def at(self, t: Array) -> Array:
        p = self.p.copy()
        p[self.prior.free] += self.prior.scale[self.prior.free] * t
        return p

    def blocks(self, t: Array) -> Iterable[Array]:
        p = self.at(t)
        x, good = self.predictor.assemble(p, self.x)
        if not good[self.used].all():
            yield np.full((1, len(t) + 1), np.nan)
            return
        self.x = np.where(good[:, None], x, self.x) if x.shape[1] else x
        yield from self.data(p, self.x)
        yield self.prior_rows(p)

    def data(self, p: Array, x: Array) -> Iterable[Array]:
        free, root = self.prior.free, np.sqrt(self.weights)
        for block in self.predictor.blocks(p, x):
            rows = np.flatnonzero(self.used[block.rows])
            w = root[block.rows][rows, None]
            jacobian = block.jacobian[rows][:, :, free] * self.prior.scale[free] * w[..., None]
            stacked = np.concatenate([jacobian, (block.residual[rows] * w)[..., None]], axis=2)
            yield stacked.reshape(-1, len(free) + 1)

    def prior_rows(self, p: Array) -> Array:
        free = self.prior.free
        sigma = self.prior.sigma[free]
        weight = np.where(np.isinf(sigma), 0.0, self.prior.scale[free] / sigma)
        pull = np.where(np.isinf(sigma), 0.0, (p[free] - self.prior.mean[free]) / sigma)
        return np.column_stack([np.diag(weight), pull])

    def residuals(self, p: Array, x: Array) -> Array:
        return np.concatenate([block.residual for block in self.predictor.blocks(p, x)])

    def result(self, solution: Solution, effects: tuple[PlacedEffect, ...]) -> Estimate:
        from truepose.identification.leastsquares import triangular

        p = self.at(solution.t)
        x, _ = self.predictor.assemble(p, self.x)
        factor = triangular(self.data(p, x), len(self.prior.free) + 1)
        return Estimate(
            self.predictor.machine,
            effects,
            self.prior,
            p,
            x,
            self.residuals(p, x),
            self.used,
            self.weights,
            factor,
            solution,
            self.unassembled,
        )


def _robust(problem: _Problem, loss: str, solve: Callable[[Array], Solution]) -> Solution:
    """Plain least squares, or Huber's loss on whole rows by reweighting until the weights settle."""
    solution = solve(np.zeros(len(problem.prior.free)))
    if loss == "gauss":
        return solution
    for _ in range(REWEIGHTINGS):
        if not solution.status.ok:
            break
        size = np.sqrt(np.mean(problem.residuals(problem.at(solution.t), problem.x) ** 2, axis=1))
        scale = max(float(np.median(size[problem.used])), 1e-300)
        weights = np.minimum(1.0, HUBER * 1.2 * scale / np.maximum(size, 1e-300))
        settled = np.max(np.abs(weights - problem.weights)[problem.used]) < SETTLED
        problem.weights = weights
        solution = solve(solution.t)
        if settled:
            break
    return solution


def _check_size(problem: _Problem, recording: Recording) -> None:
    known = int(np.sum(np.isfinite(problem.prior.sigma[problem.prior.free])))
    free = len(problem.prior.free)
    if problem.readings < free - known or problem.readings == 0:
        raise InputError(
            f"{', '.join(recording.files)}: found {int(problem.used.sum())} usable rows "
            f"({problem.readings} readings), expected at least as many readings as the {free - known} "
            "parameters without a finite tolerance"
        )


def _blame(solution: Solution, prior: Prior) -> str:
    """Name the parameters that still move most, in their own scale."""
    names = np.array(prior.names)[prior.free]
    moved = np.abs(solution.movement)
    worst = [str(n) for n in names[np.argsort(-moved)[:3]]]
    return (
        f"the fit did not converge: {solution.status.value} after {solution.iterations} iterations; "
        f"responsible: {', '.join(worst)} (largest last steps); "
        "check their nominal values and units, or state tolerances for them"
    )


__all__ = ["Estimate", "Prior", "Status", "estimate", "prior_of"]
