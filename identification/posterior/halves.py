"""Triangular factors of what is taken in, and its products with all columns turned by them.

Work on large matrices: BLAS without Python's lock, and pieces that threads work out beside each other.

Pieces are the same however many threads there are, and so are their digits.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from scipy.linalg import cython_blas
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf

from truepose.arrays import Array, Index
from truepose.threads import Cached, all_done, in_order

T = TypeVar("T")
R = TypeVar("R")
LARGE = 5e7
"""Multiplications from which on threads pay: some milliseconds."""
PIECES = 4
"""Into how many pieces the columns of a large matrix are split."""
_TEXT, _INT, _REAL = ctypes.c_char_p, ctypes.POINTER(ctypes.c_int), ctypes.POINTER(ctypes.c_double)


def _unlocked(capsule: object, *arguments: type) -> Callable[..., None]:
    """Return a function of scipy's BLAS, which ctypes calls without Python's lock; ``scipy.linalg.blas`` holds it."""
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    place = api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule))
    return ctypes.CFUNCTYPE(None, *arguments)(place)


_DTRSM = _unlocked(
    cython_blas.__pyx_capi__["dtrsm"], *[_TEXT] * 4, _INT, _INT, _REAL, _REAL, _INT, _REAL, _INT
)


def solve_large(factor: Array, right: Array) -> Array:
    """Return a lower triangular factor's (r, r) solution of ``right`` (r, k)."""
    out, held = np.array(right, order="C"), np.asfortranarray(factor)
    edges = np.linspace(0, out.shape[1], PIECES + 1).astype(int)

    def solve(piece: int) -> None:
        part = out[:, edges[piece] : edges[piece + 1]]
        if part.size:
            size = ctypes.c_int(len(held))
            _DTRSM(
                b"R", b"L", b"T", b"N", ctypes.c_int(part.shape[1]), size, ctypes.c_double(1.0),
                held.ctypes.data_as(_REAL), size, part.ctypes.data_as(_REAL), ctypes.c_int(out.shape[1]),
            )  # fmt: skip

    all_done(solve, range(PIECES))
    return out


def map_large(work: Callable[[T], R], items: Sequence[T], multiplications: float) -> Iterable[R]:
    """Return ``work`` of each item in their order; by threads where each takes so many multiplications that it pays."""
    return in_order(work, items) if multiplications > LARGE else map(work, items)


class Halves:
    """What is taken in, turned by its triangular factor (r, r): its products ``rows`` (r, w) with all columns, and with e.

    Of what leaves another one, ``rows`` are ``turn`` (r, q) of those (q, w), worked out when they are asked for.
    """

    def __init__(
        self, factor: Array, rows: Array, turned: Array, turn: Array | None = None, of: Halves | None = None
    ) -> None:
        self._factor, self._own, self.turned = factor, rows, turned
        self._turn, self._of = turn, of

    @classmethod
    def from_turned(cls, rows: Array, turned: Array) -> Halves:
        """Return the halves of products that were turned already."""
        found = cls(np.zeros((0, 0)), rows[:0], turned)
        found.__dict__["all"] = rows
        return found

    @property
    def _rows(self) -> Array:
        if self._turn is not None and self._of is not None:
            self._own, self._turn, self._of = self._turn @ self._of.all, None, None
        return self._own

    @Cached
    def all(self) -> Array:
        """(r, w) of all columns; the rows that it follows from are not asked for again, and are let go."""
        found = solved(self._factor, self._rows)
        self._own = found[:0]
        return found

    @Cached
    def _root(self) -> Array:
        """(r, r) inverse of the factor."""
        return solved(self._factor, np.eye(len(self._factor)))

    def without(self, at: Index) -> tuple[Halves, float]:
        """What the rows ``at`` (k,) alone add to the others, and their log Bayes factor beside them."""
        back = self._root[:, at].T
        factor = cholesky(back @ back.T)
        turned = solved(factor, back @ self.turned)
        gain = 0.5 * float(turned @ turned) + half_log_det(factor)
        return Halves(factor, np.zeros((0, 0)), turned, back, self), gain

    def of(self, columns: Index) -> Array:
        """(r, k) of some columns."""
        if "all" in self.__dict__:
            return np.asarray(self.all[:, columns])
        return solved(self._factor, self._rows[:, columns])

    @property
    def nbytes(self) -> int:
        """What it takes of memory."""
        kept = (self.__dict__.get(name) for name in ("all", "_root"))
        return sum(a.nbytes for a in (self._factor, self._own, self._turn, *kept) if a is not None)


def taken(among: Array, scores: Array, sizes: Array) -> tuple[Array, Array, float]:
    """Triangular factor of I + Q M Q of some columns, its solution of Q t, and the columns' log Bayes factor."""
    scaled = among * sizes
    scaled *= sizes[:, None]
    scaled[np.diag_indices(len(sizes))] += 1.0
    factor = cholesky(scaled)
    turned = solved(factor, sizes * scores)
    return factor, turned, 0.5 * float(turned @ turned) - half_log_det(factor)


def cholesky(matrix: Array) -> Array:
    """Lower triangular factor of a symmetric matrix, which is written over.

    Small matrices are many here: LAPACK itself, without what scipy wraps around it; its own order of entries saves a copy. Of
    large ones numpy's lets other threads go on.
    """
    if len(matrix) ** 3 > 3.0 * LARGE:
        return np.asfortranarray(np.linalg.cholesky(matrix))
    factor, failed = dpotrf(matrix.T, lower=1, overwrite_a=1)
    if failed:
        raise np.linalg.LinAlgError(f"pivot {failed} is not positive")
    return np.asarray(factor)


def solved(factor: Array, right: Array) -> Array:
    """A lower triangular factor's solution of ``right`` (r,) or (r, k), row by row in memory as it came."""
    if not right.size:
        return right
    if right.ndim > 1 and len(factor) * right.size > LARGE:
        return solve_large(factor, right)
    rows = right.reshape(len(factor), -1)
    return np.asarray(dtrsm(1.0, factor, rows.T, side=1, lower=1, trans_a=1).T.reshape(right.shape))


def half_log_det(factor: Array) -> float:
    return float(np.sum(np.log(np.diag(factor))))
