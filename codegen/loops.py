"""Expressions of closed chains for the generated C: pose, closure, their derivative entry by entry, Newton's equations.

Two systems are solved over and over: the loops for the passive coordinates x at given readings, and pose with loops for
all unknowns y = (q, x). Both have the same zeros everywhere, so each gets an elimination of its own, written out
(``truepose.codegen.loops``). Where there is none (equations that are no square system, or that are singular at
the samples), the damped search of the generated C does its work.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.layout import Layout
from truepose.codegen.reference import Reference
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.velocities import gap_derivative, twists
from truepose.models.task import Task

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
    values, symbols = list(inverses), [ca.SX.sym(f"F{k}") for k in range(n)]

    def stored(value: ca.SX) -> ca.SX:
        """Return the symbol of a value that is kept for the solution, or the value where it is constant."""
        if value.is_constant():
            return value
        values.append(value)
        symbols.append(ca.SX.sym(f"F{len(symbols)}"))
        return symbols[-1]

    upper = {key: entry if entry is own.get(key) else stored(entry) for key, entry in entries.items()}
    lower = {key: stored(factor) for key, factor in multipliers.items()}
    right = ca.SX.sym("r", n)
    solution = _solved(pivots.order, symbols[:n], lower, upper, right)
    return Factors(pivots, ca.vertcat(*values), ca.vertcat(*symbols), right, solution)


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


_SAMPLES = 24
_SMALLEST = {"double": 1e-7, "float": 1e-3}
"""Share of its typical size below which a pivot is not trusted."""


@dataclass(frozen=True)
class Equations:
    """Linear equations of Newton's method: factors by the entries ``J``, and the largest sound inverse pivots (n,)."""

    factors: Factors
    largest: Array

    @classmethod
    def of(cls, matrix: ca.SX, samples: Array, scale: tuple[Array, Array], real: str) -> Equations | None:
        """Equations of ``matrix`` (n, n) with pivots by its samples (m, n, n); ``scale`` of rows (n,) and columns (n,).

        None where the samples leave a pivot of zero.
        """
        rows, columns = scale
        pattern = np.array(ca.DM(matrix.sparsity(), 1.0)) != 0
        if not len(samples) or not pattern.any(axis=0).all() or not pattern.any(axis=1).all():
            return None
        pivots = Pivots.of(samples * rows[:, None] * columns, pattern)
        if not (pivots.sizes > 1e-12 * pivots.sizes.max()).all():
            return None
        at = np.array(pivots.order)
        typical = pivots.sizes / (rows[at[:, 0]] * columns[at[:, 1]])
        largest = [float(f"{1.0 / (_SMALLEST[real] * size):.3g}") for size in typical]
        return cls(factors_of(matrix, pivots), np.array(largest))


@dataclass(frozen=True)
class LoopExpressions:
    """Outputs of the functions of a closed chain.

    entries (nz,)    entries of the derivative [twist; closure] by y that are not always zero; those of the closure
                     by x, ``inner`` of them, come first
    places (nz,)     where they stand: row * (nq + nx) + column
    symbols (nz,)    what the equations read them as
    loops, whole     equations of the closure for x, and of pose and closure for y
    rows             those of [twist; closure] that ``whole`` solves: all, or of the twist what the task asks for
    """

    pose: ca.SX
    closure: ca.SX
    gap: ca.SX
    entries: ca.SX
    places: tuple[int, ...]
    inner: int
    symbols: ca.SX
    loops: Equations | None
    whole: Equations | None
    rows: tuple[int, ...]

    @classmethod
    def of(cls, model: SymbolicModel, layout: Layout, real: str) -> LoopExpressions:
        """The expressions of a model's loops."""
        derivative = ca.sparsify(ca.simplify(_derivative(model)))
        places, inner = _places(derivative, len(model.readings))
        entries = ca.vertcat(*(derivative[i, j] for i, j in places))
        symbols = ca.SX.sym("J", len(places))
        matrix, samples = _matrix(model, derivative, places, symbols), _samples(model, derivative, layout)
        nq, scale = len(model.readings), (layout.weight, layout.unknown)
        loops = Equations.of(matrix[6:, nq:], samples[:, 6:, nq:], (scale[0][6:], scale[1][nq:]), real)
        rows = _rows(layout.task, len(scale[0]))
        return cls(
            pose=ca.vec(model.pose[:3, :].T),  # row by row
            closure=model.closure,
            gap=model.gap,
            entries=entries,
            places=tuple(i * matrix.shape[1] + j for i, j in places),
            inner=inner,
            symbols=symbols,
            loops=loops,
            whole=Equations.of(matrix[rows, :], samples[:, rows], (scale[0][rows], scale[1]), real)
            if len(rows) == matrix.shape[1]
            else None,
            rows=tuple(rows),
        )


def _derivative(model: SymbolicModel) -> ca.SX:
    """(6 + nc, nq + nx) of [twist; closure], by screws where they tell it."""
    if model.closure.numel() == model.gap.numel() == model.x.numel():
        told = gap_derivative(model)
        if told is not None:
            return told
    y = ca.vertcat(model.q, model.x)
    return ca.vertcat(twists(model.pose, y), ca.jacobian(model.closure, y))


def _places(derivative: ca.SX, nq: int) -> tuple[list[tuple[int, int]], int]:
    """(row, column) of entries that are not always zero, those of the closure by x first, and how many these are."""
    rows, columns = derivative.sparsity().get_triplet()
    found = sorted(zip(rows, columns, strict=True), key=lambda at: (at[0] < 6 or at[1] < nq, at))
    return found, sum(1 for i, j in found if i >= 6 and j >= nq)


def _rows(task: Task, count: int) -> list[int]:
    """Return rows of [twist; closure] that are solved for a task; none where it has turns about axes of the tool."""
    if task.is_whole:
        return [*range(count)]
    return [] if task.about else [*task.along, *range(6, count)]


def _matrix(
    model: SymbolicModel, derivative: ca.SX, places: Iterable[tuple[int, int]], symbols: ca.SX
) -> ca.SX:
    """The derivative in symbols, but as it is where parameters and drivers alone determine an entry."""
    y, out = ca.vertcat(model.q, model.x), ca.SX(*derivative.shape)
    places = list(places)
    entries = ca.vertcat(*(derivative[i, j] for i, j in places))
    moving = ca.Function("entries", [y, model.p, model.z], [entries]).jac_sparsity(0, 0)
    moves = set(moving.get_triplet()[0])
    for k, (i, j) in enumerate(places):
        out[i, j] = symbols[k] if k in moves else entries[k]
    return out


def _samples(model: SymbolicModel, derivative: ca.SX, layout: Layout) -> Array:
    """(m, 6 + nc, nq + nx) the derivative at some of the layout's poses."""
    reference = Reference(model)
    at = ca.Function("J", [model.q, model.x, model.p, model.z], [ca.densify(derivative)])
    out = []
    for q, _ in layout.vectors[:_SAMPLES]:
        x = reference.passive(q)
        if x is not None:
            out.append(np.array(at(q, x, model.p_home, model.z_home)))
    return np.array(out).reshape(-1, *derivative.shape)
