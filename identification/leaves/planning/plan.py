"""Measurement poses that calibrate a machine best, before anything is measured.

``plan`` draws poses at random, exchanges them for better candidates and moves them inside the joints' ranges,
each step no worse than the one before. What a set of poses is worth is a criterion of the information that its
readings will hold about the constants of the machine file, its effects included (telescope paper, section 6.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from truepose.arrays import Array, Index
from truepose.errors import InputError
from truepose.identification.fit.decomposition import Decomposition, Observability
from truepose.identification.leaves.planning.criteria import (
    CRITERIA,
    Criterion,
    Landscape,
    Objective,
    Pool,
    climb,
    exchange,
)
from truepose.identification.leaves.planning.information import PoseInformation, Poses, Supply, rounded
from truepose.models.given import MachineLike, as_machine
from truepose.models.machine.machine import Machine
from truepose.shown.result import Shown, frame

if TYPE_CHECKING:
    import pandas as pd

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
