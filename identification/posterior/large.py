"""Work on large matrices: BLAS without Python's lock, and pieces that threads work out beside each other.

Pieces are the same however many threads there are, and so are their digits.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from scipy.linalg import cython_blas

from truepose.arrays import Array
from truepose.threads import all_done, in_order

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


__all__ = ["LARGE", "map_large", "solve_large"]
