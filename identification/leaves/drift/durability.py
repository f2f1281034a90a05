"""How long an older calibration lasts: what it predicts of later recordings, with its own uncertainty.

Three ways to meet a later recording k: the calibration of the first recording as it is; frames and sensors
re-identified on k, the mechanism as in the first; everything re-identified. Under the hypothesis that what is
carried over has not moved, its error is that of the first fit, of covariance C; the excess of
    T = min_(d, x)  |r + J_carried d + J_new x|^2 / s^2 + d' C^-1 d
over the residual sum of squares of a free fit is then chi-square, in terms of the noise s^2 that the free fits
leave an F ratio.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from truepose.arrays import Array, Mask
from truepose.errors import ConvergenceError
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.estimate import estimate, result
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import Solution, Status
from truepose.identification.fit.problem import Prior, Problem
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.leaves.drift.sessions import Session, bounded

LEVEL = 0.01
"""Chance that any check of a sequence fails although nothing moved; each has its share of it."""
NOTICEABLE = 1.1
"""... and residuals must exceed what is expected by this factor: many readings show movements nobody minds."""
FEW = 10
"""Degrees of freedom below which the noise is taken as stated."""
LEAST_NOISE = 0.8
"""Noise is not taken to be less than this share of what was stated, as in the evidence."""
OPEN = 1e4
"""What a direction that the first recording left open may be, in steps."""


@dataclass(frozen=True)
class Check:
    """One way to meet one recording.

    rms and expected (if nothing carried over moved) by kind, in ``units``; p of the excess; holds: it suffices,
    because no excess is both certain and noticeable or because rms is within the accuracy asked for.
    """

    rms: Mapping[str, float]
    expected: Mapping[str, float]
    units: Mapping[str, str]
    p: float
    holds: bool


@dataclass(frozen=True)
class Durability:
    """Checks of every session after the first (None where a fit found no minimum): ``carried`` all of the first
    calibration, ``frames`` re-identified, ``full`` re-identified (which holds by definition)."""

    carried: tuple[Check | None, ...]
    frames: tuple[Check | None, ...]
    full: tuple[Check, ...]
    noise: float


def noise_of(fits: Sequence[Estimate]) -> tuple[float, float]:
    """Noise in stated sigmas from what free fits leave, and the degrees of freedom that tell it."""
    left = sum(_free_residual(fit)[0] for fit in fits)
    freedom = float(sum(fit.n_observations - fit.rank for fit in fits))
    if freedom < FEW:
        return 1.0, np.inf
    return max(float(np.sqrt(left / freedom)), LEAST_NOISE), freedom


def durability(
    sessions: Sequence[Session],
    fits: Sequence[Estimate],
    prior: Prior,
    extrinsic: Mask,
    accuracy: Mapping[str, float] | None = None,
    renewed: Mask | None = None,
) -> Durability:
    """Check the calibration of the first session on every later one.

    ``extrinsic`` (n_free,) are frames and sensors; ``accuracy``: rms by kind (mm, rad) that is good enough anyway; ``renewed``
    (n_free,) what is set up anew for each session and never carried over.
    """
    renewed = np.zeros_like(extrinsic) if renewed is None else renewed
    noise, freedom = noise_of(fits)
    known = Decomposition.of(fits[0].factor[:, :-1] / noise, fits[0].prior_weight)
    root = np.hstack([known.root, OPEN * known.unknown.T])
    carried: list[Check | None] = []
    frames: list[Check | None] = []
    for session, own in zip(sessions[1:], fits[1:], strict=True):
        level = LEVEL / (2 * (len(sessions) - 1))
        setting = _Setting(session, own, noise, freedom, root, level, accuracy or {})
        for checks, anew in ((carried, renewed), (frames, extrinsic | renewed)):
            checks.append(setting.check(fit_when_met(session, prior, fits[0].p, anew), ~anew))
    return Durability(tuple(carried), tuple(frames), tuple(_own(fit) for fit in fits[1:]), noise)


def fit_when_met(session: Session, prior: Prior, p: Array, anew: Mask) -> Estimate | None:
    """The session's fit of the parameters ``anew`` (n_free,), all others held at ``p``; None without a minimum.

    The Jacobian of the result is by all free parameters all the same.
    """
    start = p
    if anew.any():
        sigma = bounded(prior).sigma.copy()
        sigma[prior.free[~anew]] = 0.0
        held = replace(prior, sigma=sigma)
        try:
            start = estimate(
                session.predictor.machine,
                session.recording,
                session.predictor.machine.effects,
                prior=held,
                start=p,
                predictor=session.predictor,
            ).p
        except ConvergenceError:
            return None
    problem = Problem(session.predictor, bounded(prior), start, ~session.recording.validation)
    n = len(prior.free)
    nothing = Solution(np.zeros(n), np.zeros((n + 1, n + 1)), 0.0, Status.CONVERGED, 0, 0.0, np.zeros(n))
    return result(problem, nothing, session.predictor.machine.effects)


@dataclass(frozen=True)
class _Setting:
    """A session, its own fit, the noise, and the root of what the first calibration does not know."""

    session: Session
    own: Estimate
    noise: float
    freedom: float
    root: Array
    level: float
    accuracy: Mapping[str, float]

    def check(self, met: Estimate | None, kept: Mask) -> Check | None:
        """``kept`` (n_free,): what was carried over."""
        if met is None:
            return None
        jacobian, offset = met.factor[:, :-1] / self.noise, met.factor[:, -1] / self.noise
        drawn = jacobian[:, kept] @ self.root[kept]
        k = drawn.shape[1]
        rows = np.block([[drawn, jacobian[:, ~kept]], [np.eye(k), np.zeros((k, int((~kept).sum())))]])
        target = np.concatenate([offset, np.zeros(k)])
        away = target - rows @ np.linalg.lstsq(rows, target, rcond=1e-12)[0]
        least, rank = _free_residual(self.own)
        fitted = Decomposition.of(jacobian[:, ~kept], np.zeros(int((~kept).sum()))).rank
        extra = max(rank - fitted, 1)
        excess = max(float(away @ away) - least / self.noise**2, 0.0)
        known = not np.isfinite(self.freedom)
        p = stats.chi2.sf(excess, extra) if known else stats.f.sf(excess / extra, extra, self.freedom)
        rms, expected = self._rms(met), self._expected(met, kept)
        enough = bool(self.accuracy) and all(rms[kind] <= self.accuracy.get(kind, np.inf) for kind in rms)
        worse = any(rms[kind] > NOTICEABLE * expected[kind] for kind in rms)
        units = self.session.predictor.machine.residual_units
        return Check(rms, expected, units, float(p), enough or not (p < self.level and worse))

    def _rms(self, fit: Estimate) -> dict[str, float]:
        return rms_by_kind(fit.residual[fit.used], self.session.predictor.channels, fit.lost_among(fit.used))

    def _expected(self, met: Estimate, kept: Mask) -> dict[str, float]:
        """rms if nothing carried over moved: noise, less what a refit takes up, and the first fit's errors."""
        jacobian = met.factor[:, :-1] / self.noise
        new = jacobian[:, ~kept]
        u, s, vt = np.linalg.svd(new, full_matrices=False)
        seen = s > 1e-10 * np.max(s, initial=1e-300)
        leverage = vt[seen].T / s[seen]
        drawn = np.zeros((len(kept), self.root.shape[1]))
        drawn[kept] = self.root[kept]
        drawn[~kept] = -leverage @ (u[:, seen].T @ (jacobian[:, kept] @ self.root[kept]))
        prior, variance = met.prior, []
        for block in self.session.predictor.blocks(met.p, met.x, met.used):
            rows = met.used[block.rows]
            steps = block.jacobian[rows][:, :, prior.free] * prior.scale[prior.free] / self.noise
            refit = np.sum((steps[:, :, ~kept] @ leverage) ** 2, axis=2)
            silent = np.all(steps == 0.0, axis=2)  # a change since itself is nothing
            noise = np.where(silent, 0.0, np.maximum(1.0 - refit, 0.0))
            variance.append(noise + np.sum((steps @ drawn) ** 2, axis=2))
        return rms_by_kind(self.noise * np.sqrt(np.concatenate(variance)), self.session.predictor.channels)


def _free_residual(fit: Estimate) -> tuple[float, int]:
    """Sum of squares that no choice of parameters takes away, and how many directions it used."""
    jacobian, offset = fit.factor[:, :-1], fit.factor[:, -1]
    u = np.linalg.svd(jacobian, full_matrices=False)[0]
    inside = u[:, : fit.rank].T @ offset
    return float(offset @ offset - inside @ inside), fit.rank


def _own(fit: Estimate) -> Check:
    rms = rms_by_kind(fit.residual[fit.used], fit.nominal.channels, fit.lost_among(fit.used))
    return Check(rms, rms, fit.nominal.residual_units, 1.0, True)
