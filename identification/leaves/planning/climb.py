"""Move all poses at once inside the joints' ranges, with the criterion's exact gradient (paper, Fig. 13).

Use ``climb`` from a good design: the criterion has many local maxima. Poses that cannot be assembled, or lie
next to a singularity, are never entered: a pose that would goes on in a smaller box around its last good place.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from truepose.arrays import Array, Mask
from truepose.identification.leaves.planning.criterion import TITLE, log_det, spectrum
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
    """Some poses cannot be entered."""


@dataclass(frozen=True)
class Landscape:
    """The criterion as a function of all joint values of n poses, with its gradient.

    ``strongest``: poses whose loops react more strongly to the constants are next to a singularity.
    """

    information: PoseInformation
    strongest: float = np.inf

    def value(self, poses: Poses) -> float:
        """The criterion; -inf where a pose is not good."""
        if not poses.within(self.strongest).all():
            return -np.inf
        return log_det(self.information.rows(poses.signature), self.information.weight)

    def gradient(self, poses: Poses) -> tuple[float, Array]:
        """The criterion and its derivative by the joints (n, nq): d = 2 <J M^-1, dJ>."""
        rows = self.information.rows(poses.signature)
        values, vectors = spectrum(rows, self.information.weight)
        cotangent = 2.0 * rows @ ((vectors * (1.0 / values)) @ vectors.T)
        pulled = self.information.pull(poses, self.information.pulled_rows(cotangent))
        return float(np.sum(np.log(values))), pulled


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
        here, value, lost = _ascend(landscape, here, reach, progress)
        if value > best:
            best_q, best = here, value
        if not lost.any() or not (reach[lost] > 0.0).any():
            break
        reach[lost] = np.where(reach[lost] > _SHORTEST, _SHORTER * reach[lost], 0.0)
    return best_q


def _ascend(
    landscape: Landscape, q: Array, reach: Array, progress: Callable[[str], None]
) -> tuple[Array, float, Mask]:
    """Run L-BFGS-B on minus the criterion, in shares of the ranges, no pose going further than ``reach`` (n,).

    Returns the best joints met, their criterion, and the poses (n,) that cannot be entered, at which it stopped.
    """
    information = landscape.information
    low, span = information.low, information.span
    best_q, best, lost = q, -np.inf, np.zeros(len(q), dtype=bool)

    def minus(shares: Array) -> tuple[float, Array]:
        nonlocal best_q, best, lost
        here = np.clip(low + shares.reshape(q.shape) * span, low, information.high)
        # each time from home, so that the assembly is the one that every other command finds
        poses = information.at(here)
        lost = ~poses.within(landscape.strongest)
        if lost.any():
            raise _LostError
        value, gradient = landscape.gradient(poses)
        if value > best:
            best_q, best = here, value
            progress(f"moving the poses: {TITLE} = {value:.4f}")
        return -value, -(gradient * span).ravel()

    start = (q - low) / span
    nearest, farthest = (np.clip(start + sign * reach[:, None], 0.0, 1.0).ravel() for sign in (-1.0, 1.0))
    with contextlib.suppress(_LostError):
        minimize(
            minus,
            start.ravel(),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(nearest, farthest, strict=True)),
            options={"maxiter": LIMIT, "ftol": FLAT, "gtol": 1e-9, "maxcor": 20},
        )
    return best_q, best, lost


def _apart(q: Array, information: PoseInformation, seed: int) -> Array:
    """Repeats moved a little apart: alike, they would have the same gradient for ever."""
    _, first = np.unique(q, axis=0, return_index=True)
    again = np.setdiff1d(np.arange(len(q)), first)
    out = q.copy()
    out[again] += (
        _APART * information.span * np.random.default_rng(seed).standard_normal((len(again), q.shape[1]))
    )
    return np.clip(out, information.low, information.high)
