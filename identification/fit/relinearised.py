"""A linear estimator on a machine: applied to the problem linearised at its own result.

With residuals r and derivative J at a step t from the drawing, the problem linearised there is y = J t' + noise
with y = J t - r. A linear estimator B (``truepose.identification.fit.biased``) makes B(J, y) of it; the estimate is
the t that it leaves where it is. For least squares that is Gauss-Newton, for ridge with given k the minimum
of |r|^2 + k |t|^2. What tunes B is chosen anew from each linearisation.

Parameters without a tolerance have no drawing value to be pulled to: they are taken out of the problem before
B sees it and follow by least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.fit.biased import LinearEstimate, Spectrum, decompose, liu, ols, pcr, ridge
from truepose.identification.fit.decomposition import ROUNDING, Decomposition
from truepose.identification.fit.leastsquares import Solution, Status, triangular
from truepose.identification.fit.problem import Prior, Problem

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


__all__ = ["TUNING", "Scaling", "Shrunk", "linear_estimator", "relinearised"]
