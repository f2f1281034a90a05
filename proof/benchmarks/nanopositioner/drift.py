"""How long a calibration lasts: the paper's sequence of eight days, with three ways to keep up.

Each day's truth is that day's tables. ``kept``: the constants of day 0 are used on; ``extrinsic``: extrinsics are
identified again, intrinsics stay those of day 0; ``both``: everything is identified again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .plan import paper_plan
from .recordings import DRIFT_POINTS
from .study import Array, Score, identify, identify_extrinsic, recorded, score
from .tables import DAY_0, DAY_1, SEQUENCE, Tabled, between
from .trajectories import Trace, circle

WAYS = ("kept", "extrinsic", "both")


@dataclass(frozen=True)
class Day:
    """One day's constants (np,), scores and circles by the way in which the constants were kept up."""

    table: Tabled
    constants: dict[str, Array]
    scores: dict[str, Score]
    circles: dict[str, Trace]


def days(seed: int = 100) -> list[Day]:
    """The five days of the paper."""
    plan = paper_plan()
    first = identify(recorded(plan, DRIFT_POINTS, DAY_0, seed=seed)).p
    out = []
    for k, table in enumerate(SEQUENCE):
        again = recorded(plan, DRIFT_POINTS, table, seed=seed + 1 + k)
        found = dict(zip(WAYS, (first, identify_extrinsic(again, first).p, identify(again).p), strict=True))
        out.append(
            Day(
                table,
                found,
                {way: score(p, table) for way, p in found.items()},
                {way: circle(p, table) for way, p in found.items()},
            )
        )
    return out


def hours(first: Array, until: float = 14.0, step: float = 2.0) -> list[tuple[float, Trace]]:
    """Figure 13: the circle every two hours with the constants ``first`` (np,), the truth moving evenly to day 1."""
    out = []
    for hour in np.arange(0.0, until + step / 2, step):
        out.append((float(hour), circle(first, between(DAY_0, DAY_1, hour / 24))))
    return out


def day_rows(found: list[Day]) -> list[list[str]]:
    """rms of predicted dL on the fresh motions, nm, and swing of the cavity on the circle, nm."""
    rows = []
    for day in found:
        errors = [f"{day.scores[way].length:.0f}" for way in WAYS]
        swings = [f"{1e3 * day.circles[way].swing:.0f}" for way in WAYS]
        rows.append([f"{day.table.day:g}", *errors, *swings])
    return rows


DAY_HEAD = (
    "day",
    *(f"dL, nm: {way}" for way in ("all kept", "extrinsics again", "all again")),
    *(f"circle, nm: {way}" for way in ("all kept", "extrinsics again", "all again")),
)
