"""How far and how fast each parameter moved, with the joint covariance of all sessions.

How long an older calibration lasts: what it predicts of later recordings, with its own uncertainty.

Three ways to meet a later recording k: the calibration of the first recording as it is; frames and sensors
re-identified on k, the mechanism as in the first; everything re-identified. Under the hypothesis that what is
carried over has not moved, its error is that of the first fit, of covariance C; the excess of
    T = min_(d, x)  |r + J_carried d + J_new x|^2 / s^2 + d' C^-1 d
over the residual sum of squares of a free fit is then chi-square, in terms of the noise s^2 that the free fits
leave an F ratio.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import stats

from truepose.arrays import Array, Mask
from truepose.errors import ConvergenceError
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.estimate import result
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import Solution, Status
from truepose.identification.fit.problem import Prior, Problem
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.leaves.drift.movement_problem import Stack
from truepose.identification.leaves.drift.movements import Likeliest, MovementPosterior
from truepose.identification.leaves.drift.sessions import Session, bounded
from truepose.identification.posterior.marginal import Marginal

# -- How long an older calibration lasts: what it predicts of later recordings, with its own uncertainty

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
        try:
            start = session.fit(replace(prior, sigma=sigma), p).p
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


# -- How far and how fast each parameter moved, with the joint covariance of all sessions

SURE = 0.95
MASKED = 10.0
"""A movement is masked when those found hide so many times more of it."""
BLIND = 1e-9
"""Information below this share of what a session could have is rounding."""
UNSTEADY = 0.01
"""p of a straight line below which a rate is called unsteady."""


@dataclass(frozen=True)
class Movement:
    """One parameter between sessions, in its unit (mm, rad or an effect's own).

    change and std (K,): since the first session (whose own are 0); empty where it is taken as common.
    rate: per second (per session without a clock) with std, None when it did not move; steady: whether a
    straight line fits. hidden: 1-sigma of a movement from the first to the last session, if it moved alone
    (inf: no reading sees it). alike: parameters whose movement would show nearly the same, with the log odds
    against them. extrinsic: of a frame or a sensor.
    status: ``moved``, ``perhaps``, ``still``, ``unseen``, ``masked`` (what moved would hide it) or ``anew`` (of a frame that
    is set up anew for each session, as the machine file says: ``change`` says where it stood).
    """

    name: str
    unit: str
    extrinsic: bool
    status: str
    probability: float
    log_bayes_factor: float
    change: tuple[float, ...] = ()
    std: tuple[float, ...] = ()
    rate: float | None = None
    rate_std: float | None = None
    steady: bool = True
    hidden: float = 0.0
    alike: Mapping[str, float] = field(default_factory=dict)


def joint_parameters(likeliest: Likeliest, prior: Prior) -> Array:
    """(K, np) parameters of every session, posterior mean at the likeliest noise and tolerances."""
    out = np.tile(prior.mean, (len(likeliest.places), 1))
    out[:, prior.free] += prior.scale[prior.free] * likeliest.places
    return out


def movements(
    found: MovementPosterior, prior: Prior, units: Mapping[str, str], times: tuple[float, ...] | None
) -> tuple[Movement, ...]:
    """Every free parameter, in order."""
    names = [prior.names[k] for k in prior.free]
    best = found.likeliest
    clock = np.arange(len(best.stack.jacobian), dtype=float) if times is None else np.array(times)
    point, out = best.state.point, list[Movement]()
    here, calm = best.spike_slab.beside(point, best.state.members), best.spike_slab.root(point)
    for i, name in enumerate(names):
        scale = float(prior.scale[prior.free[i]])
        common: dict[str, Any] = {
            "name": name,
            "unit": units[name],
            "probability": float(found.probability[i]),
            "log_bayes_factor": float(found.gain[i]),
            "extrinsic": bool(found.extrinsic[i]),
        }
        if i in best.stack.anew:
            own = {**_moved(best, i, scale, clock), "rate": None, "rate_std": None, "steady": True}
            out.append(
                Movement(**{**common, "probability": 1.0, "log_bayes_factor": 0.0}, **own, status="anew")
            )
        elif i in best.moved:
            status = "moved" if found.together[i] > SURE else "perhaps"
            alike = {names[k]: odds for k, odds in found.alike[i].items()}
            out.append(Movement(**common, **_moved(best, i, scale, clock), status=status, alike=alike))
        else:
            hidden, otherwise = (scale * _hidden(best.stack, there, i) for there in (here, calm))
            status = _still(hidden, otherwise, float(found.probability[i]))
            out.append(Movement(**common, status=status, hidden=hidden))
    return tuple(out)


def _still(hidden: float, otherwise: float, probability: float) -> str:
    """``otherwise``: what would stay hidden if nothing moved."""
    if np.isinf(otherwise):
        return "unseen"
    if hidden > MASKED * otherwise:
        return "masked"
    return "still" if probability < 0.5 else "perhaps"


def _moved(best: Likeliest, parameter: int, scale: float, clock: Array) -> dict[str, Any]:
    """Change since the first session, and a straight line through it."""
    contrasts, (mean, covariance) = best.stack.contrasts, best.contrasts(parameter)
    since = scale * (contrasts - contrasts[0])
    change, spread = since @ mean, since @ covariance @ since.T
    line = straight_line(clock - clock[0], change, spread)
    return {
        "change": tuple(change.tolist()),
        "std": tuple(np.sqrt(np.maximum(np.diag(spread), 0.0)).tolist()),
        "rate": line and line[0],
        "rate_std": line and line[1],
        "steady": line is None or line[2] > UNSTEADY,
    }


def straight_line(elapsed: Array, change: Array, covariance: Array) -> tuple[float, float, float] | None:
    """Rate, its 1-sigma and p of a straight line through the first session; None when no time passed.

    Where the line does not fit, the 1-sigma is widened by Birge's ratio.
    """
    weighted = np.linalg.lstsq(covariance[1:, 1:], np.column_stack([elapsed[1:], change[1:]]), rcond=1e-12)[0]
    gain = float(elapsed[1:] @ weighted[:, 0])
    if gain <= 0.0:
        return None
    rate = float(elapsed[1:] @ weighted[:, 1]) / gain
    left = change[1:] - rate * elapsed[1:]
    chi2, freedom = float(left @ (weighted[:, 1] - rate * weighted[:, 0])), len(elapsed) - 2
    if freedom <= 0:
        return rate, gain**-0.5, 1.0
    return rate, gain**-0.5 * max(1.0, float(np.sqrt(chi2 / freedom))), float(stats.chi2.sf(chi2, freedom))


def _hidden(stack: Stack, model: Marginal, parameter: int) -> float:
    """1-sigma, in steps, of a movement of a parameter from the first session to the last, if it moved alone beside a model."""
    if not stack.visible[parameter]:
        return float("inf")
    unit = stack.unit[parameter]
    values, vectors = np.linalg.eigh(model.among(stack.columns(parameter)) / unit**2)
    along = vectors.T @ (stack.contrasts[-1] - stack.contrasts[0])
    seen = values > BLIND * np.max(np.linalg.norm(stack.jacobian[:, :, parameter], axis=1)) ** 2
    if np.any(np.abs(along[~seen]) > BLIND):
        return float("inf")
    return float(np.linalg.norm(along[seen] / np.sqrt(values[seen])))
