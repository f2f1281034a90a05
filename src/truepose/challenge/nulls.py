"""Recordings in which nothing is missing, and what may look as if something were."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from truepose.challenge import schedule
from truepose.challenge.simulator.base import Campaign, Plan, SimulatedMachine

Array = NDArray[np.float64]
TAIL_FREEDOM = 4.0
OUTLYING_SHARE = 0.02


@dataclass(frozen=True)
class Decoy:
    """How a recording without missing physics differs from the drawing's promises.

    noise: true over stated sigma; tolerance: true over stated tolerance; tails: "", "t" (Student's t with 4 degrees
    of freedom) or "outliers" (2 % of the rows).
    """

    noise: float = 1.0
    tolerance: float = 1.0
    tails: str = ""
    plan: Plan = field(default_factory=Plan)


def decoy(variant: str, rng: np.random.Generator) -> Decoy:
    """What a sort of null case does; clean ones may leave loads, heat or sides unvaried."""
    if variant == schedule.CLEAN:
        loads, heat, sides = (bool(v) for v in rng.integers(0, 2, 3))
        return Decoy(plan=Plan(loads=loads, heat=heat, both_sides=sides))
    plan = Plan(sessions=int(rng.integers(1, 3)))
    if variant == schedule.TAILS:
        return Decoy(tails=("t", "outliers")[int(rng.integers(2))], plan=plan)
    if variant == schedule.SIGMA:
        return Decoy(noise=float(np.exp(rng.uniform(np.log(0.5), np.log(2.5)))), plan=plan)
    if variant == schedule.TOLERANCES:
        return Decoy(tolerance=float(rng.uniform(3.0, 4.0)), plan=plan)
    return Decoy(plan=plan)


def noisy(
    machine: SimulatedMachine,
    exact: Array,
    campaign: Campaign,
    rng: np.random.Generator,
    kind: Decoy,
) -> Array:
    """(n, k) exact readings (n, k) with the instrument's noise, which a decoy may enlarge in some rows."""
    read = machine.noisy(exact, campaign, rng, factor=kind.noise)
    n = len(exact)
    if kind.tails == "t":
        enlarged = 1 / np.sqrt(rng.chisquare(TAIL_FREEDOM, n) / TAIL_FREEDOM)
    elif kind.tails == "outliers":
        enlarged = np.ones(n)
        rows = rng.permutation(n)[: max(1, round(OUTLYING_SHARE * n))]
        enlarged[rows] = rng.uniform(8.0, 20.0, len(rows))
    else:
        return read
    out: Array = exact + enlarged[:, None] * (read - exact)
    return out


__all__ = ["Decoy", "decoy", "noisy"]
