"""Plan the measurement poses that calibrate a machine best, before anything is measured.

``plan`` draws poses at random, exchanges them for better candidates and moves them inside the joints' ranges,
each step no worse than the one before. What a set of poses is worth is log det of the information that its readings will
hold about the constants of the machine file, its effects included, together with their tolerances (telescope paper, section
6.3): a direction that nothing can see costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index
from truepose.errors import InputError
from truepose.identification.fit.decomposition import Decomposition, Observability
from truepose.identification.leaves.planning.climb import Landscape, climb
from truepose.identification.leaves.planning.exchange import Pool, exchange
from truepose.identification.leaves.planning.information import PoseInformation, Poses, Supply, rounded
from truepose.models.machine.machine import Machine, MachineLike, as_machine
from truepose.shown.result import Shown

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
