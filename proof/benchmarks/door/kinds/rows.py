"""Rows that belong to others, come twice, are too few, or come from two set-ups; a joint that never moves."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..pairs import TURNS, XYZ, Pair
from ..rotations import columns, frame, poses
from .spoilt import Spoilt

SHARE = (0.15, 0.6)
"""Of the rows that come twice."""


def rows_shifted(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Readings one to three rows later or earlier than their joints, or one block sorted by itself."""
    if pair.sensor == "distance":
        return None  # a change between rows is shifted with what it counts from
    document, table = pair.draft()
    names = list(pair.readings)
    where = (*names, *pair.joints, "rows", "readings", "recording", "joints")
    if rng.random() < 0.2:
        order = np.argsort(table[names[0]].to_numpy(), kind="stable")
        table[names] = table[names].to_numpy()[order]
        return Spoilt("readings sorted", document, table, where, mends=False)
    by = int(rng.choice([-3, -2, -1, 1, 2, 3]))
    table[names] = np.roll(table[names].to_numpy(), by, axis=0)
    table = table.iloc[by:] if by > 0 else table.iloc[:by]
    return Spoilt("shifted", document, table.reset_index(drop=True), where)


def duplicated_rows(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Some rows were pasted twice, noise and all."""
    if pair.sensor == "distance":
        return None  # ``from`` would mean the copy
    document, table = pair.draft()
    n = len(table)
    count = max(5, int(rng.uniform(*SHARE) * n))
    if rng.random() < 0.5:
        first = int(rng.integers(0, n - count + 1))
        table = pd.concat([table, table.iloc[first : first + count]])
    else:
        again = np.sort(rng.permutation(n)[:count])
        table = table.iloc[np.sort(np.concatenate([np.arange(n), again]))]
    table = table.reset_index(drop=True)
    if "time" in table and rng.random() < 0.5:
        del table["time"]
    return Spoilt("pasted twice", document, table, ("rows", "recording", "row"), judged="certain")


def joint_never_moves(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """A joint whose column was not logged while it moved."""
    document, table = pair.draft()
    name = str(rng.choice(list(pair.joints)))
    near = min(table[name], key=abs)
    table[name] = 0.0 if table[name].min() < 0 < table[name].max() else near
    return Spoilt("not logged", document, table, (name,), mends=False)


def sessions_mixed(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """The instrument was set up anew half way, and nothing in the file says so."""
    if not pair.points:
        return None
    document, table = pair.draft()
    first = int(rng.uniform(0.35, 0.65) * len(table))
    far = rng.uniform(80, 900, 3) * rng.choice([-1, 1], 3)
    anew = frame(far, np.radians(rng.uniform(-40, 40, 3)))
    for point in pair.points:
        at = table.loc[first:, list(point)].to_numpy()
        table.loc[first:, list(point)] = at @ anew[:3, :3].T + anew[:3, 3]
    if pair.sensor == "pose":
        names = [*XYZ, *TURNS]
        turned = poses(pair.table.loc[first:, names].to_numpy())
        table.loc[first:, names] = columns(anew @ turned)
    table = table.drop(columns=[c for c in ("session",) if c in table])
    where = ("rows", "session", "base", "recording", "sessions", *pair.readings)
    return Spoilt("session lost", document, table, where, mends=False)
