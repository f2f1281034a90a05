"""How a recording departs from what its drawing promises: a sigma or tolerances that are wrong, rows that are wild.

Recordings in which no physics is missing depart in one way each (decoys); half of all others depart in every way.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from challenge import schedule
from challenge.measures import difference
from challenge.simulator.base import Campaign, Plan, SimulatedMachine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
TAIL_FREEDOM = 4.0
OUTLYING_SHARE = 0.02
MISSTATED_SIGMA, MISSTATED_TOLERANCE = 1.5, 2.0
"""Factors, either way, up to which a drawing is wrong."""
HIDING = 1.1
"""True over stated sigma up to which an ordinary fit may still look good."""
WILD = (0.01, 0.04)
"""Share of the rows that are wild."""
GROSS, HEAVY = (8.0, 30.0), (3.0, 8.0)
"""A wild row is off by so many sigmas in every column, or its own noise is so much larger."""
FAR = 4.0
"""True sigmas from which on a reading among tails counts as wild: one of 16,000 that are normal lies so far off."""


@dataclass(frozen=True)
class Decoy:
    """How a recording differs from the drawing's promises.

    noise: true over stated sigma; tolerance: true over stated tolerance; tails: "", "t" (Student's t with 4 degrees
    of freedom) or "outliers" (2 % of the rows); wild: share of rows that are off, grossly or with much larger noise.
    """

    noise: float = 1.0
    tolerance: float = 1.0
    tails: str = ""
    plan: Plan = field(default_factory=Plan)
    wild: float = 0.0


def decoy(variant: str, rng: np.random.Generator) -> Decoy:
    """What a sort of null case does; clean ones may leave loads, heat or sides unvaried."""
    if variant == schedule.CLEAN:
        loads, heat, sides = (bool(v) for v in rng.integers(0, 2, 3))
        return Decoy(plan=Plan(loads=loads, heat=heat, both_sides=sides))
    plan = Plan(sessions=int(rng.integers(1, 3)))
    if variant == schedule.TAILS:
        return Decoy(tails=("t", "outliers")[int(rng.integers(2))], plan=plan)
    if variant == schedule.SIGMA:
        return Decoy(noise=_between(rng, 0.5, 2.5), plan=plan)
    if variant == schedule.TOLERANCES:
        return Decoy(tolerance=float(rng.uniform(3.0, 4.0)), plan=plan)
    if variant == schedule.MISSTATED:
        return replace(misstated(rng), plan=plan)
    return Decoy(plan=plan)


def misstated(rng: np.random.Generator, *, hides: bool = False) -> Decoy:
    """Everything wrong at once, as on a real machine; ``hides``: sigma is stated too large rather than too small."""
    noise = _between(rng, 1 / MISSTATED_SIGMA, HIDING if hides else MISSTATED_SIGMA)
    tolerance = _between(rng, 1 / MISSTATED_TOLERANCE, MISSTATED_TOLERANCE)
    return Decoy(noise, tolerance, wild=float(rng.uniform(*WILD)))


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


def gone_wild(exact: Array, read: Array, sigma: Array, share: float, rng: np.random.Generator) -> Array:
    """(n, k) readings of which some rows are off; sigma (k,) mm and rad. A reading without noise keeps its value."""
    n, k = exact.shape
    rows = rng.permutation(n)[: max(2, round(share * n))]
    out = read.copy()
    for row in rows:
        noise = read[row] - exact[row]
        if rng.random() < 0.5:
            far = rng.uniform(*GROSS, k) * rng.choice([-1.0, 1.0], k) * sigma * (noise != 0.0)
        else:
            far = noise * rng.uniform(*HEAVY)
        out[row] = exact[row] + far
    return out


def wild_rows(exact: Array, read: Array, sigma: Array, columns: tuple[str, ...]) -> Mask:
    """(n,) rows with a reading further off than normal noise goes; sigma (k,) is the true one."""
    return np.asarray(np.max(np.abs(difference(read, exact, columns)) / sigma, axis=1) > FAR)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


__all__ = ["Decoy", "decoy", "gone_wild", "misstated", "noisy", "wild_rows"]
