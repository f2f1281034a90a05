"""Expressions of closed chains for the generated C: pose, closure, their derivative entry by entry, Newton's equations.

Two systems are solved over and over: the loops for the passive coordinates x at given readings, and pose with loops for
all unknowns y = (q, x). Both have the same zeros everywhere, so each gets an elimination of its own, written out
(``truepose.codegen.elimination``). Where there is none (equations that are no square system, or that are singular at
the samples), the damped search of the generated C does its work.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.elimination import Factors, Pivots, factors_of
from truepose.codegen.layout import Layout
from truepose.codegen.reference import Reference
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.velocities import gap_derivative, twists
from truepose.models.task import Task

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
        derivative = _without_zeros(_derivative(model))
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


def _without_zeros(matrix: ca.SX) -> ca.SX:
    return ca.sparsify(ca.simplify(matrix))


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
