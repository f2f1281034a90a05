"""Readings of joints as encoders, pendants and slow loggers give them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from ..pairs import Pair
from .conventions import turning
from .spoilt import Spoilt

COUNTS = (4096, 8192, 65536, 1 << 19)
"""Counts of an encoder in a turn."""


def counts(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """One turning joint, or all of them, in counts."""
    names = turning(pair)
    if not names:
        return None
    chosen = names if rng.random() < 0.3 else [str(rng.choice(names))]
    document, table = pair.draft()
    per_turn = int(rng.choice(COUNTS))
    for name in chosen:
        table[name] = np.round(table[name] * per_turn / 360.0)
    return Spoilt(
        f"{per_turn} counts", document, table, tuple(chosen), mends=False
    )  # what lies between counts is lost


def wrapped(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Turning joints from 0 to 360 deg: the same poses."""
    names = turning(pair)
    if not names or not (pair.table[names] < 0).any(axis=None):
        return None
    document, table = pair.draft()
    table[names] = table[names] % 360.0
    return Spoilt("0 to 360", document, table, tuple(names))


def coupled(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """A joint that is counted from the one before, or from the horizon."""
    names = list(pair.joints)
    both = [(a, b) for a, b in pairwise(names) if {a, b} <= set(turning(pair))]
    if not both or pair.form in ("6-ups", "6-pus"):
        return None
    first, second = both[int(rng.integers(len(both)))]
    document, table = pair.draft()
    k = float(rng.choice([-1.0, 1.0, 0.5]))
    table[second] = table[second] + k * table[first]
    return Spoilt(f"{second} + {k:g} {first}", document, table, (second, first))


def clock(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Joints logged a fraction of a second before or after the tracker, while the machine moves."""
    if "time" not in pair.table or not np.allclose(np.diff(pair.table["time"]), 1.0):
        return None
    document, table = pair.draft()
    time, slip = table["time"].to_numpy(), float(rng.choice([-1, 1]) * rng.uniform(0.2, 2.0))
    names = list(pair.joints)
    table[names] = CubicSpline(time, table[names].to_numpy())(time + slip)
    inside = (time + slip >= time[0]) & (time + slip <= time[-1])
    table = table[inside].reset_index(drop=True)
    where = ("time", "rows", *names, *pair.readings)
    return Spoilt(f"{slip:.2f} s", document, table, where, mends=False)  # what lies between rows is lost


def whole_degrees(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """A joint whose readings were cut to whole degrees."""
    names = turning(pair)
    if not names:
        return None
    document, table = pair.draft()
    name = str(rng.choice(names))
    table[name] = np.round(table[name])
    return Spoilt("whole degrees", document, table, (name,), mends=False)


def stands_still(pair: Pair, rng: np.random.Generator) -> Spoilt:
    """A joint whose reading stays the same from a row on, while it moves."""
    document, table = pair.draft()
    name = str(rng.choice(list(pair.joints)))
    first = int(rng.uniform(0.3, 0.7) * len(table))
    table.loc[first:, name] = table[name].iloc[first]
    return Spoilt(f"from row {first + 1}", document, table, (name,), mends=False)
