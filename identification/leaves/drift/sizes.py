"""How far and how fast each parameter moved, with the joint covariance of all sessions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import stats

from truepose.arrays import Array
from truepose.identification.fit.problem import Prior
from truepose.identification.leaves.drift.sessions import Likeliest, MovementPosterior, Stack
from truepose.identification.posterior.marginal import Marginal

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
