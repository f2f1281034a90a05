"""States that follow from the one before, row by row, without a loop over rows.

A row's step is a function of the state, and the steps of many rows in a row are one function of the same form. So rows are cut
into segments that are as many as each has rows: the function of every segment gives the state at its beginning, and from
there all segments are walked side by side, in the arithmetic of a plain loop.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from truepose.arrays import Array


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
