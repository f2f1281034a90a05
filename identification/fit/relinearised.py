"""A linear estimator on a machine: applied to the problem linearised at its own result.

With residuals r and derivative J at a step t from the drawing, the problem linearised there is y = J t' + noise
with y = J t - r. A linear estimator B (``truepose.identification.fit.relinearised``) makes B(J, y) of it; the estimate is
the t that it leaves where it is. For least squares that is Gauss-Newton, for ridge with given k the minimum
of |r|^2 + k |t|^2. What tunes B is chosen anew from each linearisation.

Parameters without a tolerance have no drawing value to be pulled to: they are taken out of the problem before
B sees it and follow by least squares.

Estimators of a linear problem y = H b + noise whose columns are nearly dependent are plain functions of arrays.

``decompose`` makes one SVD of H; an estimate is then a share, between 0 and 1, of each coordinate of the least-squares
solution along the right singular vectors: all of it (``ols``), or less (the leaf ``shrinking``).

The unit of the columns is part of a biased estimator (1 is compared with their squared singular values).
With readings in units of their noise and columns in units of their tolerances, ridge with k = 1 (and Liu with d = 0) is the
maximum a posteriori estimate under those tolerances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.fit.decomposition import ROUNDING, Decomposition
from truepose.identification.fit.leastsquares import Solution, Status, triangular
from truepose.identification.fit.problem import Prior, Problem
from truepose.leaves import modules_named


@dataclass(frozen=True)
class Spectrum:
    """A linear problem by its singular values: y = H b + noise, b = scale * directions @ coordinates.

    values (r,) singular values of the scaled H, largest first; directions (m, r); scale (m,); alpha (r, ...)
    least-squares coordinates of each right-hand side; noise (...) estimated variance of one reading.
    """

    values: Array
    directions: Array
    scale: Array
    alpha: Array
    noise: Array

    def counted_from(self, b: Array) -> Spectrum:
        """The same problem with b counted from ``-b`` (m,): what was zero there is now ``b``.

        Where H b is large and known exactly, it need not be part of y: rounding would be of its size.
        """
        return replace(self, alpha=self.alpha + self.directions.T @ (b / self.scale))


@dataclass(frozen=True)
class LinearEstimate:
    """b (m, ...), the share (r, ...) kept of each least-squares coordinate, and what tuned it (...):
    Liu's d, ridge's k, the number of components."""

    b: Array
    share: Array
    tuning: Array
    spectrum: Spectrum

    def root(self, noise: float | None = None) -> Array:
        """(m, r) F with covariance F F' of the estimate of one right-hand side.

        It is the estimator's variance with its tuning taken as known; bias is not in it. ``noise`` is the
        variance of one reading (default: the estimate).
        """
        variance = float(self.spectrum.noise) if noise is None else noise
        s = self.spectrum
        root: Array = s.scale[:, None] * s.directions * (self.share / s.values * np.sqrt(variance))
        return root

    def covariance(self, noise: float | None = None) -> Array:
        """(m, m) covariance of the estimate of one right-hand side; see ``root``."""
        root = self.root(noise)
        out: Array = root @ root.T
        return out


def decompose(
    h: Array, y: Array, scale: Array | float = 1.0, *, n_observations: int | None = None
) -> Spectrum:
    """The problem of ``h`` (n, m), in steps of ``scale`` (m,), and ``y`` (n,) or (n, k), one column a right-hand side.

    ``n_observations`` is how many there were where ``h`` and ``y`` are a triangular factor of them. Directions that
    no reading sees stay at zero. Raises InputError when no reading is left to tell the noise.
    """
    size = np.broadcast_to(np.asarray(scale, dtype=float), h.shape[1])
    u, s, vt = np.linalg.svd(h * size, full_matrices=False)
    seen = s > ROUNDING * np.max(s, initial=1e-300)
    u, s, vt = u[:, seen], s[seen], vt[seen]
    freedom = (len(h) if n_observations is None else n_observations) - len(s)
    if freedom < 1:
        raise InputError(
            f"found {freedom + len(s)} readings for {len(s)} combinations of parameters, "
            "expected more: what is left over tells the noise"
        )
    along = u.T @ y
    noise = np.sum((y - u @ along) ** 2, axis=0) / freedom
    return Spectrum(s, vt.T, size, (along.T / s).T, noise)


def ols(problem: Spectrum) -> LinearEstimate:
    """Least squares; directions that no reading sees stay at zero. ``tuning`` is the rank."""
    rank = np.full(problem.noise.shape, float(len(problem.values)))
    return shrink(problem, np.ones_like(problem.alpha), rank)


def shrink(problem: Spectrum, share: Array, tuning: Array) -> LinearEstimate:
    """Return the estimate that keeps a ``share`` (r, ...) of each least-squares coordinate."""
    b = (problem.directions @ (share * problem.alpha)).T * problem.scale
    return LinearEstimate(b.T, share, tuning, problem)


Linear = Callable[[Spectrum, float | None], LinearEstimate]
"""A linear problem, and what the estimator is tuned by (None: by its own rule), to an estimate."""
LIMIT = 400
TOLERANCE = 1e-7
"""At rest, no parameter moves by more than this part of its own 1-sigma."""
LOST = 1e-12
"""Steps below this are rounding."""
FROZEN = 5
"""Iterations after which the tuning stays as it is: a number of components may else go to and fro."""
SHORTEST = 1e-3


@dataclass(frozen=True)
class Shrunk:
    """What a linear estimate knows of itself, in the steps of its problem.

    root (n_free, k): the estimator's covariance is root root' (bias is not in it). unknown (j, n_free):
    orthonormal directions that no reading sees. effective: degrees of freedom that the readings use.
    """

    root: Array
    unknown: Array
    effective: float
    tuning: float


def linear_estimators() -> dict[str, tuple[str, Linear]]:
    """Return what each linear estimator is tuned by, and the estimator, by name; the biased ones are of a leaf."""
    found: dict[str, tuple[str, Linear]] = {"ols": ("rank", lambda problem, _: ols(problem))}
    return found | {
        name: one for leaf in modules_named("estimating") for name, one in leaf.ESTIMATORS.items()
    }


def relinearised(
    problem: Problem,
    start: Array,
    drawing: Prior,
    name: str,
    tuning: float | None = None,
) -> tuple[Solution, Shrunk | None]:
    """The estimate from steps ``start`` (n_free,) of a problem without a prior; ``drawing`` states tolerances.

    Columns are in units of the tolerances. ``tuning`` is Liu's d, ridge's k or the number
    of components where its rule is not to choose it. The status tells whether the estimate came to rest.
    Raises InputError when no reading is left over to tell the noise.
    """
    columns, (_, linear) = _Columns(problem, drawing), linear_estimators()[name]
    t, share, last, moved = start.astype(float), 1.0, np.inf, np.zeros(len(start))
    known: Shrunk | None = None
    status = Status.LIMIT
    for iteration in range(1, LIMIT + 1):
        factor = triangular(problem.blocks(t), len(t) + 1)
        if not np.isfinite(factor).all():
            status = Status.FAILED if known is None else Status.STALLED
            break
        frozen = known.tuning if tuning is None and known is not None and iteration > FROZEN else tuning
        aim, known = columns.solved(factor, t, linear, frozen)
        moved, spread = aim - t, np.linalg.norm(np.hstack([known.root, known.unknown.T]), axis=1)
        if np.all(np.abs(moved) <= TOLERANCE * spread + LOST * (1.0 + np.abs(t))):
            t, status = aim, Status.CONVERGED
            break
        size = float(np.max(np.abs(moved) / np.maximum(spread, LOST)))
        share = max(0.5 * share, SHORTEST) if size > last else min(1.0, 2.0 * share)
        t, last = t + share * moved, size
    cost = 0.5 * float(np.sum(factor[:, -1] ** 2))
    return Solution(t, factor, cost, status, iteration, last, moved), known


class _Columns:
    """Steps of the problem as columns of the estimator: t = origin + [loose, or unit * b of what is held].

    held (n_free,) parameters with a tolerance; origin (n_free,) their drawing value and unit (n_held,) their tolerances, in
    steps; n_observations: number of readings.
    """

    def __init__(self, problem: Problem, drawing: Prior) -> None:
        free = problem.prior.free
        step, sigma = problem.prior.scale[free], drawing.sigma[free]
        self.held, self.n_observations = np.isfinite(sigma), problem.n_observations
        self.origin = np.where(self.held, (drawing.mean[free] - problem.p[free]) / step, 0.0)
        self.unit = (sigma / step)[self.held]

    def solved(self, factor: Array, t: Array, linear: Linear, tuning: float | None) -> tuple[Array, Shrunk]:
        """Steps (n_free,) that the estimator makes of the triangular factor of [J r] at ``t``."""
        n, k = len(t), int(np.sum(~self.held))
        j, at = factor[:, :n], t - self.origin
        r = np.asarray(
            np.linalg.qr(np.column_stack([j[:, ~self.held], j[:, self.held], factor[:, n]]), mode="r")
        )
        inverse, rank = _inverse(r[:k, :k])
        problem = decompose(r[k:, k:n], -r[k:, n], self.unit, n_observations=self.n_observations - rank)
        found = linear(problem.counted_from(at[self.held]), tuning)
        follow = -inverse @ r[:k, k:n]  # the loose ones follow the held ones
        steps = self._placed(
            at[~self.held] - inverse @ r[:k, n] + follow @ (found.b - at[self.held]), found.b
        )
        root = found.root(1.0)
        known = Shrunk(
            root=np.hstack([self._placed(follow @ root, root), self._placed(inverse)]),
            unknown=Decomposition.of(j, np.zeros(n)).unknown,
            effective=rank + float(np.sum(found.share)),
            tuning=float(found.tuning),
        )
        return self.origin + steps, known

    def _placed(self, loose: Array, held: Array | float = 0.0) -> Array:
        """Rows of the loose and of the held parameters in the order of the problem."""
        out = np.zeros((len(self.held), *loose.shape[1:]))
        out[~self.held], out[self.held] = loose, held
        return out


def _inverse(r: Array) -> tuple[Array, int]:
    """Pseudo-inverse of a square matrix, and its rank."""
    if not len(r):
        return r, 0
    u, s, vt = np.linalg.svd(r)
    seen = s > ROUNDING * max(float(s[0]), 1e-300)
    return (vt[seen].T / s[seen]) @ u[:, seen].T, int(seen.sum())
