"""What the order of rows tells: lagged temperatures, a joint's way, creep, the row of `from`.

Plain functions of arrays; rows are ordered by time where it is known, else by their place in the files.

States that follow from the one before, row by row, without a loop over rows.

A row's step is a function of the state, and the steps of many rows in a row are one function of the same form. So rows are cut
into segments that are as many as each has rows: the function of every segment gives the state at its beginning, and from
there all segments are walked side by side, in the arithmetic of a plain loop.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from truepose.arrays import Array, Mask

IntArray = npt.NDArray[np.int64]
MANY = 4000
"""Rows up to which creep is summed move by move: beyond it, exponentials take less time."""
EXPONENTS = 0.4
"""Step between the logarithms of the rates of these exponentials."""


def order_in_time(time: Array | None, file: IntArray, row: IntArray) -> IntArray:
    """(n,) indices that put rows in order of acquisition, by time, file and row (n,)."""
    keys = (row, file) if time is None else (row, file, time)
    return np.lexsort(keys).astype(np.int64)


def exponential_lag(time: Array, values: Array, seconds: float) -> Array:
    """(n,) first-order response y' = (x - y)/seconds to values x (n,) at ordered times (n,), s; y = x at the first.

    Exact for an input that runs straight from one sample to the next.
    """
    if seconds <= 0.0:
        return values.copy()
    step, before, now = np.diff(time), values[:-1], values[1:]
    moved = step > 0.0
    rise = np.where(moved, -np.expm1(-step / seconds), 0.0)
    share = np.where(moved, 1.0 - rise * seconds / np.where(moved, step, 1.0), 0.0)
    following = affine(1.0 - rise, rise * before + (now - before) * share, float(values[0]))
    return np.concatenate([values[:1], following])


def stop_operator(
    readings: Array,
    approach: Array,
    piece: IntArray,
    half_width: float,
    overshoot: float = float("inf"),
) -> Array:
    """(n,) how far ordered readings (n,) lead the play operator of a half width, from minus to plus that width.

    The stop operator of Prandtl: it follows every move until it slips. It starts at 0 in every ``piece`` (n,). Where
    ``approach`` (n,) (-1, 0, 1; 0 unknown) contradicts the last move, the joint overshot and came back: by more
    than the width, so that it stands at its limit on that side, or by ``overshoot``. A finite overshoot means that
    every approach starts that far behind its goal, also one that comes from the right side.
    """
    back = min(overshoot, 4.0 * half_width)
    step = np.diff(readings, prepend=readings[:1])
    fresh = np.diff(piece, prepend=piece[:1] - 1) != 0
    rested = (step == 0.0) & (approach == np.roll(approach, 1))
    contradicts = np.isfinite(overshoot) | (approach * step <= 0.0)
    returning = np.where((approach != 0.0) & ~rested & contradicts, approach * back, 0.0)
    away = np.where(returning != 0.0, step - returning, 0.0)
    begins = np.where(fresh, approach * min(back, half_width), np.nan)
    return clipped((away, np.where(returning != 0.0, returning, step)), begins, half_width)


def side_of_arrival(readings: Array, piece: IntArray, band: float) -> Array:
    """(n,) direction of the last motion that led to ordered readings (n,): 1, -1, or 0 while a ``piece`` (n,) has none.

    A joint has turned round when it stands further than ``band`` behind where it was furthest; a shorter way back is
    trembling, and many short steps one way are a motion.
    """
    out = np.zeros(len(readings))
    side, top, bottom = 0.0, 0.0, 0.0
    for k, reading in enumerate(readings.tolist()):
        if k == 0 or piece[k] != piece[k - 1]:
            side, top, bottom = 0.0, reading, reading
        elif side <= 0.0 and reading > bottom + band:
            side, top = 1.0, reading
        elif side >= 0.0 and reading < top - band:
            side, bottom = -1.0, reading
        top, bottom = max(top, reading), min(bottom, reading)
        out[k] = side
    return out


def last_steps(readings: Array, piece: IntArray, bands: Array) -> Array:
    """(n, m) last motion of each joint that led to ordered readings (n, m): 0 at the first row of a ``piece`` (n,).

    Rows at which no joint moved by more than its band (m,) were read while the machine stood: nothing moved.
    """
    steps = np.diff(readings, axis=0, prepend=readings[:1])
    stood = np.all(np.abs(steps) <= bands, axis=1)
    steps[stood | (np.diff(piece, prepend=piece[:1] - 1) != 0)] = 0.0
    return steps


def line_of_full_loop(readings: Array, half_width: float, low: float, high: float) -> Array:
    """(n,) the straight line that fits the stop operator best over a full loop from low to high, at readings (n,).

    Its slope is 3 t^2 - 2 t^3, t = half width / half range (least squares over both branches).
    """
    t = min(half_width / ((high - low) / 2), 1.0)
    return t**2 * (3.0 - 2.0 * t) * (readings - (low + high) / 2)


def creep_sum(time: Array, readings: Array, piece: IntArray, t0: float, dwell: float = 0.0) -> Array:
    """(n,) sum over past moves of step * log10(1 + age / t0) at ordered times (n,), s; in the unit of the readings (n,).

    A move ends ``dwell`` s before the row that it leads to; moves of other pieces (n,) do not count.
    """
    steps = np.diff(readings, prepend=readings[:1])
    fresh = np.diff(piece, prepend=piece[:1] - 1) != 0
    steps[fresh] = 0.0
    if len(readings) > MANY:
        return _creep_by_exponentials(time, steps, fresh, t0, dwell)
    begins = np.flatnonzero(fresh)
    start = np.zeros(len(readings), dtype=np.int64)
    start[begins] = begins
    start = np.maximum.accumulate(start)
    out = np.zeros(len(readings))
    for k, first in enumerate(start.tolist()):
        moved = first + np.flatnonzero(steps[first : k + 1])
        out[k] = steps[moved] @ np.log10(1.0 + (time[k] - time[moved] + dwell) / t0)
    return out


def heat_of_motion(time: Array, readings: Array, piece: IntArray, seconds: float) -> Array:
    """(n,) sum over past moves of |step| exp(-age / seconds) at ordered times (n,), s; in the unit of the readings (n,).

    The first-order response of a body that every move warms alike; it is cold where a ``piece`` (n,) begins.
    """
    fresh = np.diff(piece, prepend=piece[:1] - 1) != 0
    steps = np.where(fresh, 0.0, np.abs(np.diff(readings, prepend=readings[:1])))
    kept = np.where(fresh[1:], 0.0, np.exp(-np.maximum(np.diff(time), 0.0) / seconds))
    return np.concatenate([steps[:1], affine(kept, steps[1:], float(steps[0]))])


def _creep_by_exponentials(time: Array, steps: Array, fresh: Mask, t0: float, dwell: float) -> Array:
    """The same by a sum of exponentials, each of which follows from the row before.

    ln(1 + t / t0) is the integral of (1 - exp(-s t)) exp(-s t0) over u = ln s; even steps of u converge as exp(-pi^2 / step)
    (Beylkin and Monzon 2010, Appl. Comput. Harmon. Anal. 28:131), here to 1e-10 of the largest term.
    """
    longest = float(np.ptp(time)) + dwell + t0
    u = np.arange(np.log(1e-11 / longest), np.log(30.0 / t0), EXPONENTS)
    rates, weights = np.exp(u), EXPONENTS * np.exp(-np.exp(u) * t0) / np.log(10.0)
    age, goes_on = np.diff(time, prepend=time[:1]), ~fresh
    whole = affine(goes_on.astype(np.float64), steps, 0.0)
    out = np.zeros(len(time))
    for rate, weight in zip(rates.tolist(), weights.tolist(), strict=True):
        left = affine(np.where(goes_on, np.exp(-rate * age), 0.0), steps, 0.0)
        out += weight * (whole - np.exp(-rate * dwell) * left)
    return out


def latest_earlier_row(pose: IntArray, origin: IntArray, time: Array | None) -> IntArray:
    """(n,) for each row of one file, the latest earlier row whose `pose` is its `origin`; all are (n,).

    Without such a row, a row whose origin is its own pose refers to itself; any other gets -1.
    """
    n = len(pose)
    place = np.arange(n, dtype=np.int64)
    order = order_in_time(time, np.zeros(n, dtype=np.int64), place)
    last: dict[int, int] = {}
    found = np.full(n, -1, dtype=np.int64)
    for row in order.tolist():
        wanted = int(origin[row])
        if wanted in last:
            found[row] = last[wanted]
        elif wanted == pose[row]:
            found[row] = row
        last[int(pose[row])] = row
    return found


class _Segments:
    """n rows as (length, count) arrays: one column a segment, padded at the end."""

    def __init__(self, rows: int) -> None:
        self._rows, self._count = rows, max(int(np.sqrt(rows)), 1)
        self._length = -(-rows // self._count)

    def cut(self, values: Array, padding: float) -> Array:
        """(length, count) of values (n,)."""
        out = np.full(self._length * self._count, padding)
        out[: self._rows] = values
        return np.ascontiguousarray(out.reshape(self._count, self._length).T)

    def joined(self, values: Array) -> Array:
        """(n,) of (length, count)."""
        return np.ascontiguousarray(values.T).reshape(-1)[: self._rows]


def affine(factor: Array, added: Array, start: float) -> Array:
    """(n,) y = factor * y + added (both (n,)), from ``start`` before the first row."""
    segments = _Segments(len(factor))
    factors, sums = segments.cut(factor, 1.0), segments.cut(added, 0.0)
    slope, offset = np.ones(factors.shape[1]), np.zeros(factors.shape[1])
    for f, c in zip(factors, sums, strict=True):
        slope, offset = f * slope, f * offset + c
    state = np.empty(len(slope))
    for k, (f, c) in enumerate(zip(slope.tolist(), offset.tolist(), strict=True)):
        state[k], start = start, f * start + c
    out = np.empty_like(factors)
    for k, (f, c) in enumerate(zip(factors, sums, strict=True)):
        state = out[k] = f * state + c
    return segments.joined(out)


def clipped(steps: tuple[Array, Array], begins: Array, limit: float) -> Array:
    """(n,) a state that takes two steps (n,) a row, one after the other, and is held from -limit to limit after each.

    ``begins`` (n,): where the state begins anew, its value after that row; NaN elsewhere. It is 0 before the first row.
    """
    segments = _Segments(len(begins))
    first, second = (segments.cut(step, 0.0) for step in steps)
    anew = segments.cut(begins, np.nan)
    begun = ~np.isnan(anew)
    count = first.shape[1]
    shift, low, high = np.zeros(count), np.full(count, -limit), np.full(count, limit)
    for step, new, value in _rows(first, second, begun, anew):
        shift = np.where(new, 0.0, shift + step[0] + step[1])
        low, high = (
            np.where(new, value, _held(_held(x + step[0], limit) + step[1], limit)) for x in (low, high)
        )
    state, here = np.empty(count), 0.0
    for k, (by, least, most) in enumerate(zip(shift.tolist(), low.tolist(), high.tolist(), strict=True)):
        state[k], here = here, min(max(here + by, least), most)
    out = np.empty_like(first)
    for k, (step, new, value) in enumerate(_rows(first, second, begun, anew)):
        state = out[k] = np.where(new, value, _held(_held(state + step[0], limit) + step[1], limit))
    return segments.joined(out)


def _rows(
    first: Array, second: Array, begun: Array, anew: Array
) -> Iterator[tuple[tuple[Array, Array], Array, Array]]:
    for a, b, new, value in zip(first, second, begun, anew, strict=True):
        yield (a, b), new, value


def _held(state: Array, limit: float) -> Array:
    return np.minimum(np.maximum(state, -limit), limit)
