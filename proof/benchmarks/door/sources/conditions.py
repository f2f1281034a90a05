"""How a pair is measured where a study asks for more than the usual: noise, drawing, frames, number and spread of poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..pairs import Array
from .campaign import Campaign, visits

FEWEST, MOST = 9, 18
"""Poses of a short campaign."""
DIGITS = 12
"""Of joints, after the point: their resolution is no error here."""
TURN = 57.3
"""deg over which a point at the machine's reach moves by the reach."""


@dataclass(frozen=True)
class Conditions:
    """sigma of a point (mm), tolerance of lengths (mm), whether base and tool are known, how many poses, the share of the
    ranges of turning joints that is used, whether the machine is read while it moves, and how many times as large as usual
    the physics is that the file does not state. Without a tolerance all is as drawn, frames too."""

    sigma: float
    tolerance: float
    known: bool = True
    poses: int = 50
    turning: float = 1.0
    moving: bool = False
    physics: float = 1.0

    def stood(self, known: tuple[float, float]) -> tuple[float, float]:
        """Return how well a frame is known (mm, deg) that is known so well in a machine of some tolerance."""
        return known if self.tolerance else (0.0, 0.0)

    def angle(self, reach: float) -> float:
        """Return the tolerance of angles (deg) that does to a tool at ``reach`` mm what the one of lengths does."""
        if not self.tolerance:
            return 0.0
        return float(np.clip(self.tolerance / reach * TURN, 1e-3, 0.2))

    def campaign(self, low: Array, high: Array, turns: Array, rng: np.random.Generator) -> Campaign:
        """Return joints within their ranges (n,), of which ``turns`` (n,) turn."""
        half = 0.425 * (high - low) * np.where(turns, self.turning, 1.0)
        if self.moving:
            return sweep((high + low) / 2, half, self.poses, rng)
        return visits((high + low) / 2 + half * rng.uniform(-1, 1, (self.poses, len(low))), 3, rng)

    def visited(self, q: Array, rng: np.random.Generator) -> Campaign:
        """Return the campaign of readings (rows, n) that are given, with repeats unless it moves."""
        if not self.moving:
            return visits(q, 3, rng)
        rows = len(q)
        sides: Array = np.where(np.gradient(q, axis=0) < 0, -1.0, 1.0)
        return Campaign(q, np.linspace(1.0, rows, rows), sides, np.zeros(rows), np.full(rows, 20.0))

    def clocked(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return the table with a second between rows, where it was read while moving."""
        return table.assign(time=np.arange(len(table)).astype(float)) if self.moving else table


def sweep(middle: Array, half: Array, rows: int, rng: np.random.Generator) -> Campaign:
    """Return joints (rows, n) along a smooth path about ``middle``, a row each second."""
    periods, starts = rng.uniform(15.0, 50.0, len(half)), rng.uniform(0, 2 * np.pi, len(half))
    angle = 2 * np.pi * np.arange(rows)[:, None] / periods + starts
    air = np.full(rows, 20.0)
    sides: Array = np.where(np.cos(angle) < 0, -1.0, 1.0)
    return Campaign(middle + half * np.sin(angle), np.linspace(1.0, rows, rows), sides, np.zeros(rows), air)


def drawn_conditions(rng: np.random.Generator, **given: object) -> Conditions:
    """Return conditions from 5 um to 0.5 mm of noise and 0.05 to 3 mm of error at the tool; ``given`` ones are kept."""
    short = rng.random() < 0.2
    drawn = {
        "sigma": float(f"{np.exp(rng.uniform(*np.log([0.005, 0.5]))):.2g}"),
        "tolerance": float(f"{np.exp(rng.uniform(*np.log([0.015, 0.8]))):.2g}"),
        "known": bool(rng.random() < 0.6),
        "poses": int(rng.integers(FEWEST, MOST)) if short else int(rng.integers(30, 70)),
        "turning": float(rng.choice([1.0, 1.0, 0.4, 0.08, 0.02])),
        "physics": float(np.exp(rng.uniform(*np.log([0.3, 6.0])))),
    }
    return Conditions(**{**drawn, **given})  # type: ignore[arg-type]


__all__ = ["Conditions", "drawn_conditions"]
