"""Gram matrices of columns of which many follow few ports: sums of products of two ports' columns, put in place at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from truepose.identification.prediction.by_ports import Part
from truepose.threads import all_done

Array = NDArray[np.float64]
Index = NDArray[np.intp]


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
        all_done(self._products(part, groups))

    def _products(self, part: Part, groups: Sequence[tuple[int, Index, Array]]) -> Iterator[Callable[[], None]]:
        """Tasks that add to a corner of the sums each."""
        dense = part.dense[:, self._kind]
        flat = dense.reshape(-1, dense.shape[2])
        yield lambda: self._add(0, 0, flat, flat)
        if part.ports is None:
            return
        slopes = part.ports.slopes[:, self._kind]

        def across(g: int, port: int, values: Array) -> None:
            self._add(0, g, np.einsum("nmd,nm->nd", dense, slopes[:, :, port]), values)

        def between(g: int, h: int) -> None:
            (port, _, values), (other, _, factors) = groups[g], groups[h]
            both = np.einsum("nm,nm->n", slopes[:, :, port], slopes[:, :, other])
            self._add(g + 1, h + 1, values, both[:, None] * factors)

        for g, (port, _, values) in enumerate(groups):
            yield lambda g=g, port=port, values=values: across(g + 1, port, values)  # type: ignore[misc]
            for h in range(g, len(groups)):
                yield lambda g=g, h=h: between(g, h)  # type: ignore[misc]

    def _add(self, row: int, column: int, left: Array, right: Array) -> None:
        self._sums[self._spans[row], self._spans[column]] += left.T @ right

    def matrix(self) -> Array:
        """The sum; what was added is let go."""
        sums, self._sums = self._sums, np.zeros((0, 0))
        for a, b in combinations(self._spans, 2):
            sums[b, a] = sums[a, b].T
        out = np.zeros((self._width, self._width))
        out[np.ix_(self._order, self._order)] = sums
        self._spans = []
        return out


__all__ = ["GramSum"]
