"""What the order of rows tells: lagged temperatures, the direction a joint came from, the row of `from`.

Plain functions of arrays; rows are ordered by time where it is known, else by their place in the files.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from truepose.models.units import FloatArray

IntArray = npt.NDArray[np.int64]


def order_in_time(time: FloatArray | None, file: IntArray, row: IntArray) -> IntArray:
    """Indices that put rows in order of acquisition, (n,)."""
    keys = (row, file) if time is None else (row, file, time)
    return np.lexsort(keys).astype(np.int64)


def exponential_lag(time: FloatArray, values: FloatArray, seconds: float) -> FloatArray:
    """The first-order response y' = (x - y)/seconds at ordered times (n,), y = x at the first.

    Exact for an input that runs straight from one sample to the next.
    """
    if seconds <= 0.0:
        return values.copy()
    lagged = np.empty_like(values)
    state = float(values[0])
    lagged[0] = state
    for k in range(1, len(values)):
        step = float(time[k] - time[k - 1])
        if step > 0.0:
            rise = -np.expm1(-step / seconds)
            before, now = float(values[k - 1]), float(values[k])
            slope_share = (now - before) * (1.0 - rise * seconds / step)
            state += rise * (before - state) + slope_share
        lagged[k] = state
    return lagged


def direction_of_travel(readings: FloatArray, piece: IntArray) -> FloatArray:
    """Sign of the last change before or at each ordered row, (n,); starts at 0 in every piece."""
    signs = np.zeros(len(readings))
    for k in range(1, len(readings)):
        if piece[k] == piece[k - 1]:
            change = np.sign(readings[k] - readings[k - 1])
            signs[k] = change if change else signs[k - 1]
    return signs


def latest_earlier_row(pose: IntArray, origin: IntArray, time: FloatArray | None) -> IntArray:
    """For each row of one file, the latest earlier row whose `pose` is its `origin`, (n,).

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
