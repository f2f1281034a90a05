"""Streams of joints and poses as rows: wherever all joints stand still, what was seen meanwhile is averaged.

A joint stands at a sample when it keeps within ``band`` over a window of ``seconds`` around it. Neighbouring samples at
which all joints stand make a stretch; a stretch of at least that length with a pose in it makes a row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from truepose.arrays import Array
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
    def in_order(cls, time: Array, values: Array) -> Stream:
        """Return samples at times (k,) in any order; of several at one time the last one counts."""
        last = len(time) - 1 - np.unique(time[::-1], return_index=True)[1]
        return cls(time[last], values[last])

    def between(self, start: float, end: float) -> Array:
        """(j, w) values from ``start`` to ``end``, both included."""
        return self.values[np.searchsorted(self.time, start) : np.searchsorted(self.time, end, side="right")]


def stretches(
    joints: Mapping[str, Stream], band: float = BAND, seconds: float = SECONDS
) -> list[tuple[float, float]]:
    """Return (start, end) of every stretch in which all joints stand still, s."""
    each = [stretch for stream in joints.values() for stretch in _still(stream, band, seconds)]
    edges = sorted([(start, 1) for start, _ in each] + [(end, -1) for _, end in each])
    out, standing, begun = [], 0, 0.0
    for time, change in edges:
        if standing == len(joints) and time - begun >= seconds:
            out.append((begun, time))
        standing, begun = standing + change, time
    return out


def _still(stream: Stream, band: float, seconds: float) -> list[tuple[float, float]]:
    """Return the stretches of one joint, however short."""
    time, values = stream.time, stream.values[:, 0]
    clock = pd.to_timedelta(time - time[0], unit="s")
    window = pd.Series(values, index=clock).rolling(pd.Timedelta(seconds=seconds), center=True, closed="both")
    still = (window.max() - window.min()).to_numpy() <= band
    # samples far apart say nothing of what is between them
    joined = still[1:] & still[:-1] & (np.abs(np.diff(values)) <= band) & (np.diff(time) <= seconds)
    ends = np.flatnonzero(~np.append(joined, False))
    starts = np.append(0, ends[:-1] + 1)
    return [(float(time[a]), float(time[b])) for a, b in zip(starts, ends, strict=True) if a < b]


def average(values: Array) -> tuple[Array, Array]:
    """Return the mean of (j, 3) points or (j, 6) poses, and its 1-sigma from their scatter, NaN of a single one.

    The mean rotation is the nearest one in the mean of the matrices.
    """
    count = len(values)
    if not count:
        return np.full(values.shape[1], np.nan), np.full(values.shape[1], np.nan)
    mean, off = values.mean(axis=0), values - values.mean(axis=0)
    if values.shape[1] == 6:
        turns = lie.exp_so3(values[:, 3:])
        u, _, vt = np.linalg.svd(turns.mean(axis=0))
        middle = u @ np.diag([1.0, 1.0, float(np.linalg.det(u @ vt))]) @ vt
        mean[3:] = lie.log_so3(middle[None])[0]
        off[:, 3:] = lie.log_so3(middle.T @ turns)
    if count < 2:
        return mean, np.full(values.shape[1], np.nan)
    return mean, np.sqrt(np.sum(off**2, axis=0) / (count - 1) / count)
