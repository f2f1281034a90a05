"""Moving all poses at once inside the joints' ranges, with the criterion's exact gradient (paper, Fig. 13).

Use ``climb`` from a good design: the criterion has many local maxima. Poses that cannot be assembled, or lie
next to a singularity, are never entered: a pose that would goes on in a smaller box around its last good place.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from truepose.arrays import Array, Mask
from truepose.identification.leaves.planning.criteria import Objective
from truepose.identification.leaves.planning.information import PoseInformation, Poses

LIMIT = 300
"""Iterations of L-BFGS-B."""
RUNS = 40
"""Starts of it, each from the best joints so far, with less room for poses that could not be entered."""
FLAT = 1e-10
"""Relative gain at which it stops."""
_APART = 0.01
_SHORTER, _SHORTEST = 0.1, 1e-2


class _LostError(Exception):
    """Some poses cannot be entered: rows (n,)."""

    def __init__(self, rows: Mask) -> None:
        super().__init__("poses that cannot be entered")
        self.rows = rows


class Landscape:
    """A criterion as a function of all joint values of n poses, with its gradient.

    ``strongest``: poses whose loops react more strongly to the constants are next to a singularity.
    """

    def __init__(self, information: PoseInformation, objective: Objective, strongest: float = np.inf) -> None:
        self.information, self.objective, self.strongest = information, objective, strongest

    def value(self, poses: Poses) -> float:
        """The criterion; -inf where a pose is not good."""
        if not poses.within(self.strongest).all():
            return -np.inf
        rows = self.objective.project(self.information.rows(poses.signature))
        return self.objective.value(rows)

    def gradient(self, poses: Poses) -> tuple[float, Array]:
        """The criterion and its derivative by the joints (n, nq): d = 2 <J slope, dJ>."""
        rows = self.objective.project(self.information.rows(poses.signature))
        cotangent = 2.0 * rows @ self.objective.slope(rows) @ self.objective.basis.T
        pulled = self.information.pull(poses, self.information.pulled_rows(cotangent))
        return self.objective.value(rows), pulled


def climb(
    landscape: Landscape, q: Array, seed: int = 0, progress: Callable[[str], None] = lambda _: None
) -> Array:
    """Joint values (n, nq) inside the ranges, whose criterion is not below that of ``q``."""
    information = landscape.information
    best_q, best = q, landscape.value(information.at(q))
    here = _apart(q, information, seed)
    if not information.at(here).within(landscape.strongest).all():
        here = q
    reach = np.ones(len(q))  # how far each pose may go, in shares of the ranges
    for _ in range(RUNS):
        ascent = _Ascent(landscape, here, progress)
        try:
            ascent.run(reach)
            lost = np.zeros(len(q), dtype=bool)
        except _LostError as error:
            lost = error.rows
        here = ascent.q
        if ascent.best > best:
            best_q, best = ascent.q, ascent.best
        if not lost.any() or not (reach[lost] > 0.0).any():
            break
        reach[lost] = np.where(reach[lost] > _SHORTEST, _SHORTER * reach[lost], 0.0)
    return best_q


class _Ascent:
    """One run of L-BFGS-B on minus the criterion, in shares of the ranges; remembers the best joints met."""

    def __init__(self, landscape: Landscape, q: Array, progress: Callable[[str], None]) -> None:
        self._landscape, self._progress = landscape, progress
        self._low, self._high = landscape.information.low, landscape.information.high
        self._span = landscape.information.span
        self.q, self.best = q, -np.inf

    def run(self, reach: Array) -> None:
        """From ``q``, no pose going further than ``reach`` (n,). Raises _LostError."""
        start = (self.q - self._low) / self._span
        low, high = np.clip(start - reach[:, None], 0.0, 1.0), np.clip(start + reach[:, None], 0.0, 1.0)
        minimize(
            self._minus,
            start.ravel(),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(low.ravel(), high.ravel(), strict=True)),
            options={"maxiter": LIMIT, "ftol": FLAT, "gtol": 1e-9, "maxcor": 20},
        )

    def _minus(self, shares: Array) -> tuple[float, Array]:
        shares = shares.reshape(self.q.shape)
        q = np.clip(self._low + shares * self._span, self._low, self._high)
        # each time from home, so that the assembly is the one that every other command finds
        poses = self._landscape.information.at(q)
        lost = ~poses.within(self._landscape.strongest)
        if lost.any():
            raise _LostError(lost)
        value, gradient = self._landscape.gradient(poses)
        if value > self.best:
            self.q, self.best = q, value
            self._progress(f"moving the poses: {self._landscape.objective.criterion.title} = {value:.4f}")
        return -value, -(gradient * self._span).ravel()


def _apart(q: Array, information: PoseInformation, seed: int) -> Array:
    """Repeats moved a little apart: alike, they would have the same gradient for ever."""
    _, first = np.unique(q, axis=0, return_index=True)
    again = np.setdiff1d(np.arange(len(q)), first)
    out = q.copy()
    out[again] += (
        _APART * information.span * np.random.default_rng(seed).standard_normal((len(again), q.shape[1]))
    )
    return np.clip(out, information.low, information.high)
