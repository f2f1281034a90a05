"""Measurement poses that calibrate a machine best, before anything is measured.

``plan`` draws poses at random, exchanges them for better candidates and moves them inside the joints' ranges,
each step no worse than the one before. What a set of poses is worth is a criterion of the information that its
readings will hold about the constants of the machine file, its effects included (telescope paper, section 6.3).

When is a set of poses better than another? Criteria of the information that its readings hold.

All are functions of the eigenvalues of an information matrix, which makes their gradients exact in one line.
``d`` and ``a`` weigh the readings together with the tolerances (Bayesian), so that a direction nothing can see
costs nothing; ``o1`` to ``o5`` are the observability indices of the readings alone, on the directions that
poses of this machine can show.

Choosing poses among candidates: add the pose that gains most, eliminate the one that is missed least.

DETMAX (Mitchell 1974), which IOOPS (Daney, Papegay and Blaise, IJRR 24, 2005; telescope paper, section 6.3) does
for robots. What an added or eliminated pose changes is an update of low rank of the information, so that
log det follows from a small determinant and no matrix of full size is decomposed for a candidate.

Moving all poses at once inside the joints' ranges, with the criterion's exact gradient (paper, Fig. 13).

Use ``climb`` from a good design: the criterion has many local maxima. Poses that cannot be assembled, or lie
next to a singularity, are never entered: a pose that would goes on in a smaller box around its last good place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.fit.decomposition import Decomposition, Observability
from truepose.identification.leaves.planning.information import PoseInformation, Poses, Supply, rounded
from truepose.models.machine.machine import Machine, MachineLike, as_machine
from truepose.shown.result import Shown, frame

if TYPE_CHECKING:
    import pandas as pd


# -- When is a set of poses better than another? Criteria of the information that its readings hold

OPEN = 1e-28
"""A direction is open when its share of the information is below this: rounding of singular values, squared."""


@dataclass(frozen=True)
class Criterion:
    """What is maximised: ``value`` of the eigenvalues (..., k), ascending, and its derivative ``slope`` by them.

    ``with_prior``: the information includes that of the tolerances. ``determinant``: the value is log det.
    """

    name: str
    title: str
    with_prior: bool
    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    determinant: bool = False


def _log_sum(power: float, factor: float) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """factor * log(sum of eigenvalue^power) with its slope."""

    def value(w: Array) -> Array:
        return np.asarray(factor * np.log(np.sum(w**power, axis=-1)))

    def slope(w: Array) -> Array:
        return np.asarray(factor * power * w ** (power - 1.0) / np.sum(w**power, axis=-1, keepdims=True))

    return value, slope


def _ends(least: float, largest: float) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """least * log(smallest eigenvalue) + largest * log(largest eigenvalue) with its slope."""

    def value(w: Array) -> Array:
        return np.asarray(least * np.log(w[..., 0]) + largest * np.log(w[..., -1]))

    def slope(w: Array) -> Array:
        out = np.zeros_like(w)
        out[..., 0] += least / w[..., 0]
        out[..., -1] += largest / w[..., -1]
        return out

    return value, slope


def _log_det(w: Array) -> Array:
    return np.asarray(np.sum(np.log(w), axis=-1))


def _log_det_slope(w: Array) -> Array:
    return np.asarray(1.0 / w)


# singular values of the Jacobian are roots of the eigenvalues: log O = 1/2 of the same in eigenvalues
CRITERIA: Mapping[str, Criterion] = {
    c.name: c
    for c in (
        Criterion("d", "log det(J'J + prior)", True, _log_det, _log_det_slope, True),
        Criterion("a", "-log trace (J'J + prior)^-1", True, *_log_sum(-1.0, -1.0)),
        Criterion("o1", "log det J'J", False, _log_det, _log_det_slope, True),
        Criterion("o2", "log (s_min / s_max)", False, *_ends(0.5, -0.5)),
        Criterion("o3", "log s_min", False, *_ends(0.5, 0.0)),
        Criterion("o4", "log (s_min^2 / s_max)", False, *_ends(1.0, -0.5)),
        Criterion("o5", "-log sum 1/s", False, *_log_sum(-0.5, -1.0)),
    )
}
"""By name. o1 Borm and Menq, o2 Driels and Pathre, o3 and o4 Nahvi and Hollerbach 1996, o5 Sun and Hollerbach 2008."""


@dataclass(frozen=True)
class Objective:
    """A criterion in the coordinates it is judged in: ``basis`` (k, r); ``prior`` (r, r), root of its information.

    Values come from singular values of the rows: the information has the square of their condition, and its
    small eigenvalues would be lost in rounding. The information itself serves to rank candidates.
    """

    criterion: Criterion
    basis: Array
    prior: Array

    def project(self, rows: Array) -> Array:
        """Rows of a Jacobian (..., k) in the objective's r directions: (..., r)."""
        return np.asarray(rows @ self.basis)

    def value(self, rows: Array) -> float:
        """Criterion of projected rows (n, m, r); -inf where they leave a direction open."""
        w, _ = self._spectrum(rows)
        return float(self.criterion.value(w)) if w[0] > OPEN * w[-1] else -np.inf

    def slope(self, rows: Array) -> Array:
        """(r, r) symmetric derivative of the criterion by the information, at projected rows."""
        w, v = self._spectrum(rows)
        return np.asarray((v * self.criterion.slope(np.maximum(w, OPEN * w[-1]))) @ v.T)

    def whitening(self, rows: Array) -> Array:
        """(r, r) W with W W' the inverse of the information at projected rows."""
        w, v = self._spectrum(rows)
        return np.asarray(v / np.sqrt(w))

    def information(self, rows: Array) -> Array:
        """(r, r) information of projected rows (n, m, r) and prior."""
        flat = rows.reshape(-1, rows.shape[-1])
        return np.asarray(flat.T @ flat + self.prior.T @ self.prior)

    def ranks(self, matrices: Array) -> Array:
        """(c,) criterion of information matrices (c, r, r), as well as these hold it."""
        w = np.linalg.eigvalsh(matrices)
        good = w[:, 0] > OPEN * w[:, -1]
        return np.where(good, self.criterion.value(np.where(good[:, None], w, 1.0)), -np.inf)

    def _spectrum(self, rows: Array) -> tuple[Array, Array]:
        """Eigenvalues of the information, ascending, and eigenvectors as columns."""
        stacked = np.vstack([rows.reshape(-1, rows.shape[-1]), self.prior])
        _, s, vt = np.linalg.svd(np.linalg.qr(stacked, mode="r"), full_matrices=False)
        return np.asarray(s[::-1] ** 2), np.asarray(vt[::-1].T)


# -- Choosing poses among candidates: add the pose that gains most, eliminate the one that is missed least

DEPTH = 3
"""Poses added (or eliminated) in a row before as many are eliminated (added)."""
LEAST_GAIN = 1e-6
"""An excursion that gains less, relative to the criterion, is not worth its time."""
_SHORTLIST = 16


@dataclass(frozen=True)
class Pool:
    """Candidates: signatures (c, m, r) in the objective's coordinates; differs (m,) as in ``PoseInformation``."""

    signature: Array
    differs: Mask

    @classmethod
    def of(cls, signature: Array, differs: Mask) -> Pool:
        """From signatures (c, m, r), with as few rows a candidate as hold the same information.

        Where a reading is a difference, ``differs`` (m,), all rows stay.
        """
        if differs.any() or not len(signature):
            return cls(signature, differs)
        _, s, v = np.linalg.svd(signature, full_matrices=False)
        rank = max(1, int(np.max(np.sum(s > 1e-12 * np.max(s), axis=1))))
        return cls(s[:, :rank, None] * v[:, :rank], np.zeros(rank, dtype=bool))

    def row(self, candidate: Index | int, before: int | None) -> Array:
        """Jacobian (..., m, r) of poses, ``candidate`` (...,), that follow ``before`` (None: they come first)."""
        here = self.signature[candidate]
        if not self.differs.any():
            return np.asarray(here)
        earlier = here if before is None else self.signature[before]
        return np.asarray(here - np.where(self.differs[:, None], earlier, 0.0))

    def rows(self, design: Sequence[int]) -> Array:
        """(n, m, r) Jacobian of a design."""
        before = [None, *design[:-1]]
        return np.array([self.row(c, b) for c, b in zip(design, before, strict=True)])


def exchange(pool: Pool, objective: Objective, start: Sequence[int]) -> list[int]:
    """A design with as many poses as ``start`` (indices of candidates, repeats allowed), never worse than it.

    Excursions of up to ``DEPTH`` poses, adding first or eliminating first; each that gains is kept, until none
    does.
    """
    best = list(start)
    value = objective.value(pool.rows(best))
    depth, adding = 1, True
    while depth <= DEPTH and depth < len(best):
        trial = list(best)
        for step in (adding, not adding):
            for _ in range(depth):
                trial = _added(pool, objective, trial) if step else _eliminated(pool, objective, trial)
        found = objective.value(pool.rows(trial))
        if found > value + LEAST_GAIN * max(1.0, abs(value)):
            best, value, depth, adding = trial, found, 1, True
        elif adding:
            adding = False
        else:
            depth, adding = depth + 1, True
    return best


def _added(pool: Pool, objective: Objective, design: list[int]) -> list[int]:
    """The design with the candidate that gains most at its end."""
    rows = pool.rows(design)
    update = pool.row(np.arange(len(pool.signature)), design[-1])
    scores = _scores(objective, rows, update, np.ones(update.shape[1]))
    if len(design) < len(scores):
        scores[design] = -np.inf
    return [*design, int(np.argmax(scores))]


def _eliminated(pool: Pool, objective: Objective, design: list[int]) -> list[int]:
    """The design without the pose that is missed least."""
    rows = pool.rows(design)
    m = pool.signature.shape[1]
    if not pool.differs.any():
        scores = _scores(objective, rows, rows, -np.ones(m))
    else:  # the next pose then counts from the one before
        ends = [None, *design, None]
        updates = np.zeros((len(design), 3 * m, pool.signature.shape[2]))
        for k, here in enumerate(design):
            before, after = ends[k], ends[k + 2]
            updates[k, :m] = pool.row(here, before)
            if after is not None:
                updates[k, m : 2 * m], updates[k, 2 * m :] = pool.row(after, here), pool.row(after, before)
        scores = _scores(objective, rows, updates, np.repeat([-1.0, -1.0, 1.0], m))
    worst = int(np.argmax(scores))
    return design[:worst] + design[worst + 1 :]


def _scores(objective: Objective, rows: Array, updates: Array, signs: Array) -> Array:
    """(c,) scores, the largest the best, of updates U' diag(signs) U, U (c, u, r), of the rows' information.

    log det(M + U'SU) - log det M = log det(1 + S U M^-1 U'). Other criteria are ranked by their slope, and the
    best of these by their value.
    """
    if objective.criterion.determinant and objective.value(rows) > -np.inf:
        white = updates @ objective.whitening(rows)
        small = np.eye(len(signs)) + signs[:, None] * (white @ white.transpose(0, 2, 1))
        sign, value = np.linalg.slogdet(small)
        return np.where(sign > 0, value, -np.inf)
    likely = np.sum((updates @ objective.slope(rows)) * updates, axis=2) @ signs
    out = np.full(len(updates), -np.inf)
    short = np.argsort(-likely)[:_SHORTLIST]
    some = updates[short]
    out[short] = objective.ranks(
        objective.information(rows) + some.transpose(0, 2, 1) @ (signs[:, None] * some)
    )
    return out


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
    """

    machine: Machine
    method: str
    criterion: Criterion
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
        """What is left of the 1-sigma of a determined direction, geometric mean, against random poses.

        None where the criterion is no determinant.
        """
        if not self.criterion.determinant or not self.determined or self.by_chance is None:
            return None
        return float(np.exp(-(self.value - self.by_chance[0]) / (2.0 * self.determined)))

    @property
    def by_chance(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the criterion of random poses; None where one set leaves a constant open."""
        if not np.isfinite(self.random).all():
            return None
        return float(np.mean(self.random)), float(np.std(self.random))

    def to_frame(self) -> pd.DataFrame:
        """The rows that ``truepose plan`` writes: ``pose``, ``from`` where readings are changes, then the joints, in the units
        of the machine file.
        """
        return frame(self)

    def repeats(self, share: float) -> int:
        """How many poses have an earlier one whose joints are all within ``share`` of their ranges."""
        apart = np.max(np.abs(self.q[:, None] - self.q[None]) / self.span, axis=2)
        return int(np.sum(np.any(np.tril(apart <= share, -1), axis=1)))


def plan(
    machine: MachineLike,
    n: int,
    *,
    method: str = "continuous",
    criterion: str = "d",
    seed: int = 0,
    candidates: Array | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Plan:
    """``n`` poses of ``machine`` for calibration; the same from the same ``seed``.

    ``method`` is continuous (random, then exchange, then moving all poses at once), exchange or random;
    ``criterion`` one of ``CRITERIA``. ``candidates`` (c, nq) are the poses to choose from, such as those known to
    be free of collisions; without them every pose inside the joints' ranges may be chosen. Readings that are
    changes count from the pose before. Raises InputError where ranges are missing, too few poses can be
    assembled or n is too small for the criterion.
    """
    machine = as_machine(machine)
    judged = _checked(n, method, criterion, candidates)
    information = PoseInformation(machine)
    progress("looking at candidates")
    work = _Work.of(information, n, judged, candidates, seed)
    q, by_exchange = work.design(method, seed, progress)
    found = information.at(q if candidates is not None else _short(q, work.landscape, machine))
    return Plan(
        machine=machine,
        method=method,
        criterion=judged,
        seed=seed,
        q=found.q,
        span=information.span,
        origin=np.maximum(np.arange(n) - 1, 0) if information.differs.any() else None,
        value=_finite(work.landscape.value(found), judged, n),
        random=work.values,
        by_exchange=by_exchange,
        determined=work.determined,
        indices=_indices(information, found),
        left_out=work.supply.left_out,
    )


@dataclass(frozen=True)
class _Work:
    """Candidates, random sets of poses with their values (DRAWS,), and the criterion, of which they determine directions."""

    supply: Supply
    draws: Sequence[Poses]
    landscape: Landscape
    determined: int
    values: Array

    @classmethod
    def of(
        cls, information: PoseInformation, n: int, criterion: Criterion, candidates: Array | None, seed: int
    ) -> _Work:
        rng = np.random.default_rng(seed)
        supply = Supply.of(information, candidates, rng)
        draws = [supply.draw(n, rng) for _ in range(DRAWS)]
        objective, determined = _objective(information, criterion, draws)
        landscape = Landscape(information, objective, supply.strongest)
        return cls(supply, draws, landscape, determined, np.array([landscape.value(draw) for draw in draws]))

    def design(self, method: str, seed: int, progress: Callable[[str], None]) -> tuple[Array, float | None]:
        """(n, nq) joint values, and the criterion after the exchange where there was one."""
        if method == "random":
            return self.draws[0].q, None
        progress("exchanging poses")
        q = _exchanged(self.landscape, self.supply, self.draws[int(np.argmax(self.values))])
        exchanged = self.landscape.value(self.landscape.information.at(q))
        return climb(self.landscape, q, seed, progress) if method == "continuous" else q, exchanged


def _checked(n: int, method: str, criterion: str, candidates: Array | None) -> Criterion:
    if method not in METHODS:
        raise InputError(f"method: found {method!r}, expected one of {', '.join(METHODS)}")
    if criterion not in CRITERIA:
        raise InputError(f"criterion: found {criterion!r}, expected one of {', '.join(CRITERIA)}")
    if n < 2:
        raise InputError(f"found {n} poses, expected at least 2")
    if candidates is not None and method == "continuous":
        raise InputError(
            "method: found 'continuous' with candidates, expected 'exchange' or 'random': candidates stay in place"
        )
    return CRITERIA[criterion]


def _objective(
    information: PoseInformation, criterion: Criterion, draws: Sequence[Poses]
) -> tuple[Objective, int]:
    """The criterion in its coordinates, and how many directions random poses determine."""
    k = len(information.names)
    rows = [information.rows(draw.signature).reshape(-1, k) for draw in draws]
    mean = sum((r.T @ r for r in rows), np.zeros((k, k))) / len(rows)
    w, v = np.linalg.eigh(mean)
    seen = w > SEEN
    if criterion.with_prior:
        return Objective(criterion, np.eye(k), np.diag(information.weight)), int(np.sum(seen))
    count = int(np.sum(np.any(rows[0] != 0.0, axis=1)))
    if count < np.sum(seen) or not seen.any():
        raise InputError(
            f"criterion {criterion.name}: found {len(draws[0].q)} poses ({count} readings), expected at least "
            f"{max(int(np.sum(seen)), 1)} readings: as many as directions that poses of this machine can show; "
            "take more poses, or criterion d"
        )
    return Objective(criterion, v[:, seen], np.zeros((int(np.sum(seen)),) * 2)), int(np.sum(seen))


def _exchanged(landscape: Landscape, supply: Supply, start: Poses) -> Array:
    """(n, nq) joint values of the exchange's design, from the poses of ``start`` and of the supply."""
    signature = np.concatenate([supply.poses.signature, start.signature])
    q = np.concatenate([supply.poses.q, start.q])
    pool = Pool.of(landscape.objective.project(signature), landscape.information.differs)
    design = exchange(pool, landscape.objective, list(range(len(supply.poses.q), len(q))))
    return np.asarray(q[design])


def _short(q: Array, landscape: Landscape, machine: Machine) -> Array:
    """Joint values without needless digits, but for poses that would no longer do."""
    short = rounded(q, machine, STEP)
    fine = landscape.information.at(short).within(landscape.strongest)
    return np.where(fine[:, None], short, q)


def _finite(value: float, criterion: Criterion, n: int) -> float:
    if not np.isfinite(value):
        raise InputError(
            f"criterion {criterion.name}: found {n} poses that leave some constants open, expected more poses, or "
            "criterion d"
        )
    return value


def _indices(information: PoseInformation, poses: Poses) -> Observability:
    rows = information.rows(poses.signature).reshape(-1, len(information.names))
    found = Decomposition.of(np.asarray(np.linalg.qr(rows, mode="r")), information.weight)
    return found.observability(int(np.sum(np.any(rows != 0.0, axis=1))))
