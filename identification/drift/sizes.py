"""How far and how fast each parameter moved, with the joint covariance of all sessions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from truepose.identification.drift.movement_evidence import Solved, Stack, information, solve
from truepose.identification.drift.movement_selection import Selection
from truepose.identification.fit.problem import Prior

Array = NDArray[np.float64]
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
    status: ``moved``, ``perhaps``, ``still``, ``unseen`` or ``masked`` (what moved would hide it).
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


def joint_parameters(stack: Stack, found: Selection, prior: Prior) -> Array:
    """(K, np) parameters of every session, posterior mean at the likeliest noise and inflation."""
    best, n = found.best, stack.jacobian.shape[2]
    k = stack.contrasts.shape[1]
    tau = np.tile(best.mean[:n], (len(stack.jacobian), 1))
    for place, (i, q) in enumerate(best.accepted):
        tau[:, i] += q * stack.contrasts @ best.mean[n + place * k : n + (place + 1) * k]
    out = np.tile(prior.mean, (len(tau), 1))
    out[:, prior.free] += prior.scale[prior.free] * tau
    return out


def movements(
    stack: Stack, found: Selection, prior: Prior, units: Mapping[str, str], times: tuple[float, ...] | None
) -> tuple[Movement, ...]:
    """Every free parameter, in order."""
    names = [prior.names[k] for k in prior.free]
    clock = np.arange(len(stack.jacobian), dtype=float) if times is None else np.array(times)
    probability, best = found.probability, found.best
    here, calm = (_followed(stack, s) for s in (best, solve(stack, {}, best.point)))
    places = {i: place for place, (i, _) in enumerate(best.accepted)}
    out = []
    for i, name in enumerate(names):
        scale, unit = float(prior.scale[prior.free[i]]), units[name]
        common: dict[str, Any] = {
            "name": name,
            "unit": unit,
            "probability": float(probability[i]),
            "log_bayes_factor": float(found.gain[i]),
            "extrinsic": bool(found.extrinsic[i]),
        }
        if i in places:
            out.append(_moved(stack, best, places[i], scale, clock, common, _named(found, i, names)))
        else:
            hidden = scale * _hidden(stack, *here, i)
            status = _still(hidden, scale * _hidden(stack, *calm, i), float(probability[i]))
            out.append(Movement(**common, status=status, hidden=hidden))
    return tuple(out)


def _still(hidden: float, otherwise: float, probability: float) -> str:
    """``otherwise``: what would stay hidden if nothing moved."""
    if np.isinf(otherwise):
        return "unseen"
    if hidden > MASKED * otherwise:
        return "masked"
    return "still" if probability < 0.5 else "perhaps"


def _followed(stack: Stack, model: Solved) -> tuple[Solved, Array]:
    """A model with the part of every movement that it can follow."""
    return model, model.basis.T @ stack.movements.reshape(len(model.residual), -1)


def _named(found: Selection, i: int, names: Sequence[str]) -> dict[str, float]:
    return {names[k]: odds for k, odds in found.alike[i].items()}


def _moved(
    stack: Stack,
    best: Solved,
    place: int,
    scale: float,
    clock: Array,
    common: Mapping[str, Any],
    alike: Mapping[str, float],
) -> Movement:
    """Change since the first session, and a straight line through it."""
    n, k = stack.jacobian.shape[2], stack.contrasts.shape[1]
    at = slice(n + place * k, n + (place + 1) * k)
    since = scale * best.accepted[place][1] * (stack.contrasts - stack.contrasts[0])
    change = since @ best.mean[at]
    root = since @ best.root[at]
    line = straight_line(clock - clock[0], change, root)
    return Movement(
        **common,
        status="moved" if common["probability"] > SURE else "perhaps",
        change=tuple(change.tolist()),
        std=tuple(np.linalg.norm(root, axis=1).tolist()),
        rate=line and line[0],
        rate_std=line and line[1],
        steady=line is None or line[2] > UNSTEADY,
        alike=alike,
    )


def straight_line(elapsed: Array, change: Array, root: Array) -> tuple[float, float, float] | None:
    """Rate, its 1-sigma and p of a straight line through the first session; None when no time passed.

    Where the line does not fit, the 1-sigma is widened by Birge's ratio.
    """
    covariance = root[1:] @ root[1:].T
    weighted = np.linalg.lstsq(covariance, np.column_stack([elapsed[1:], change[1:]]), rcond=1e-12)[0]
    gain = float(elapsed[1:] @ weighted[:, 0])
    if gain <= 0.0:
        return None
    rate = float(elapsed[1:] @ weighted[:, 1]) / gain
    left = change[1:] - rate * elapsed[1:]
    chi2, freedom = float(left @ (weighted[:, 1] - rate * weighted[:, 0])), len(elapsed) - 2
    if freedom <= 0:
        return rate, gain**-0.5, 1.0
    return rate, gain**-0.5 * max(1.0, float(np.sqrt(chi2 / freedom))), float(stats.chi2.sf(chi2, freedom))


def _hidden(stack: Stack, model: Solved, inside: Array, i: int) -> float:
    """1-sigma, in steps, of a movement of parameter i from the first session to the last, if it moved alone."""
    if not stack.visible[i]:
        return float("inf")
    values, vectors, _ = information(stack, model, inside, (i,))
    along = vectors.T @ (stack.contrasts[-1] - stack.contrasts[0])
    seen = values > BLIND * np.max(np.linalg.norm(stack.jacobian[:, :, i], axis=1)) ** 2
    if np.any(np.abs(along[~seen]) > BLIND):
        return float("inf")
    return float(np.linalg.norm(along[seen] / np.sqrt(values[seen])))
