"""Measurement poses that calibrate a machine best, before anything is measured.

``plan`` draws poses at random, exchanges them for better candidates and moves them inside the joints' ranges,
each step no worse than the one before. What a set of poses is worth is log det of the information that its readings will
hold about the constants of the machine file, its effects included, together with their tolerances (telescope paper, section
6.3): a direction that nothing can see costs nothing.

Choosing poses among candidates: add the pose that gains most, eliminate the one that is missed least.

DETMAX (Mitchell 1974), which IOOPS (Daney, Papegay and Blaise, IJRR 24, 2005; telescope paper, section 6.3) does
for robots. What an added or eliminated pose changes is an update of low rank of the information, so that
log det follows from a small determinant and no matrix of full size is decomposed for a candidate.

Moving all poses at once inside the joints' ranges, with the criterion's exact gradient (paper, Fig. 13).

Use ``climb`` from a good design: the criterion has many local maxima. Poses that cannot be assembled, or lie
next to a singularity, are never entered: a pose that would goes on in a smaller box around its last good place.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.fit.decomposition import Decomposition, Observability
from truepose.identification.leaves.planning.information import PoseInformation, Poses, Supply, rounded
from truepose.models.machine.machine import Machine, MachineLike, as_machine
from truepose.shown.result import Shown

# -- What a set of poses is worth

CRITERION, TITLE = "d", "log det(J'J + prior)"


def log_det(rows: Array, weight: Array) -> float:
    """Return log det of the information of rows (n, m, k) of a Jacobian and of what tolerances say, ``weight`` (k,).

    From singular values: the information has the square of their condition, and its small eigenvalues would be lost in
    rounding.
    """
    return float(np.sum(np.log(_spectrum(rows, weight)[0])))


def _spectrum(rows: Array, weight: Array) -> tuple[Array, Array]:
    """Return eigenvalues (k,) of the information, ascending, and eigenvectors as columns."""
    stacked = np.vstack([rows.reshape(-1, rows.shape[-1]), np.diag(weight)])
    _, s, vt = np.linalg.svd(np.linalg.qr(stacked, mode="r"), full_matrices=False)
    return np.asarray(s[::-1] ** 2), np.asarray(vt[::-1].T)


# -- Choosing poses among candidates: add the pose that gains most, eliminate the one that is missed least

DEPTH = 3
"""Poses added (or eliminated) in a row before as many are eliminated (added)."""
LEAST_GAIN = 1e-6
"""An excursion that gains less, relative to the criterion, is not worth its time."""


@dataclass(frozen=True)
class Pool:
    """Candidates: signatures (c, m, k); differs (m,) and weight (k,) as in ``PoseInformation``."""

    signature: Array
    differs: Mask
    weight: Array

    @classmethod
    def of(cls, signature: Array, information: PoseInformation) -> Pool:
        """From signatures (c, m, k), with as few rows a candidate as hold the same information.

        Where a reading is a difference all rows stay.
        """
        if information.differs.any():
            return cls(signature, information.differs, information.weight)
        _, s, v = np.linalg.svd(signature, full_matrices=False)
        rank = max(1, int(np.max(np.sum(s > 1e-12 * np.max(s), axis=1))))
        return cls(s[:, :rank, None] * v[:, :rank], np.zeros(rank, dtype=bool), information.weight)

    def row(self, candidate: Index | int, before: int | None) -> Array:
        """Jacobian (..., m, k) of poses, ``candidate`` (...,), that follow ``before`` (None: they come first)."""
        here = self.signature[candidate]
        if not self.differs.any():
            return np.asarray(here)
        earlier = here if before is None else self.signature[before]
        return np.asarray(here - np.where(self.differs[:, None], earlier, 0.0))

    def rows(self, design: Sequence[int]) -> Array:
        """(n, m, k) Jacobian of a design."""
        before = [None, *design[:-1]]
        return np.array([self.row(c, b) for c, b in zip(design, before, strict=True)])

    def value(self, design: Sequence[int]) -> float:
        """Criterion of a design."""
        return log_det(self.rows(design), self.weight)


def exchange(pool: Pool, start: Sequence[int]) -> list[int]:
    """A design with as many poses as ``start`` (indices of candidates, repeats allowed), never worse than it.

    Excursions of up to ``DEPTH`` poses, adding first or eliminating first; each that gains is kept, until none
    does.
    """
    best = list(start)
    value = pool.value(best)
    depth, adding = 1, True
    while depth <= DEPTH and depth < len(best):
        trial = list(best)
        for step in (adding, not adding):
            for _ in range(depth):
                trial = _added(pool, trial) if step else _eliminated(pool, trial)
        found = pool.value(trial)
        if found > value + LEAST_GAIN * max(1.0, abs(value)):
            best, value, depth, adding = trial, found, 1, True
        elif adding:
            adding = False
        else:
            depth, adding = depth + 1, True
    return best


def _added(pool: Pool, design: list[int]) -> list[int]:
    """The design with the candidate that gains most at its end."""
    rows = pool.rows(design)
    update = pool.row(np.arange(len(pool.signature)), design[-1])
    scores = _scores(pool, rows, update, np.ones(update.shape[1]))
    if len(design) < len(scores):
        scores[design] = -np.inf
    return [*design, int(np.argmax(scores))]


def _eliminated(pool: Pool, design: list[int]) -> list[int]:
    """The design without the pose that is missed least."""
    rows = pool.rows(design)
    m = pool.signature.shape[1]
    if not pool.differs.any():
        scores = _scores(pool, rows, rows, -np.ones(m))
    else:  # the next pose then counts from the one before
        ends = [None, *design, None]
        updates = np.zeros((len(design), 3 * m, pool.signature.shape[2]))
        for k, here in enumerate(design):
            before, after = ends[k], ends[k + 2]
            updates[k, :m] = pool.row(here, before)
            if after is not None:
                updates[k, m : 2 * m], updates[k, 2 * m :] = pool.row(after, here), pool.row(after, before)
        scores = _scores(pool, rows, updates, np.repeat([-1.0, -1.0, 1.0], m))
    worst = int(np.argmax(scores))
    return design[:worst] + design[worst + 1 :]


def _scores(pool: Pool, rows: Array, updates: Array, signs: Array) -> Array:
    """Return (c,) what updates U' diag(signs) U, U (c, u, k), of the rows' information add to the criterion.

    log det(M + U'SU) - log det M = log det(1 + S U M^-1 U').
    """
    values, vectors = _spectrum(rows, pool.weight)
    white = updates @ (vectors / np.sqrt(values))
    small = np.eye(len(signs)) + signs[:, None] * (white @ white.transpose(0, 2, 1))
    sign, value = np.linalg.slogdet(small)
    return np.where(sign > 0, value, -np.inf)


# -- Moving all poses at once inside the joints' ranges, with the criterion's exact gradient (paper, Fig. 13)

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
        values, vectors = _spectrum(rows, self.information.weight)
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


# -- Measurement poses that calibrate a machine best

METHODS = ("continuous", "exchange", "random")
DRAWS = 20
"""Sets of random poses that a plan is compared with."""
SEEN = 1.0
"""A direction counts as determined when as many random poses know it to better than a tolerance (or natural size)."""
STEP = 1e-6
"""Joint values are rounded to about this share of their range."""


@dataclass(frozen=True, repr=False)
class Plan(Shown):
    """Poses in the order of measurement.

    q (n, nq) joint values in internal units, span (nq,) their ranges' widths; origin (n,) the row each row counts
    from, None where readings are no changes; value and random (DRAWS,) of the criterion; by_exchange: its value
    before the poses were moved; determined: directions that random poses know to better than one tolerance (or
    natural size); indices: O1 to O5 of the readings; left_out: candidates that
    were no use.
    ``to_frame()``: the rows that ``truepose plan`` writes: ``pose``, ``from`` where readings are changes, then the joints,
    in the units of the machine file.
    """

    machine: Machine
    method: str
    seed: int
    q: Array
    span: Array
    origin: Index | None
    value: float
    random: Array
    by_exchange: float | None
    determined: int
    indices: Observability
    left_out: int

    @property
    def shrinkage(self) -> float | None:
        """What is left of the 1-sigma of a determined direction, geometric mean, against random poses; None without any."""
        if not self.determined:
            return None
        return float(np.exp(-(self.value - np.mean(self.random)) / (2.0 * self.determined)))

    def repeats(self, share: float) -> int:
        """How many poses have an earlier one whose joints are all within ``share`` of their ranges."""
        apart = np.max(np.abs(self.q[:, None] - self.q[None]) / self.span, axis=2)
        return int(np.sum(np.any(np.tril(apart <= share, -1), axis=1)))


def plan(
    machine: MachineLike,
    n: int,
    *,
    method: str = "continuous",
    seed: int = 0,
    candidates: Array | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Plan:
    """``n`` poses of ``machine`` for calibration; the same from the same ``seed``.

    ``method`` is continuous (random, then exchange, then moving all poses at once), exchange or random. ``candidates`` (c, nq)
    are the poses to choose from, such as those known to be free of collisions; without them every pose inside the joints'
    ranges may be chosen. Readings that are changes count from the pose before. Raises InputError where ranges are missing or
    too few poses can be assembled.
    """
    machine = as_machine(machine)
    _check(n, method, candidates)
    information = PoseInformation(machine)
    progress("looking at candidates")
    rng = np.random.default_rng(seed)
    supply = Supply.of(information, candidates, rng)
    landscape = Landscape(information, supply.strongest)
    draws = [supply.draw(n, rng) for _ in range(DRAWS)]
    values = np.array([landscape.value(draw) for draw in draws])
    q, by_exchange = draws[0].q, None
    if method != "random":
        progress("exchanging poses")
        q = _exchanged(landscape, supply, draws[int(np.argmax(values))])
        by_exchange = landscape.value(information.at(q))
    if method == "continuous":
        q = climb(landscape, q, seed, progress)
    found = information.at(q if candidates is not None else _short(q, landscape, machine))
    return Plan(
        machine=machine,
        method=method,
        seed=seed,
        q=found.q,
        span=information.span,
        origin=np.maximum(np.arange(n) - 1, 0) if information.differs.any() else None,
        value=landscape.value(found),
        random=values,
        by_exchange=by_exchange,
        determined=_determined(information, draws),
        indices=_indices(information, found),
        left_out=supply.left_out,
    )


def _check(n: int, method: str, candidates: Array | None) -> None:
    if method not in METHODS:
        raise InputError(f"method: found {method!r}, expected one of {', '.join(METHODS)}")
    if n < 2:
        raise InputError(f"found {n} poses, expected at least 2")
    if candidates is not None and method == "continuous":
        raise InputError(
            "method: found 'continuous' with candidates, expected 'exchange' or 'random': candidates stay in place"
        )


def _determined(information: PoseInformation, draws: Sequence[Poses]) -> int:
    """Return how many directions random poses determine."""
    rows = [information.rows(draw.signature).reshape(-1, len(information.names)) for draw in draws]
    mean = sum(r.T @ r for r in rows) / len(rows)
    return int(np.sum(np.linalg.eigvalsh(mean) > SEEN))


def _exchanged(landscape: Landscape, supply: Supply, start: Poses) -> Array:
    """(n, nq) joint values of the exchange's design, from the poses of ``start`` and of the supply."""
    q = np.concatenate([supply.poses.q, start.q])
    pool = Pool.of(np.concatenate([supply.poses.signature, start.signature]), landscape.information)
    return np.asarray(q[exchange(pool, list(range(len(supply.poses.q), len(q))))])


def _short(q: Array, landscape: Landscape, machine: Machine) -> Array:
    """Joint values without needless digits, but for poses that would no longer do."""
    short = rounded(q, machine, STEP)
    fine = landscape.information.at(short).within(landscape.strongest)
    return np.where(fine[:, None], short, q)


def _indices(information: PoseInformation, poses: Poses) -> Observability:
    rows = information.rows(poses.signature).reshape(-1, len(information.names))
    found = Decomposition.of(np.asarray(np.linalg.qr(rows, mode="r")), information.weight)
    return found.observability(int(np.sum(np.any(rows != 0.0, axis=1))))
