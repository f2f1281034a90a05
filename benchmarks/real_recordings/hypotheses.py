"""Hypotheses about what a ladder left: gain on held-out rows, log Bayes factor, and a placebo of shuffled rows.

The Bayes factor is Schwarz's approximation, half of what chi2 falls by less the logarithm of the number of readings
for each column; chi2 counts in units of what is left, which holds the unexplained, so that it errs towards nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from real_recordings.common import Array, Mask
from real_recordings.ladder import held_out
from real_recordings.linearised import Linearised, gravity_torques
from real_recordings.regressors import (
    MOVED,
    Rows,
    Term,
    arrival,
    direction,
    given,
    hats,
    incidence,
    mount,
    of_joint,
    share_of_path,
    tracker,
)

CHUNK = 1024
SEED = 7
PAUSE, WARM_UP = 1800.0, (600.0, 3600.0, 14400.0)
"""s: a longer pause lets the arm cool; time constants of its warming."""
PLAYS = (1e-3, 0.01, 0.1, 1.0)
"""Widths of play operators, rad."""
SMALL = 1e-4
"""rad: the size that columns of joints are given."""
_WAVES = (np.sin, np.cos)


@dataclass(frozen=True)
class Verdict:
    """Coefficients (p,), what they gain on held-out rows (position um, rotation urad), log Bayes factors."""

    coefficients: Array
    gain: tuple[float, float]
    log_bayes: float
    placebo: float


def weigh(data: Linearised, left: Array, outlier: Mask, terms: list[Term]) -> Verdict:
    """Fit the terms to what is left of the rows that are not held out; rows shuffled for the placebo."""
    rows = np.flatnonzero(~outlier)
    sigma = np.repeat([np.sqrt(np.mean(left[rows][:, k] ** 2)) for k in (slice(0, 3), slice(3, 6))], 3)
    shuffled = np.random.default_rng(SEED).permutation(len(data))
    solution, factor, after = _fit(data, left, outlier, terms, sigma, None)
    _, placebo, _ = _fit(data, left, outlier, terms, sigma, shuffled)
    before = held_out(data, left, outlier)
    now = held_out(data, after, outlier)
    return Verdict(solution, (before[0] - now[0], before[1] - now[1]), factor, placebo)


def _fit(
    data: Linearised, left: Array, outlier: Mask, terms: list[Term], sigma: Array, order: Rows | None
) -> tuple[Array, float, Array]:
    """Coefficients (p,), log Bayes factor on rows that are not held out, and what is left of all rows."""
    blocks = [np.arange(k, min(k + CHUNK, len(data))) for k in range(0, len(data), CHUNK)]

    def columns(rows: Rows) -> Array:
        drivers = None if order is None else order[rows]
        return np.concatenate([t.columns(rows, drivers) for t in terms], axis=2) / sigma[:, None]

    train = ~outlier & ~data.held
    square, right = np.zeros(()), np.zeros(())
    for rows in blocks:
        x = (columns(rows) * train[rows, None, None]).reshape(6 * len(rows), -1)
        y = (left[rows] / sigma * train[rows, None]).reshape(-1)
        square, right = square + x.T @ x, right + x.T @ y
    solution = np.asarray(np.linalg.lstsq(square, right, rcond=1e-10)[0], dtype=np.float64)
    fall = float(right @ solution)
    readings = 6.0 * float(train.sum())
    rank = int(np.linalg.matrix_rank(square, hermitian=True))
    factor = float(0.5 * (fall - rank * np.log(readings)))
    after = np.concatenate([left[rows] - columns(rows) @ solution * sigma for rows in blocks])
    return solution, factor, after


def of_arrival(data: Linearised) -> dict[str, list[Term]]:
    """How the last motion may matter; the next motion and the one before serve as controls.

    Coefficients are rad by which the joint stands short of its reading in the direction of motion.
    """
    along, sign = share_of_path(data), direction(data)
    joints = range(data.q.shape[1])

    def each(values: Array) -> list[Term]:
        return [of_joint(data, k, values[:, [k]]) for k in joints]

    out = {
        "all joints alike, by their share of the last motion": [Term(data.joint, given(along), summed=True)],
        "each joint, by its share of the last motion": each(along),
        "each joint, by its direction of arrival": each(sign),
        "each joint, by its share of the next motion (control)": each(np.roll(along, -1, axis=0)),
        "each joint, by its share of the motion before the last": each(np.roll(along, 1, axis=0)),
    }
    return out | {f"each joint, play operator of {w:g} rad": each(play(data.q, w)) for w in PLAYS}


def play(q: Array, width: float) -> Array:
    """(n, nq) place of each reading in a play of that width that it drags along, -1 to 1."""
    out, centre = np.zeros_like(q), q[0].copy()
    for k, now in enumerate(q):
        centre = np.clip(centre, now - width / 2, now + width / 2)
        out[k] = (now - centre) / (width / 2)
    return out


def of_the_rest(data: Linearised) -> dict[str, list[Term]]:
    """What is not in the ladder."""
    joints = range(data.q.shape[1])
    air = (data.temperature - data.temperature.mean())[:, None]
    order = np.arange(len(data), dtype=float)
    moving = ["base", "tool", *(f"q{k + 1}" for k in joints)]
    out: dict[str, list[Term]] = {
        "arrival once more": arrival(data),
        **_of_loads(data),
        "axes wobble, orders 1 to 3, six motions": [
            mount(data, f"q{k + 1}", _sines(data.q[:, k], (1, 2, 3))) for k in joints
        ],
        "products of waves of two joints": [of_joint(data, k, _products(data.q) * SMALL) for k in joints],
        "tracker: range, azimuth, elevation": [tracker(data)],
        "incidence of the beam on the probe": [incidence(data)],
        "air temperature: base, tool, all axes": [mount(data, name, air) for name in moving],
        "order of the rows: base, 100 knots": [mount(data, "base", hats(order, 100))],
        "order of the rows: zeros of joints, 24 knots": [
            of_joint(data, k, hats(order, 24) * SMALL) for k in joints
        ],
    }
    if data.time is not None:
        warm = np.exp(-since_pause(data.time)[:, None] / np.array(WARM_UP))
        zeros = [of_joint(data, k, warm * SMALL) for k in joints]
        out["warming up after pauses"] = [mount(data, "base", warm), *zeros]
    return out


def _of_loads(data: Linearised) -> dict[str, list[Term]]:
    """Gravity's torque about joints 2 to 4 in other ways than in proportion."""
    sign, torque = direction(data), _torques(data)

    def each(values: dict[int, Array]) -> list[Term]:
        return [of_joint(data, k, v * SMALL) for k, v in values.items()]

    return {
        "gravity not in proportion: tau|tau|, tau^3, sign": each(
            {k: np.column_stack([t * abs(t), t**3, np.tanh(5 * t)]) for k, t in torque.items()}
        ),
        "compliance that varies with the angle": each(
            {k: t[:, None] * _sines(data.q[:, k], (1, 2)) for k, t in torque.items()}
        ),
        "friction in proportion to torque": each(
            {k: (sign[:, k] * abs(t))[:, None] for k, t in torque.items()}
        ),
    }


def _sines(angle: Array, orders: tuple[int, ...]) -> Array:
    """(n, 2 * orders) sine and cosine of multiples of an angle."""
    return np.column_stack([w(o * angle) for o in orders for w in _WAVES])


def previous_row(data: Linearised, left: Array) -> list[Term]:
    """Each reading errs with the one before."""
    return [Term(np.tile(np.eye(6), (len(data), 1, 1)), given(np.roll(left, 1, axis=0)), summed=True)]


def predictable(data: Linearised) -> Array:
    """(nq,) share of each joint's direction of arrival that joint angles alone foretell, on held-out rows."""
    waves = [w(o * data.q) for o in range(1, 6) for w in _WAVES]
    x = np.column_stack([np.ones(len(data)), *waves, _products(data.q)])
    sign, train = np.where(np.abs(data.steps) > MOVED, np.sign(data.steps), 0.0), ~data.held
    solution = np.linalg.solve(x[train].T @ x[train] + 0.1 * np.eye(x.shape[1]), x[train].T @ sign[train])
    wrong = sign[data.held] - x[data.held] @ solution
    return np.asarray(1.0 - wrong.var(axis=0) / sign[data.held].var(axis=0))


def since_pause(time: Array) -> Array:
    """(n,) s since the last pause; a clock that goes back starts anew."""
    out = np.zeros(len(time))
    for k, step in enumerate(np.diff(time), start=1):
        out[k] = out[k - 1] + step if 0 <= step < PAUSE else 0.0
    return out


def _torques(data: Linearised) -> dict[int, Array]:
    """Torque of gravity about joints 2 to 4, of 1 kg at each further link's origin, in units of its largest."""
    sums = {k: gravity_torques(data, k)[:, 3:].sum(axis=1) for k in (1, 2, 3)}
    return {k: t / np.abs(t).max() for k, t in sums.items()}


def _products(q: Array) -> Array:
    """(n, m) products of waves of order 1 of every two joints."""
    pairs = [(i, j) for i in range(q.shape[1]) for j in range(i + 1, q.shape[1])]
    return np.column_stack([f(q[:, i]) * g(q[:, j]) for i, j in pairs for f in _WAVES for g in _WAVES])
