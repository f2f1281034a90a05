"""Which inputs of a batch are each row's and which all rows share, as a compiled function is given them."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WIDEST = 8
"""Most lanes of any processor: scratch is made for as many."""


@dataclass(frozen=True)
class RowInputs:
    """sizes: of every input; shared: whether it is one vector for all rows."""

    sizes: tuple[int, ...]
    shared: tuple[bool, ...]

    @classmethod
    def of(cls, sizes: Sequence[int], inputs: Sequence[Array]) -> RowInputs:
        """As the inputs of a call have it: (n, size) each row's, (size,) shared; what is empty counts as shared."""
        pairs = zip(inputs, sizes, strict=True)
        return cls(tuple(sizes), tuple(np.ndim(a) < 2 or size == 0 for a, size in pairs))

    @property
    def widths(self) -> list[int]:
        """Sizes of those of each row."""
        return [size for size, shared in zip(self.sizes, self.shared, strict=True) if not shared]

    def symbols(self, inputs: Sequence[ca.SX]) -> tuple[ca.SX, ca.SX]:
        """Those of each row, and the shared ones, one under the other."""
        x, p = ([a for a, s in zip(inputs, self.shared, strict=True) if s == kind] for kind in (False, True))
        return ca.vertcat(ca.SX(0, 1), *x), ca.vertcat(ca.SX(0, 1), *p)

    def own(self, inputs: Sequence[Array], rows: int) -> list[Array]:
        """Those of each row (rows, size), copied where C could not read them as they lie."""
        triples = zip(inputs, self.sizes, self.shared, strict=True)
        return [
            np.ascontiguousarray(
                a if np.shape(a) == (rows, size) else np.broadcast_to(a, (rows, size)), dtype=float
            )
            for a, size, shared in triples
            if not shared
        ]

    def common(self, inputs: Sequence[Array]) -> Array:
        """All shared ones in one vector, which has at least one entry."""
        triples = zip(inputs, self.sizes, self.shared, strict=True)
        parts = [
            np.broadcast_to(np.asarray(a, dtype=float), size)
            for a, size, shared in triples
            if shared and size
        ]
        return np.concatenate([*parts, np.zeros(1)])


def rows_of(inputs: Sequence[Array]) -> int:
    """How many rows: those of the first two-dimensional input, 1 where all are shared."""
    return next((len(a) for a in inputs if np.ndim(a) == 2), 1)


def pointers(arrays: Sequence[Array]) -> ctypes.Array[ctypes.c_void_p]:
    """Where the arrays begin, as C takes them."""
    return (ctypes.c_void_p * max(len(arrays), 1))(*(a.ctypes.data for a in arrays))


def scratch(lanes: int, reals: int = 0) -> Array:
    """Room for so many vectors of the widest kind and numbers behind them, beginning where a vector may."""
    raw = np.empty(WIDEST * (lanes + 1) + reals)
    first = (-raw.ctypes.data % (8 * WIDEST)) // 8
    return raw[first:]


__all__ = ["RowInputs", "pointers", "rows_of", "scratch"]
