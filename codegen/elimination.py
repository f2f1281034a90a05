"""Sparse linear systems of one pattern as straight-line expressions: the order of the pivots is chosen beforehand.

Newton's method in the generated C solves the same few systems all the time: the same entries are zero, and at typical
poses the same entries are large. So the pivots are chosen once, from the pattern (Markowitz: as few products as can be)
among entries that are large enough on sample matrices, and elimination is printed without a loop or a branch. Whether a
pivot became too small is seen afterwards, by its inverse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array

_THRESHOLD = 0.05
"""A pivot is at least this share of the largest entry that its column has left, in every sample."""


@dataclass(frozen=True)
class Pivots:
    """Order of the pivots, as (row, column), and the typical size (n,) of each one."""

    order: tuple[tuple[int, int], ...]
    sizes: Array

    @classmethod
    def of(cls, samples: Array, pattern: Array) -> Pivots:
        """Pivots for matrices of ``pattern`` (n, n), True where an entry may be nonzero, chosen by ``samples`` (m, n, n).

        Rows and columns of the samples are scaled so that their sizes can be compared.
        """
        left, fill = np.array(samples, dtype=float), np.array(pattern, dtype=bool)
        rows, columns = list(range(fill.shape[0])), list(range(fill.shape[1]))
        order, sizes = [], []
        while rows:
            i, j = _best(left, fill, rows, columns)
            pivot = left[:, i, j]
            order.append((i, j))
            sizes.append(float(np.median(np.abs(pivot))))
            rows.remove(i)
            columns.remove(j)
            safe = np.where(pivot == 0.0, 1.0, pivot)
            for r in (r for r in rows if fill[r, j]):
                left[:, r] -= (left[:, r, j] / safe)[:, None] * left[:, i]
                fill[r] |= fill[i]
        return cls(tuple(order), np.array(sizes))


@dataclass(frozen=True)
class Factors:
    """Triangular factors of a matrix, as expressions of its entries.

    values (nf,)   inverse pivots in their order (n of them), then multipliers and entries that elimination changed
    symbols (nf,)  what ``solution`` reads them as; constants are read as they are
    """

    pivots: Pivots
    values: ca.SX
    symbols: ca.SX
    right: ca.SX
    solution: ca.SX

    @property
    def size(self) -> int:
        """Unknowns."""
        return len(self.pivots.order)


def factors_of(matrix: ca.SX, pivots: Pivots) -> Factors:
    """Factors of ``matrix`` (n, n), whose entries are symbols, constants or expressions that ``solution`` may repeat."""
    n = matrix.shape[0]
    own = {(i, j): matrix[i, j] for i in range(n) for j in range(n) if not matrix[i, j].is_zero()}
    entries = dict(own)
    inverses, multipliers = [], {}
    left = list(range(n))
    for i, j in pivots.order:
        left.remove(i)
        inverse = 1 / entries[i, j]
        inverses.append(inverse)
        for r in (r for r in left if (r, j) in entries):
            factor = multipliers[r, i] = entries.pop((r, j)) * inverse
            for c in (c for (row, c) in list(entries) if row == i and c != j):
                entries[r, c] = entries.get((r, c), ca.SX(0)) - factor * entries[i, c]
    stored = _Stored(inverses)
    upper = {key: entry if entry is own.get(key) else stored.read(entry) for key, entry in entries.items()}
    lower = {key: stored.read(factor) for key, factor in multipliers.items()}
    right = ca.SX.sym("r", n)
    solution = _solved(pivots.order, stored.symbols[: len(inverses)], lower, upper, right)
    return Factors(pivots, ca.vertcat(*stored.values), ca.vertcat(*stored.symbols), right, solution)


class _Stored:
    """Values that are kept between elimination and solution, each with its symbol."""

    def __init__(self, inverses: Sequence[ca.SX]) -> None:
        self.values, self.symbols = list(inverses), [ca.SX.sym(f"F{k}") for k in range(len(inverses))]

    def read(self, value: ca.SX) -> ca.SX:
        """The symbol of a value, or the value where it is constant."""
        if value.is_constant():
            return value
        self.values.append(value)
        self.symbols.append(ca.SX.sym(f"F{len(self.symbols)}"))
        return self.symbols[-1]


def _solved(
    order: Sequence[tuple[int, int]],
    inverses: Sequence[ca.SX],
    lower: dict[tuple[int, int], ca.SX],
    upper: dict[tuple[int, int], ca.SX],
    right: ca.SX,
) -> ca.SX:
    """(n,) unknowns by a right side: forward along the pivots, then back."""
    b = {i: right[i] for i, _ in order}
    for i, _ in order:
        for (r, source), factor in lower.items():
            if source == i:
                b[r] = b[r] - factor * b[i]
    x: dict[int, ca.SX] = {}
    for (i, j), inverse in zip(reversed(order), reversed(inverses), strict=True):
        known = [(c, entry) for (row, c), entry in upper.items() if row == i and c != j]
        rest = b[i]
        for c, entry in known:
            rest = rest - entry * x[c]
        x[j] = rest * inverse
    return ca.vertcat(*(x[j] for j in range(len(order))))


def _best(left: Array, fill: Array, rows: Sequence[int], columns: Sequence[int]) -> tuple[int, int]:
    """The pivot with the fewest products among those that are large in every sample; the larger one of equals."""
    part = np.abs(left[:, rows][:, :, columns])
    pattern = fill[np.ix_(rows, columns)]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(part / part.max(axis=1, keepdims=True)).min(axis=0)
    share = np.where(pattern, share, -1.0).round(6)
    products = np.outer(pattern.sum(axis=1) - 1, pattern.sum(axis=0) - 1)
    sound = share >= min(_THRESHOLD, float(share.max()))
    cost = np.where(sound, products, products.max() + 1)
    candidates = np.argwhere(cost == cost.min())
    i, j = max(candidates.tolist(), key=lambda at: float(share[at[0], at[1]]))
    return rows[i], columns[j]
