"""Derivatives by many coefficients that move few ports: those of the ports, and one number a coefficient and row.

A series of a gear has hundreds of coefficients, all of which turn one joint. What the readings do when coefficient c moves
port p is (derivative by the port) times (the port's shift by c), a column (m,) times a number. Written out, it takes m times
the memory and, in a Gram matrix of columns, m times the work:

    sum over rows of J_c' J_d = sum over rows of s_c s_d (J_p' J_q),    c moves p by s_c, d moves q by s_d

Gram matrices of columns of which many follow few ports: sums of products of two ports' columns, put in place at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, combinations_with_replacement, pairwise

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.threads import all_done


@dataclass(frozen=True)
class ByPorts:
    """``column`` (c,) of the derivative by p is ``slopes`` (n, m, k) of the ``port`` (c,) times ``values`` (n, c)."""

    slopes: Array
    port: Index
    column: Index
    values: Array

    def with_slopes(self, slopes: Array) -> ByPorts:
        """The same coefficients, for what else follows the ports (n, m, k)."""
        return replace(self, slopes=slopes)

    def of_rows(self, rows: Index) -> ByPorts:
        """Of some rows."""
        return replace(self, slopes=self.slopes[rows], values=self.values[rows])

    def of_columns(self, kept: Mask) -> ByPorts:
        """Some of the coefficients."""
        return replace(self, port=self.port[kept], column=self.column[kept], values=self.values[:, kept])

    def scaled(self, weight: Array, scale: Array, column: Index) -> ByPorts:
        """Slopes times ``weight`` (n, 1, 1), coefficients in steps of ``scale`` (c,), at other places."""
        return ByPorts(self.slopes * weight, self.port, column, self.values * scale)

    def by_port(self) -> list[tuple[int, Index, Array]]:
        """Each port with its columns (c,) and their values (n, c)."""
        every = [(int(k), self.port == k) for k in np.unique(self.port)]
        return [(k, self.column[own], self.values[:, own]) for k, own in every]

    def put_into(self, out: Array) -> None:
        """Write the columns into ``out`` (n, m, w)."""
        for k, column, values in self.by_port():
            out[:, :, column] = self.slopes[:, :, [k]] * values[:, None]


@dataclass(frozen=True)
class Part:
    """Columns of some rows: ``dense`` (n, m, d) at the places ``at`` (d,), and those by ports."""

    dense: Array
    at: Index
    ports: ByPorts | None

    def written(self, width: int) -> Array:
        """(n, m, width) all columns side by side."""
        out = np.zeros((*self.dense.shape[:2], width))
        out[:, :, self.at] = self.dense
        if self.ports is not None:
            self.ports.put_into(out)
        return out

    def readings(self, channels: Sequence[int]) -> int:
        """How many rows have anything in each of some channels: a reading that was lost has nothing."""
        there = np.any(self.dense[:, list(channels)] != 0.0, axis=2)
        if self.ports is not None:
            there |= np.any(self.ports.slopes[:, list(channels)] != 0.0, axis=2)
        return int(np.sum(there))


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
