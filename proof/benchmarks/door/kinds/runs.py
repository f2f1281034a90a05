"""Rows of one recording that differ from the others: another unit, another tool, a base that moved."""

from __future__ import annotations

import numpy as np

from ..pairs import TURNS, XYZ, Pair
from ..rotations import columns, frame, poses
from .conventions import INCH, METRE
from .spoilt import Spoilt


def rows_unit(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Some rows of one reading, or of all its lengths, in inch or m."""
    if not pair.lengths or pair.sensor == "distance":
        return None
    document, table = pair.draft()
    count = int(rng.integers(2, 7))
    first = int(rng.integers(len(table) - count))
    rows = rng.permutation(len(table))[:count] if rng.random() < 0.5 else np.arange(first, first + count)
    names = list(pair.lengths) if rng.random() < 0.4 else [str(rng.choice(list(pair.lengths)))]
    table.loc[rows, names] *= float(rng.choice([INCH, METRE]))
    told = tuple(str(int(r) + 1) for r in rows)
    return Spoilt(f"rows {', '.join(told)}", document, table, (*names, *told, "rows"), mends=False)


def tool_changed(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Another tool from a row on: some millimetres longer."""
    if pair.tool is None or not pair.points:
        return None
    document, table = pair.draft()
    first = int(rng.uniform(0.3, 0.7) * len(table))
    longer = rng.uniform(3, 30) * rng.choice([-1, 1]) * np.eye(3)[int(rng.integers(3))]
    shift = pair.tool[first:, :3, :3] @ longer
    for point in pair.points:
        table.loc[first:, list(point)] = table.loc[first:, list(point)].to_numpy() + shift
    where = ("tool", "rows", f"{first + 1}", "session", "base")
    return Spoilt(f"from row {first + 1}", document, table, where, mends=False)


def base_moved(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """The machine, or the tracker, was pushed by some millimetres from a row on."""
    if pair.tool is None or not pair.points:
        return None
    document, table = pair.draft()
    first = int(rng.uniform(0.3, 0.7) * len(table))
    pushed = frame(rng.uniform(3, 30, 3) * rng.choice([-1, 1], 3), np.radians(rng.uniform(-0.5, 0.5, 3)))
    for point in pair.points:
        at = table.loc[first:, list(point)].to_numpy()
        table.loc[first:, list(point)] = at @ pushed[:3, :3].T + pushed[:3, 3]
    if pair.sensor == "pose":
        names = [*XYZ, *TURNS]
        turned = poses(pair.table.loc[first:, names].to_numpy())
        table.loc[first:, list(TURNS)] = columns(pushed @ turned)[:, 3:]
    where = ("base", "rows", f"{first + 1}", "session", "sessions")
    return Spoilt(f"from row {first + 1}", document, table, where, mends=False)
