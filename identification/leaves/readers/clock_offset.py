"""How far the clock of a probe is from that of a robot's log, from the motion that both saw; no model of the machine is needed.

When the robot moves, the probe moves. Speeds alone put the clocks within a sample or two: the lag at which they correlate best.
Then where the probe is must be one function of the joints, x(t) = f(q(t + offset)): for the turning joints of an arm a
sum of products of their sines and cosines, here of one or two at a time. f is fitted to all blocks of time but one, and what it
misses in that one along dx/dt is the block's own error of the offset. Their mean is the offset, their trend the rate of
one clock by the other, and their scatter says how sure both are. What is left, a millisecond, the effect `latency` finds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError

Joints = Callable[[Array], Array]
"""Joints (k, nj) at times (k,) of the log: rad of those that turn, any unit of those that slide."""
_GRID = 1 << 16
"""Most samples that speeds are compared at."""
_LEAST = 0.4
"""Least correlation of the two speeds."""
_TIE = 0.05
"""How near another lag may come to the first in correlation before both are tried."""
_MARGIN = 0.02
"""How much more the first must correlate where nothing else decides."""
_ROWS = 1500
MOVING = 0.2
"""Share of the usual top speed from which a sample says anything of the clocks."""
_BLOCKS = 10
_RIDGES = (1e-8, 1e-5, 1e-3)
_STEPS = 6
_WITHIN = 10.0
"""How many steps from the lag of the speeds an offset may be found."""
_AMBIGUOUS = 1.5
_SURE = 4.0


@dataclass(frozen=True)
class Clock:
    """time of the log = time of the probe + offset + rate * (time of the probe - middle), s; sigma: 1-sigma of the offset."""

    offset: float
    sigma: float | None = None
    rate: float = 0.0
    middle: float = 0.0

    def of_log(self, time: Array) -> Array:
        """Times (n,) of the probe by the log's clock."""
        return np.asarray(time + self.offset + self.rate * (time - self.middle))


@dataclass(frozen=True)
class Motion:
    """What both saw: the probe at ``place`` (n, 3) at its ``time`` (n,), and the joints over ``span`` of the log's clock.

    slides (nj,): joints that slide. step: seconds between samples of the log.
    """

    time: Array
    place: Array
    joints: Joints
    span: tuple[float, float]
    slides: Mask
    step: float


def clock_of(motion: Motion, where: str) -> Clock:
    """The clock of the probe by that of the log. Raises InputError, opened by ``where``, where the motion does not tell it."""
    first, step = _lags(motion, where)
    every = [(lag, alike, _moving(motion, lag, step)) for lag, alike in first]
    lags = [one for one in every if len(one[2]) >= _least(motion)]
    if not lags:
        raise InputError(
            f"{where}: found {max(len(rows) for _, _, rows in every)} samples at which the probe moves while the joints are "
            f"logged, expected at least {_least(motion)}, or --offset"
        )
    tried = [(*_settled(motion, lag, step, rows), alike) for lag, alike, rows in lags]
    best = min(tried, key=lambda found: found[1])
    others = [found for found in tried if found is not best]
    if all(found[1] > _AMBIGUOUS * best[1] for found in others):
        return best[0]
    if lags[0][1] > lags[1][1] + _MARGIN:
        return tried[0][0]
    one, other = (f"{found[0].offset:.6g} s" for found in (best, others[0]))
    raise InputError(
        f"{where}: the motion repeats itself, and an offset of {one} fits as well as {other}: expected --offset, or a motion "
        "that does not"
    )


def _lags(motion: Motion, where: str) -> tuple[list[tuple[float, float]], float]:
    """Offsets at which the speeds correlate best, each with the correlation, to about the step, s, that comes with them."""
    few = InputError(
        f"{where}: found less than 20 samples at which clocks could be compared, expected --offset"
    )
    if len(motion.time) < 20:
        raise few
    own = float(np.median(np.diff(motion.time)))
    whole = max(np.ptp(motion.time), np.ptp(motion.span))
    step = max(own, motion.step, float(whole) / _GRID)
    seen = np.arange(motion.time[0], motion.time[-1], step)
    place = np.column_stack([np.interp(seen, motion.time, v) for v in motion.place.T])
    logged = np.arange(motion.span[0], motion.span[1], step)
    if min(len(seen), len(logged)) < 20:
        raise few
    joints = motion.joints(logged)
    alike = _correlation(_speed(_levelled(joints)), _speed(place))
    shift = np.arange(-(len(seen) - 2), len(logged) - 1)
    order = _peaks(alike)
    if alike[order[0]] < _LEAST:
        raise InputError(
            f"{where}: found no time shift at which the probe moves when the joints do (correlation of the speeds "
            f"{alike[order[0]]:.2f}), expected both to be of one run, or --offset"
        )
    near = [k for k in order[:5] if alike[k] > alike[order[0]] - _TIE]
    return [(float(logged[0] + shift[k] * step - seen[0]), float(alike[k])) for k in near], step


def _levelled(joints: Array) -> Array:
    """Columns (n, nq) with a standard deviation of 1, constant ones left as they are.

    They are brought to a span of 1 first: squares of the smallest numbers are 0.
    """
    span = np.ptp(joints, axis=0)
    moved = (joints - joints[0]) / np.where(span > 0.0, span, 1.0)
    return np.asarray(moved / np.where(span > 0.0, moved.std(axis=0), 1.0))


def _speed(values: Array) -> Array:
    """(n - 1,) size of the change from sample to sample, of about unit variance."""
    size = np.linalg.norm(np.diff(values, axis=0), axis=1)
    return np.asarray(size / (size.std() or 1.0))


def _correlation(a: Array, b: Array) -> Array:
    """Pearson's r of a[k + j] and b[k] over what they share, by every j; -1 where that is less than half of the shorter one."""
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


def _peaks(values: Array) -> list[int]:
    """Places of local maxima, the largest first."""
    inner = np.r_[True, values[1:] > values[:-1]] & np.r_[values[:-1] >= values[1:], True]
    at = np.flatnonzero(inner)
    return [int(k) for k in at[np.argsort(-values[at])]]


def _least(motion: Motion) -> int:
    """Samples that tell a clock: two for each number that is fitted, and for each block."""
    features: int = _features(motion, motion.time[:1], motion.time[:1], pairs=False).shape[1]
    return 2 * max(features, _BLOCKS)


def _settled(motion: Motion, lag: float, step: float, rows: Index) -> tuple[Clock, float]:
    """The clock from a start ``lag`` by samples ``rows``, and the rms (mm or whatever the place is in) that is left of those
    not fitted."""
    time, place = motion.time[rows], motion.place[rows]
    scan = lag + step * np.arange(-4.0, 4.1)
    left = [_held_out(motion, time + shift, place).rms for shift in scan]
    clock = Clock(float(scan[int(np.argmin(left))]), middle=float(np.mean(time)))
    for k in range(_STEPS):
        held = _held_out(motion, clock.of_log(time), place)
        weight = np.sum(held.speed**2, axis=1)
        late = np.sum(held.residual * held.speed, axis=1) / np.maximum(weight, 1e-300)
        clock = trend(clock, time, weight, late, with_rate=k > 1)
    if abs(clock.offset - lag) > _WITHIN * step:
        return Clock(lag, step), float(left[4])
    return clock, _held_out(motion, clock.of_log(time), place).rms


def _moving(motion: Motion, lag: float, step: float) -> Index:
    """Samples at which the probe moves and the log has joints, at most ``_ROWS`` of them."""
    with np.errstate(all="ignore"):  # samples at next to the same time tell no speed
        speed = np.linalg.norm(np.gradient(motion.place, motion.time, axis=0), axis=1)
    speed = np.where(np.isfinite(speed), speed, 0.0)
    at, slack = motion.time + lag, 8.0 * step
    inside = (at > motion.span[0] + slack) & (at < motion.span[1] - slack)
    top = np.quantile(speed[inside], 0.9) if inside.any() else 0.0
    rows = np.flatnonzero(inside & (speed >= MOVING * top))
    return np.asarray(rows[np.linspace(0, len(rows) - 1, min(len(rows), _ROWS)).astype(int)])


@dataclass(frozen=True)
class _HeldOut:
    """What a function of the joints misses (n, 3) in blocks of rows that it was not fitted to, its speed (n, 3), the rms."""

    residual: Array
    speed: Array
    rms: float


def trend(clock: Clock, time: Array, weight: Array, late: Array, *, with_rate: bool = True) -> Clock:
    """A better clock where rows at ``time`` (n,) of the probe, in order, say that it is ``late`` (n,), with ``weight`` (n,).

    Blocks of rows make up for what neighbours have in common. The rate changes where their trend is beyond doubt.
    """
    blocks = np.array_split(np.arange(len(time)), _BLOCKS)
    heavy = np.array([np.sum(weight[b]) for b in blocks])
    own = np.array([np.sum(weight[b] * late[b]) for b in blocks]) / np.maximum(heavy, 1e-300)
    when = np.array([np.mean(time[b]) for b in blocks]) - clock.middle
    centre, step = (float(np.average(v, weights=heavy)) for v in (when, own))
    spread = np.average((own - step) ** 2, weights=heavy)
    plain = Clock(clock.offset + step, float(np.sqrt(spread / (_BLOCKS - 1))), 0.0, clock.middle)
    if not with_rate:
        return plain
    size = np.average((when - centre) ** 2, weights=heavy)
    slope = float(np.average((when - centre) * (own - step), weights=heavy) / size)
    left = np.average((own - step - slope * (when - centre)) ** 2, weights=heavy)
    if abs(slope + clock.rate) <= _SURE * np.sqrt(left / size / (_BLOCKS - 2)):
        return plain
    offset = clock.offset + step - slope * centre
    return Clock(offset, float(np.sqrt(left / (_BLOCKS - 2))), clock.rate + slope, clock.middle)


def _held_out(motion: Motion, at: Array, place: Array) -> _HeldOut:
    """Of places (k, 3) at times (k,) of the log, by the function that does best."""
    small = 0.25 * motion.step
    tried = []
    for pairs in (False, True):
        here, before, after = (
            _features(motion, time, at, pairs=pairs) for time in (at, at - small, at + small)
        )
        if len(at) < 2 * here.shape[1]:
            continue
        blocks = np.array_split(np.arange(len(at)), _BLOCKS)
        grams = [(here[b].T @ here[b], here[b].T @ place[b]) for b in blocks]
        gram, right = (np.sum([part[k] for part in grams], axis=0) for k in (0, 1))
        scale = np.eye(len(gram)) * np.trace(gram) / len(gram)
        for ridge in _RIDGES:
            residual, speed = np.empty_like(place), np.empty_like(place)
            for rows, (own, beside) in zip(blocks, grams, strict=True):
                coefficients = np.linalg.solve(gram - own + ridge * scale, right - beside)
                residual[rows] = place[rows] - here[rows] @ coefficients
                speed[rows] = (after[rows] - before[rows]) @ coefficients / (2.0 * small)
            tried.append(_HeldOut(residual, speed, float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))))
    return min(tried, key=lambda held: held.rms)


def _features(motion: Motion, time: Array, among: Array, *, pairs: bool) -> Array:
    """(k, m) of joints at ``time`` (k,): 1, sine and cosine of each (its value and square where it slides, in terms of those at
    ``among``), and their products of two joints."""
    joints, usual, own = motion.joints(time), motion.joints(among), []
    for k, slide in enumerate(motion.slides.tolist()):
        if slide:
            plain = (joints[:, k] - usual[:, k].mean()) / (usual[:, k].std() or 1.0)
            own.append((plain, plain**2))
        else:
            own.append((np.sin(joints[:, k]), np.cos(joints[:, k])))
    out = [np.ones(len(joints)), *itertools.chain.from_iterable(own)]
    if pairs:
        out += [a * b for one, other in itertools.combinations(own, 2) for a in one for b in other]
    return np.column_stack(out)


__all__ = ["MOVING", "Clock", "Motion", "clock_of", "trend"]
