"""Log evidence that parameters moved between sessions, geometry shared by all marginalised under its tolerance.

With r_k + A_k tau_k the whitened residual of session k, tau_k in steps less the prior's mean,
    tau_k = tau + sum_i e_i q_i (C z_i)_k,   tau ~ N(0, tolerance^2),   z_i ~ N(0, 1),
where i runs over what moves and the columns of C (K, K - 1) are orthonormal contrasts between sessions: a
common departure from the drawing is no movement, and no session is the reference. The size q_i of a movement
is marginalised over a million to one in tolerances, evenly in its logarithm up to a tenth of a tolerance and
less likely beyond: parts move by less than they were made wrong. Noise scale and an inflation of tolerances are
marginalised too (wrong sigmas and wrong tolerances are rival explanations, see
``truepose.identification.drift.scales``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import helmert, solve_triangular
from scipy.special import logsumexp

from truepose.identification.drift.scales import Grid, Scales, log_gains, noise_scales
from truepose.identification.drift.sessions import Linear
from truepose.identification.fit.decomposition import ROUNDING
from truepose.identification.fit.problem import Prior
from truepose.identification.fit.tolerance_classes import INFLATED, PartClass
from truepose.identification.prior import INFLATIONS

Array = NDArray[np.float64]
SIZES = np.geomspace(1e-6, 3.0, 27)
"""Sizes of a movement in tolerances."""
USUAL = 0.1
"""... of which larger ones than this are less and less likely."""
OPEN_SIZES = np.geomspace(1e-8, 10.0, 37)
"""Without a tolerance: in steps of 100 mm or 1 rad, all alike."""
VAGUE = 1e-4
"""Weight of a prior without tolerance: 1 km or 1e4 rad, which decides nothing and keeps evidence finite."""


@dataclass(frozen=True)
class Stack:
    """All sessions in one least-squares problem: jacobian (K, n + 1, n), offset (K, n + 1), n_observations, weight
    (n,) steps per tolerance, inflated (n,) which tolerances may be wrong together."""

    jacobian: Array
    offset: Array
    n_observations: int
    weight: Array
    inflated: NDArray[np.bool_]

    @classmethod
    def of(cls, sessions: Sequence[Linear], prior: Prior) -> Stack:
        """From the linearised sessions."""
        free = prior.free
        weight = np.where(np.isinf(prior.sigma[free]), VAGUE, prior.scale[free] / prior.sigma[free])
        inflated = np.array([prior.parts[k] in INFLATED for k in free]) & np.isfinite(prior.sigma[free])
        jacobian = np.stack([s.jacobian for s in sessions])
        offset = np.stack([s.offset for s in sessions])
        return cls(jacobian, offset, sum(s.n_observations for s in sessions), weight, inflated)

    @cached_property
    def contrasts(self) -> Array:
        """(K, K - 1) orthonormal, each summing to 0."""
        return np.asarray(helmert(len(self.jacobian)).T)

    @cached_property
    def movements(self) -> Array:
        """(K (n + 1), n, K - 1) what a step of each contrast of each parameter does to the residuals."""
        shown = self.jacobian[:, :, :, None] * self.contrasts[:, None, None, :]
        return shown.reshape(-1, *shown.shape[2:])

    def sizes(self, members: Sequence[int]) -> tuple[Array, Array]:
        """(s,) sizes of a movement of ``members``, in steps, and (s,) the log of their prior probability."""
        if not np.all(self.weight[list(members)] > VAGUE):
            return OPEN_SIZES, np.full(len(OPEN_SIZES), -np.log(len(OPEN_SIZES)))
        prior = -0.5 * np.log1p((SIZES / USUAL) ** 2)
        return SIZES, prior - float(logsumexp(prior))

    @cached_property
    def visible(self) -> NDArray[np.bool_]:
        """(n,) parameters that some session sees."""
        sharpest = np.max(np.linalg.norm(self.jacobian, axis=1), axis=0)
        return np.asarray(sharpest > ROUNDING * np.max(sharpest, initial=0.0))


def grid_for(stack: Stack) -> Grid:
    """Noise from below the stated sigma to what is left when nothing may move; one inflation for all tolerances."""
    nothing = solve(stack, {}, Scales(1.0, (1.0,), 0.0))
    rms = float(np.linalg.norm(nothing.residual)) / np.sqrt(stack.n_observations)
    inflations = INFLATIONS if stack.inflated.any() else (1.0,)
    return Grid(noise_scales(rms, 0.4), tuple((v,) for v in inflations), (PartClass("all"),))


@dataclass(frozen=True)
class Solved:
    """The model in which ``accepted`` (parameter to size q, in steps) moves, at one grid point.

    log_evidence; basis (K (n + 1), c) readings' part of an orthonormal basis of what the model can follow;
    residual (K (n + 1),) what it leaves; mean (c,) and root (c, c) of its unknowns: tau, then the contrasts of
    each moved parameter in units of its size.
    """

    accepted: tuple[tuple[int, float], ...]
    point: Scales
    log_evidence: float
    basis: Array
    residual: Array
    mean: Array
    root: Array


def solve(stack: Stack, accepted: Mapping[int, float], point: Scales) -> Solved:
    """Solve the model at one noise scale and inflation."""
    sessions, rows, n = stack.jacobian.shape
    k = sessions - 1
    design = np.hstack(
        [stack.jacobian.reshape(-1, n), *(stack.movements[:, i] * q for i, q in accepted.items())]
    )
    prior = np.concatenate(
        [stack.weight / np.where(stack.inflated, point.inflation[0], 1.0), np.ones(k * len(accepted))]
    )
    target = np.concatenate([-stack.offset.ravel() / point.noise, np.zeros(len(prior))])
    q, r = np.linalg.qr(np.vstack([design / point.noise, np.diag(prior)]))
    inside = q.T @ target
    residual = target - q @ inside
    determinant = float(np.sum(np.log(prior)) - np.sum(np.log(np.abs(np.diag(r)))))
    log_evidence = (
        -stack.n_observations * np.log(point.noise) - 0.5 * float(residual @ residual) + determinant
    )
    root = solve_triangular(r, np.eye(len(r)))
    data = sessions * rows
    return Solved(
        tuple(accepted.items()),
        point,
        log_evidence,
        q[:data],
        residual[:data],
        root @ inside,
        np.asarray(root),
    )


@dataclass(frozen=True)
class Gains:
    """Candidates against a model: gain (C,) log Bayes factors, size (C,) their likeliest size q in steps;
    null: the model's own log evidence over the grid."""

    null: float
    gain: Array
    size: Array


def weigh(
    stack: Stack,
    states: Sequence[Solved],
    candidates: Sequence[Sequence[int]],
) -> Gains:
    """Evidence that the members of each candidate move too, all in proportion to their steps."""
    prior = np.array([s.point.log_prior + s.log_evidence for s in states])
    null = float(logsumexp(prior))
    gain, size = np.full(len(candidates), -np.inf), np.zeros(len(candidates))
    inside = [s.basis.T @ stack.movements.reshape(len(s.residual), -1) for s in states]
    for c, members in enumerate(candidates):
        if not np.any(stack.visible[list(members)]):
            gain[c] = 0.0  # no reading sees it: evidence neither for nor against
            continue
        sizes, likely = stack.sizes(members)
        logs = np.array([_gains(stack, s, g, members, sizes) for s, g in zip(states, inside, strict=True)])
        joint = logs + prior[:, None] + likely
        gain[c] = float(logsumexp(joint)) - null
        size[c] = sizes[int(np.argmax(logsumexp(joint, axis=0)))]
    return Gains(null, gain, size)


def _gains(stack: Stack, s: Solved, inside: Array, members: Sequence[int], sizes: Array) -> Array:
    """(sizes,) log Bayes factors of a movement of each size."""
    values, vectors, score = information(stack, s, inside, members)
    return log_gains(sizes, values, vectors.T @ score)


def information(stack: Stack, s: Solved, inside: Array, members: Sequence[int]) -> tuple[Array, Array, Array]:
    """What the readings say of the k contrasts of ``members``, all else free, in steps.

    Eigenvalues (k,) and eigenvectors (k, k) of the information, and the score (k,); ``inside`` (c, n (K - 1)): the part of
    every movement that the model can follow.
    """
    k, noise = stack.movements.shape[2], s.point.noise
    which = np.concatenate([np.arange(i * k, (i + 1) * k) for i in members])
    shown = stack.movements.reshape(len(s.residual), -1)[:, which] / noise
    followed = inside[:, which] / noise
    values, vectors = np.linalg.eigh(shown.T @ shown - followed.T @ followed)
    return np.maximum(values, 0.0), vectors, shown.T @ s.residual
