"""Gram matrices of columns of which many follow few ports: sums of products of two ports' columns, put in place at the end."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, combinations_with_replacement, pairwise

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.prediction.by_ports import Part
from truepose.threads import all_done


class GramSum:
    """(width, width) sum of products of columns over rows and channels (all, or some) of parts that come one by one.

    All parts have the same columns in the same order.
    """

    def __init__(self, width: int, channels: Sequence[int] | None = None) -> None:
        self._width, self._kind = width, slice(None) if channels is None else list(channels)
        self._order: Index = np.zeros(0, dtype=np.intp)
        self._spans = list[slice]()
        self._sums = np.zeros((0, 0))

    def add(self, part: Part) -> None:
        """The products of its columns. Raises ValueError for columns other than those of the parts before."""
        groups = [] if part.ports is None else part.ports.by_port()
        columns = [part.at, *(column for _, column, _ in groups)]
        order = np.concatenate(columns)
        if not self._spans:
            ends = np.cumsum([0, *map(len, columns)]).tolist()
            self._order, self._spans = order, [slice(a, b) for a, b in pairwise(ends)]
            self._sums = np.zeros((len(order), len(order)))
        if not np.array_equal(order, self._order):
            raise ValueError("parts of one sum have the same columns")
        dense = part.dense[:, self._kind]
        slopes = None if part.ports is None else part.ports.slopes[:, self._kind]

        def corner(at: tuple[int, int]) -> None:
            left, right = _factors(dense, slopes, groups, *at)
            self._sums[self._spans[at[0]], self._spans[at[1]]] += left.T @ right

        all_done(corner, list(combinations_with_replacement(range(len(self._spans)), 2)))

    def matrix(self) -> Array:
        """The sum; what was added is let go."""
        sums, self._sums = self._sums, np.zeros((0, 0))
        for a, b in combinations(self._spans, 2):
            sums[b, a] = sums[a, b].T
        out = np.zeros((self._width, self._width))
        out[np.ix_(self._order, self._order)] = sums
        self._spans = []
        return out


def _factors(
    dense: Array, slopes: Array | None, groups: Sequence[tuple[int, Index, Array]], g: int, h: int
) -> tuple[Array, Array]:
    """(k, c), (k, d) whose product is that of two groups of columns, g <= h: 0 is what follows no port."""
    if slopes is None or h == 0:
        flat = dense.reshape(-1, dense.shape[2])
        return flat, flat
    port, _, values = groups[h - 1]
    if g == 0:
        return np.asarray(np.einsum("nmd,nm->nd", dense, slopes[:, :, port])), values
    other, _, first = groups[g - 1]
    both = np.einsum("nm,nm->n", slopes[:, :, other], slopes[:, :, port])
    return first, both[:, None] * values
