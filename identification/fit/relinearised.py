"""A linear estimator on a machine: applied to the problem linearised at its own result.

With residuals r and derivative J at a step t from the drawing, the problem linearised there is y = J t' + noise
with y = J t - r. A linear estimator B (``truepose.identification.fit.relinearised``) makes B(J, y) of it; the estimate is
the t that it leaves where it is. For least squares that is Gauss-Newton, for ridge with given k the minimum
of |r|^2 + k |t|^2. What tunes B is chosen anew from each linearisation.

Parameters without a tolerance have no drawing value to be pulled to: they are taken out of the problem before
B sees it and follow by least squares.

Estimators of a linear problem y = H b + noise whose columns are nearly dependent: plain functions of arrays.

``decompose`` makes one SVD of H; ``ols``, ``liu``, ``ridge`` and ``pcr`` are then a share, between 0 and 1,
of each coordinate of the least-squares solution along the right singular vectors. All of them take many
right-hand sides at once. Their bias pulls b towards zero: let b count from where it is expected to be.

The unit of the columns is part of a biased estimator (1 is compared with their squared singular values):
``raw`` takes them as they are, ``unit`` makes every column one long, an array states sizes of steps, such as
tolerances. With readings in units of their noise and columns in units of their tolerances, ridge with k = 1
(and Liu with d = 0) is the maximum a posteriori estimate under those tolerances.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.fit.decomposition import ROUNDING, Decomposition
from truepose.identification.fit.leastsquares import Solution, Status, triangular
from truepose.identification.fit.problem import Prior, Problem

Rule = Literal["plug-in", "unbiased"]


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
    h: Array, y: Array, scale: Literal["raw", "unit"] | Array = "raw", *, n_observations: int | None = None
) -> Spectrum:
    """The problem of ``h`` (n, m) and ``y`` (n,) or (n, k), one column a right-hand side.

    ``n_observations`` is how many there were where ``h`` and ``y`` are a triangular factor of them. Directions that
    no reading sees stay at zero. Raises InputError when no reading is left to tell the noise.
    """
    size = column_scale(h) if isinstance(scale, str) and scale == "unit" else np.ones(h.shape[1])
    size = size if isinstance(scale, str) else np.asarray(scale, dtype=float)
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


def column_scale(h: Array) -> Array:
    """(m,) factors that make every column of ``h`` (n, m) one long; 1 for a column of zeros."""
    length = np.linalg.norm(h, axis=0)
    out: Array = 1.0 / np.where(length > 0.0, length, 1.0)
    return out


def ols(problem: Spectrum) -> LinearEstimate:
    """Least squares; directions that no reading sees stay at zero. ``tuning`` is the rank."""
    rank = np.full(problem.noise.shape, float(len(problem.values)))
    return _shrunk(problem, np.ones_like(problem.alpha), rank)


def liu(problem: Spectrum, d: float | None = None, *, rule: Rule = "plug-in") -> LinearEstimate:
    """(H'H + I)^-1 (H'y + d b_ols), 0 <= d <= 1 (Liu 1993; polisher paper, eq. 11); d from ``liu_parameter``."""
    lam = _upright(problem.values**2, problem.alpha)
    tuning = liu_parameter(problem, rule) if d is None else np.full(problem.noise.shape, float(d))
    return _shrunk(problem, (lam + tuning) / (lam + 1.0), tuning)


def liu_parameter(problem: Spectrum, rule: Rule = "plug-in") -> Array:
    """(...) the d that minimises the mean square error, kept within 0 and 1.

    The error of coordinate j is s2 (l + d)^2 / (l (l + 1)^2) + (d - 1)^2 a^2 / (l + 1)^2 (polisher paper,
    eq. 13). Its sum is least at sum (a^2 - s2)/(l + 1)^2 / sum (s2 + l a^2)/(l (l + 1)^2), the paper's eq. 14.
    ``plug-in`` puts the least-squares a there, as the paper does, although its square is s2/l too large on
    average; ``unbiased`` takes a^2 - s2/l, which gives Liu's own 1 - s2 sum 1/(l (l + 1)) / sum a^2/(l + 1)^2
    and shrinks more. The paper divides the sum of squares for s2 by n; here it is n less the rank.
    """
    lam, square = _upright(problem.values**2, problem.alpha), problem.alpha**2
    noise = problem.noise
    if rule == "plug-in":
        above = np.sum((square - noise) / (lam + 1.0) ** 2, axis=0)
        below = np.sum((noise + lam * square) / (lam * (lam + 1.0) ** 2), axis=0)
    else:
        below = np.sum(square / (lam + 1.0) ** 2, axis=0)
        above = below - np.sum(noise / (lam * (lam + 1.0)), axis=0)
    return np.clip(_ratio(above, below), 0.0, 1.0)


def ridge(problem: Spectrum, k: float | None = None) -> LinearEstimate:
    """(H'H + k I)^-1 H'y; k by Hoerl, Kennard and Baldwin (1975): rank * noise / |least-squares b|^2."""
    lam = _upright(problem.values**2, problem.alpha)
    if k is None:
        tuning = _ratio(len(problem.values) * problem.noise, np.sum(problem.alpha**2, axis=0))
    else:
        tuning = np.full(problem.noise.shape, float(k))
    return _shrunk(problem, lam / (lam + tuning), tuning)


def pcr(problem: Spectrum, components: int | None = None) -> LinearEstimate:
    """Least squares on the leading principal components, the rest at zero.

    Their number minimises the estimated mean square error, sum s2/l over what is kept plus sum (a^2 - s2/l)
    over what is dropped (a^2 - s2/l is the unbiased estimate of a coordinate's square).
    """
    lam = _upright(problem.values**2, problem.alpha)
    rank = len(problem.values)
    if components is None:
        gain = 2.0 * problem.noise / lam - problem.alpha**2  # what keeping a coordinate adds to the error
        total = np.concatenate([np.zeros((1, *problem.noise.shape)), np.cumsum(gain, axis=0)])
        number = np.argmin(total, axis=0).astype(float)
    else:
        number = np.full(problem.noise.shape, float(components))
    place = _upright(np.arange(rank, dtype=float), problem.alpha)
    return _shrunk(problem, np.where(place < number, 1.0, 0.0), np.asarray(number))


def _shrunk(problem: Spectrum, share: Array, tuning: Array) -> LinearEstimate:
    b = (problem.directions @ (share * problem.alpha)).T * problem.scale
    return LinearEstimate(b.T, share, tuning, problem)


def _upright(values: Array, like: Array) -> Array:
    """(r,) values as (r, 1) where there are many right-hand sides."""
    return values[:, None] if like.ndim == 2 else values


def _ratio(above: Array, below: Array) -> Array:
    """above / below; 0 where there is nothing to divide."""
    above, below = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
    return np.divide(above, below, out=np.zeros_like(above), where=below > 0.0)


Scaling = Literal["tolerance", "unit", "raw"]
Linear = Callable[[Spectrum], LinearEstimate]
TUNING: Mapping[str, str] = {"ols": "rank", "liu": "d", "ridge": "k", "pcr": "components"}
"""What the linear estimators are tuned by."""
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

    @property
    def step_root(self) -> Array:
        """(n_free, k) ``root`` by the steps that were solved for: these."""
        return self.root


def linear_estimator(name: str, tuning: float | None = None) -> Linear:
    """The estimator of a name, by its own rule or with what tunes it (Liu's d, ridge's k, components) given."""
    known: dict[str, Linear] = {
        "ols": ols,
        "liu": partial(liu, d=tuning),
        "ridge": partial(ridge, k=tuning),
        "pcr": partial(pcr, components=None if tuning is None else round(tuning)),
    }
    return known[name]


def relinearised(
    problem: Problem,
    start: Array,
    drawing: Prior,
    name: str,
    scaling: Scaling = "tolerance",
    tuning: float | None = None,
) -> tuple[Solution, Shrunk | None]:
    """The estimate from steps ``start`` (n_free,) of a problem without a prior; ``drawing`` states tolerances.

    ``scaling`` is the unit of the columns: tolerances, columns of length one, or raw mm and rad with readings
    in the unit of the first channel (as in the polisher paper). ``tuning`` is Liu's d, ridge's k or the number
    of components where its rule is not to choose it. The status tells whether the estimate came to rest.
    Raises InputError when no reading is left over to tell the noise.
    """
    columns = _Columns.of(problem, drawing, scaling)
    t, share, last, moved = start.astype(float), 1.0, np.inf, np.zeros(len(start))
    known: Shrunk | None = None
    status = Status.LIMIT
    for iteration in range(1, LIMIT + 1):
        factor = triangular(problem.blocks(t), len(t) + 1)
        if not np.isfinite(factor).all():
            status = Status.FAILED if known is None else Status.STALLED
            break
        frozen = known.tuning if tuning is None and known is not None and iteration > FROZEN else tuning
        aim, known = columns.solved(factor, t, linear_estimator(name, frozen))
        moved, spread = aim - t, np.linalg.norm(np.hstack([known.root, known.unknown.T]), axis=1)
        if np.all(np.abs(moved) <= TOLERANCE * spread + LOST * (1.0 + np.abs(t))):
            t, status = aim, Status.CONVERGED
            break
        size = float(np.max(np.abs(moved) / np.maximum(spread, LOST)))
        share = max(0.5 * share, SHORTEST) if size > last else min(1.0, 2.0 * share)
        t, last = t + share * moved, size
    cost = 0.5 * float(np.sum(factor[:, -1] ** 2))
    return Solution(t, factor, cost, status, iteration, last, moved), known


@dataclass(frozen=True)
class _Columns:
    """Steps of the problem as columns of the estimator: t = origin + [loose, or unit * b of what is held].

    held (n_free,) parameters with a tolerance; origin (n_free,) their drawing value in steps; unit (n_held,),
    None for columns of length one; reading: size of a whitened reading; n_observations: their number.
    """

    held: Mask
    origin: Array
    unit: Array | None
    reading: float
    n_observations: int

    @classmethod
    def of(cls, problem: Problem, drawing: Prior, scaling: Scaling) -> _Columns:
        free = problem.prior.free
        step, sigma = problem.prior.scale[free], drawing.sigma[free]
        held = np.isfinite(sigma)
        origin = np.where(held, (drawing.mean[free] - problem.p[free]) / step, 0.0)
        units = {"tolerance": (sigma / step)[held], "raw": 1.0 / step[held], "unit": None}
        reading = problem.predictor.channels[0].sigma if scaling == "raw" else 1.0
        return cls(held, origin, units[scaling], reading, problem.n_observations)

    def solved(self, factor: Array, t: Array, linear: Linear) -> tuple[Array, Shrunk]:
        """Steps (n_free,) that the estimator makes of the triangular factor of [J r] at ``t``."""
        n, k = len(t), int(np.sum(~self.held))
        j, at = factor[:, :n], t - self.origin
        r = np.asarray(
            np.linalg.qr(np.column_stack([j[:, ~self.held], j[:, self.held], factor[:, n]]), mode="r")
        )
        inverse, rank = _inverse(r[:k, :k])
        unit = 1.0 / np.linalg.norm(j[:, self.held], axis=0) if self.unit is None else self.unit
        problem = decompose(
            self.reading * r[k:, k:n],
            -self.reading * r[k:, n],
            unit,
            n_observations=self.n_observations - rank,
        )
        found = linear(problem.counted_from(at[self.held]))
        follow = -inverse @ r[:k, k:n]  # the loose ones follow the held ones
        steps = self._placed(
            at[~self.held] - inverse @ r[:k, n] + follow @ (found.b - at[self.held]), found.b
        )
        root = found.root(self.reading**2)
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
