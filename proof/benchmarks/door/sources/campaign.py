"""How the small simulators of this benchmark are moved and read: poses, repeats, sides, loads, temperatures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..pairs import Array


@dataclass(frozen=True)
class Campaign:
    """(n, nq) joints in mm and rad, (n,) pose numbers, (n, nq) sides, (n,) kg and degC."""

    q: Array
    pose: Array
    approach: Array
    payload: Array
    temperature: Array

    def __len__(self) -> int:
        return len(self.q)


def campaign(low: Array, high: Array, rng: np.random.Generator, still: int | None = None) -> Campaign:
    """30 to 70 poses within 85 % of the ranges, some of them repeated; ``still``: a joint that never moves."""
    poses, again = int(rng.integers(30, 70)), int(rng.integers(5, 15))
    half = 0.425 * (high - low)
    q = (high + low) / 2 + half * rng.uniform(-1, 1, (poses, len(low)))
    if still is not None:
        q[:, still] = q[0, still]
    return visits(q, again, rng)


def visits(q: Array, again: int, rng: np.random.Generator) -> Campaign:
    """Every pose once, then ``again`` of them three times more, without a change of load."""
    order = np.concatenate([np.arange(len(q)), np.repeat(rng.permutation(len(q))[:again], 3)])
    n = len(order)
    load = rng.choice([0.0, 2.0, 5.0], len(q))[order]
    air = 20.0 + np.cumsum(rng.normal(0, 0.15, n))
    sides = np.where(rng.random((len(q), q.shape[1])) < 0.5, -1.0, 1.0)[order]
    return Campaign(q[order], order + 1.0, sides, load, air.round(2))


def logged(
    c: Campaign, names: list[str], revolute: Array, rng: np.random.Generator, digits: int = 6
) -> pd.DataFrame:
    """Joints in mm and deg to so many digits, and what else a laboratory writes down; not every one writes all of it."""
    table = pd.DataFrame({"pose": c.pose.astype(int)})
    if rng.random() < 0.6:
        table["time"] = np.round(60.0 + 40.0 * np.arange(len(c)), 1)
    for k, name in enumerate(names):
        table[name] = np.round(np.degrees(c.q[:, k]) if revolute[k] else c.q[:, k], digits)
    for k, name in enumerate(names):
        table[f"approach.{name}"] = c.approach[:, k].astype(int)
    table["payload"] = c.payload
    if rng.random() < 0.6:
        table["temperature.air"] = c.temperature
    return table
