"""How far the clock of a probe is from that of a robot's log, from the motion that both saw; no model of the machine is needed.

When the robot moves, the probe moves: the clocks are apart by the lag at which both speeds correlate best, to about a sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate, find_peaks

from truepose.arrays import Array
from truepose.errors import InputError

Joints = Callable[[Array], Array]
"""Joints (k, nj) at times (k,) of the log, in any units."""
_GRID = 1 << 16
"""Most samples that speeds are compared at."""
_FEWEST = 20
"""Samples that clocks can be compared at."""
_LEAST = 0.4
"""Least correlation of the two speeds."""
_MOVING, _TOP = 0.2, 0.99
"""Share of the top speed from which the probe moves, and the quantile that is it."""
_MARGIN = 0.02
"""How much more the best lag must correlate than any other."""


@dataclass(frozen=True)
class Clock:
    """time of the log = time of the probe + offset + rate * (time of the probe - middle), s; sigma: 1-sigma of the offset."""

    offset: float
    sigma: float | None = None
    rate: float = 0.0
    middle: float = 0.0

    def of_log(self, time: Array) -> Array:
        """Return times (n,) of the probe by the log's clock."""
        return np.asarray(time + self.offset + self.rate * (time - self.middle))


@dataclass(frozen=True)
class Motion:
    """What both saw: the probe at ``place`` (n, 3) at its ``time`` (n,), and the joints over ``span`` of the log's clock.

    step: seconds between samples of the log.
    """

    time: Array
    place: Array
    joints: Joints
    span: tuple[float, float]
    step: float


def clock_of(motion: Motion, where: str) -> Clock:
    """Return the clock of the probe by that of the log.

    Raises InputError, opened by ``where``, if the motion does not tell it.
    """
    whole = max(np.ptp(motion.time), np.ptp(motion.span))
    own = float(np.median(np.diff(motion.time))) if len(motion.time) > 1 else 0.0
    step = max(own, motion.step, float(whole) / _GRID)
    seen = np.arange(motion.time[0], motion.time[-1], step)
    logged = np.arange(motion.span[0], motion.span[1], step)
    place = np.column_stack([np.interp(seen, motion.time, v) for v in motion.place.T])
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1)
    moving = np.sum(speed >= _MOVING * np.quantile(speed, _TOP)) if len(speed) else 0
    if min(len(motion.time), len(seen), len(logged), moving) < _FEWEST:
        raise InputError(
            f"{where}: found less than {_FEWEST} samples, or samples at which the probe moves, that clocks could be compared "
            "at, expected --offset"
        )
    joints = _levelled(motion.joints(logged))
    alike = _correlation(np.linalg.norm(np.diff(joints, axis=0), axis=1), speed)
    peaks = find_peaks(np.r_[-1.0, alike, -1.0])[0] - 1
    best, *others = peaks[np.argsort(-alike[peaks])].tolist()
    if alike[best] < _LEAST:
        raise InputError(
            f"{where}: found no time shift at which the probe moves when the joints do (correlation of the speeds "
            f"{alike[best]:.2f}), expected both to be of one run, or --offset"
        )
    first = logged[0] - seen[0] - (len(seen) - 2) * step
    if others and alike[others[0]] > alike[best] - _MARGIN:
        one, other = (f"{first + k * step:.6g} s" for k in (best, others[0]))
        raise InputError(
            f"{where}: the motion repeats itself, and an offset of {one} fits as well as {other}: expected --offset, or a "
            "motion that does not"
        )
    before, top, after = alike[np.clip([best - 1, best, best + 1], 0, len(alike) - 1)]
    bend = before - 2.0 * top + after
    between = 0.5 * (before - after) / bend if bend < 0.0 else 0.0  # top of the parabola through three
    return Clock(float(first + (best + between) * step), step)


def _levelled(joints: Array) -> Array:
    """Return columns (n, nq) with a standard deviation of 1, constant ones as they are.

    They are brought to a span of 1 first: squares of the smallest numbers are 0.
    """
    span = np.ptp(joints, axis=0)
    moved = (joints - joints[0]) / np.where(span > 0.0, span, 1.0)
    return np.asarray(moved / np.where(span > 0.0, moved.std(axis=0), 1.0))


def _correlation(a: Array, b: Array) -> Array:
    """Return Pearson's r of a[k + j] and b[k] over what they share, by every j; -1 for less than half of the shorter one."""
    a, b = (v / (v.std() or 1.0) for v in (a, b))
    one, other = np.ones(len(a)), np.ones(len(b))

    def over(x: Array, y: Array) -> Array:
        return np.asarray(correlate(x, y, mode="full", method="fft"))

    n = np.maximum(np.round(over(one, other)), 1.0)
    mean_a, mean_b = over(a, other) / n, over(one, b) / n
    spread_a, spread_b = over(a * a, other) / n - mean_a**2, over(one, b * b) / n - mean_b**2
    both = over(a, b) / n - mean_a * mean_b
    size = np.sqrt(np.maximum(spread_a, 0.0) * np.maximum(spread_b, 0.0))
    usable = (n >= 0.5 * min(len(a), len(b))) & (size > 1e-6)
    return np.where(usable, both / np.where(usable, size, 1.0), -1.0)
