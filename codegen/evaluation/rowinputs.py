"""Which inputs of a batch differ from row to row and which all rows share, as a compiled function takes them."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array

WIDEST = 8
"""Most lanes of any processor: scratch is made for as many."""


@dataclass(frozen=True)
class RowInputs:
    """``sizes`` of the inputs; ``shared``: whether an input is one vector for all rows."""

    sizes: tuple[int, ...]
    shared: tuple[bool, ...]

    @classmethod
    def of(cls, sizes: Sequence[int], inputs: Sequence[Array]) -> RowInputs:
        """From the inputs of a call: an (n, size) array has a value for each row; a (size,) or empty one is shared."""
        pairs = zip(inputs, sizes, strict=True)
        return cls(tuple(sizes), tuple(np.ndim(a) < 2 or size == 0 for a, size in pairs))

    @property
    def widths(self) -> list[int]:
        """Sizes of the inputs that differ from row to row."""
        return [size for size, shared in zip(self.sizes, self.shared, strict=True) if not shared]

    def symbols(self, inputs: Sequence[ca.SX]) -> tuple[ca.SX, ca.SX]:
        """The inputs that differ from row to row in one column, and the shared ones in another."""
        x, p = ([a for a, s in zip(inputs, self.shared, strict=True) if s == kind] for kind in (False, True))
        return ca.vertcat(ca.SX(0, 1), *x), ca.vertcat(ca.SX(0, 1), *p)

    def own(self, inputs: Sequence[Array], rows: int) -> list[Array]:
        """The inputs that differ from row to row, each (rows, size), copied where C could not read them in place."""
        triples = zip(inputs, self.sizes, self.shared, strict=True)
        return [
            np.ascontiguousarray(
                a if np.shape(a) == (rows, size) else np.broadcast_to(a, (rows, size)), dtype=float
            )
            for a, size, shared in triples
            if not shared
        ]

    def common(self, inputs: Sequence[Array]) -> Array:
        """All shared inputs (size,) one behind the other in a vector (k,), then a zero: it is never empty."""
        triples = zip(inputs, self.sizes, self.shared, strict=True)
        parts = [
            np.broadcast_to(np.asarray(a, dtype=float), size)
            for a, size, shared in triples
            if shared and size
        ]
        return np.concatenate([*parts, np.zeros(1)])


def rows_of(inputs: Sequence[Array]) -> int:
    """Number of rows of the first input (n, size); 1 where all inputs are shared (size,)."""
    return next((len(a) for a in inputs if np.ndim(a) == 2), 1)


def pointers(arrays: Sequence[Array]) -> ctypes.Array[ctypes.c_void_p]:
    """Addresses of the first entries of arrays of any shape, as C takes them."""
    return (ctypes.c_void_p * max(len(arrays), 1))(*(a.ctypes.data for a in arrays))


def scratch(lanes: int, reals: int = 0) -> Array:
    """(k,) uninitialised reals, aligned for the widest vectors: room for ``lanes`` of them and ``reals`` more."""
    raw = np.empty(WIDEST * (lanes + 1) + reals)
    first = (-raw.ctypes.data % (8 * WIDEST)) // 8
    return raw[first:]
