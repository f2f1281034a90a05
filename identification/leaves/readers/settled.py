"""Streams of joints and poses as rows: wherever all joints stand still, what was seen meanwhile is averaged.

A joint stands at a sample when it keeps within ``band`` over a window of ``seconds`` around it. Neighbouring samples at
which all joints stand make a stretch; a stretch of at least that length with a pose in it makes a row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index
from truepose.models import lie

BAND = 2e-4
"""rad, or m of a prismatic joint: more than an encoder's noise, far less than a move."""
SECONDS = 0.5


@dataclass(frozen=True)
class Stream:
    """Values (k, w) at times (k,), s, in order: positions of joints, points in m, or poses (position, rotation vector)."""

    time: Array
    values: Array

    @classmethod
    def of(cls, samples: Sequence[tuple[float, Sequence[float]]]) -> Stream:
        """From samples in any order; of several at one time the last one counts."""
        return cls.in_order(np.array([t for t, _ in samples]), np.array([v for _, v in samples], dtype=float))

    @classmethod
    def in_order(cls, time: Array, values: Array) -> Stream:
        """The same of times (k,) and values (k, w)."""
        last = len(time) - 1 - np.unique(time[::-1], return_index=True)[1]
        return cls(time[last], values[last])

    def between(self, start: float, end: float) -> Array:
        """(j, w) values from ``start`` to ``end``, both included."""
        return self.values[np.searchsorted(self.time, start) : np.searchsorted(self.time, end, side="right")]


@dataclass(frozen=True)
class Average:
    """mean (w,) of ``count`` values, sigma (w,): 1-sigma of the mean, from their scatter; NaN of a single one."""

    mean: Array
    sigma: Array
    count: int


def stretches(
    joints: Mapping[str, Stream], band: float = BAND, seconds: float = SECONDS
) -> list[tuple[float, float]]:
    """(start, end) of every stretch in which all joints stand still, s."""
    common: list[tuple[float, float]] | None = None
    for stream in joints.values():
        own = _still(stream, band, seconds)
        common = own if common is None else _overlaps(common, own)
    return [(start, end) for start, end in common or [] if end - start >= seconds]


def _still(stream: Stream, band: float, seconds: float) -> list[tuple[float, float]]:
    """Stretches of one joint, however short."""
    time, values = stream.time, stream.values[:, 0]
    first = np.searchsorted(time, time - seconds / 2)
    last = np.searchsorted(time, time + seconds / 2, side="right")
    still = _spreads(values, first, last) <= band
    # samples far apart say nothing of what is between them
    joined = still[1:] & still[:-1] & (np.abs(np.diff(values)) <= band) & (np.diff(time) <= seconds)
    ends = np.flatnonzero(~np.append(joined, False))
    starts = np.append(0, ends[:-1] + 1)
    return [(float(time[a]), float(time[b])) for a, b in zip(starts, ends, strict=True) if still[a]]


def _spreads(values: Array, first: Index, last: Index) -> Array:
    """(k,) largest minus smallest of ``values[first:last]``, none of which is empty.

    Two windows of a power of two cover one of any length, so that windows of thousands of samples cost no more than short ones.
    """
    level, out = np.frexp(last - first)[1] - 1, np.empty(len(first))
    high = low = values
    for k in range(int(level.max()) + 1):
        at, size = np.flatnonzero(level == k), 1 << k
        a, b = first[at], last[at] - size
        out[at] = np.maximum(high[a], high[b]) - np.minimum(low[a], low[b])
        high, low = np.maximum(high[:-size], high[size:]), np.minimum(low[:-size], low[size:])
    return out


def _overlaps(
    one: Sequence[tuple[float, float]], other: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """What two lists of stretches, each in order, have in common."""
    out, i, j = [], 0, 0
    while i < len(one) and j < len(other):
        start, end = max(one[i][0], other[j][0]), min(one[i][1], other[j][1])
        if end > start:
            out.append((start, end))
        if one[i][1] <= other[j][1]:
            i += 1
        else:
            j += 1
    return out


def average(values: Array) -> Average:
    """Of (j, 3) points or (j, 6) poses; the mean rotation is the nearest one in the mean of the matrices."""
    count = len(values)
    mean, off = values.mean(axis=0), values - values.mean(axis=0)
    if values.shape[1] == 6:
        turns = lie.exp_so3(values[:, 3:])
        u, _, vt = np.linalg.svd(turns.mean(axis=0))
        middle = u @ np.diag([1.0, 1.0, float(np.linalg.det(u @ vt))]) @ vt
        mean[3:] = lie.log_so3(middle[None])[0]
        off[:, 3:] = lie.log_so3(middle.T @ turns)
    if count < 2:
        return Average(mean, np.full(values.shape[1], np.nan), count)
    return Average(mean, np.sqrt(np.sum(off**2, axis=0) / (count - 1) / count), count)
