"""Newton's method for readings and passive coordinates on many rows of a path at once, from readings nearby."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.codegen.evaluation.batch import BatchFunction

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_NEWTON = 30
_SETTLED = 1e-13
_INDEPENDENT = 1e-12
"""Singular value, in parts of the largest, below which equations say nothing: those of what no task asks for."""
_LONGEST = 0.1
"""Longest step of an unknown: part of the machine's size, or rad."""
_FAR, _AMPLIFIED = 0.05, 10.0
"""A reading swings where it moves by more than this (part of the machine's size, or rad), and so many times the error."""
_HELD, _EXACT, _ROUNDS = 0.03, 1e4, 5
"""Weights of a reading's motion, and of position and loops, beside turns (rad); steps towards their least sum of squares."""


@dataclass(frozen=True)
class Problem:
    """Rows to solve: where they start (n, nu), in units (nu,) of the unknowns, the first ``readings`` of which are readings;
    drivers z (n, nz), constants p (np,) and goals (n, 16), column by column."""

    start: Array
    unit: Array
    readings: int
    z: Array
    p: Array
    goal: Array

    def evaluate(self, gap: BatchFunction, u: Array, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return gaps (k, m) of rows (k,) at unknowns (k, nu), and their derivative (k, m, nu)."""
        at = u * self.unit
        value, slope = gap(
            at[:, : self.readings], at[:, self.readings :], self.z[rows], self.p, self.goal[rows]
        )
        return value[..., 0], slope * self.unit


@dataclass(frozen=True)
class Solved:
    """Unknowns (n, nu), in parts of their units; what is left of position, rotation and loops (n, 3), in parts of the size and
    rad; ``moved`` (n,) is the largest motion of a reading; ``swings`` (n,): it is far for a small error, as next to a singular
    pose."""

    u: Array
    left: Array
    moved: Array
    swings: Mask


def solve_rows(gap: BatchFunction, problem: Problem, start: Array | None = None) -> Solved:
    """Return where ``gap`` is zero next to ``start`` (n, nu), by default the problem's."""
    start = problem.start if start is None else start
    u, rows, nq = start.copy(), np.arange(len(start)), problem.readings
    left, error = np.full((len(u), 3), np.inf), np.zeros(len(u))
    for k in range(_NEWTON):
        value, slope = problem.evaluate(gap, u[rows], rows)
        step = _least(slope, value)
        step /= np.maximum(1.0, np.max(np.abs(step), axis=1, keepdims=True) / _LONGEST)
        u[rows] -= step
        parts = np.split(np.abs(value), [3, 6], axis=1)
        left[rows] = np.column_stack([np.max(part, axis=1, initial=0.0) for part in parts])
        error = np.max(left[:, :2], axis=1) if k == 0 else error
        rows = rows[~(np.max(np.abs(step), axis=1) < _SETTLED * (1 + np.max(np.abs(u[rows]), axis=1)))]
        if not len(rows):
            break
    moved = np.max(np.abs(u - start)[:, :nq], axis=1)
    return Solved(u, left, moved, moved > np.maximum(_FAR, _AMPLIFIED * error))


def ease_rows(gap: BatchFunction, problem: Problem) -> Array:
    """Return unknowns (n, nu) that nearly meet position and loops, and turns as far as no reading moves far for it."""
    start, nq = problem.start, problem.readings
    u, every = start.copy(), np.arange(len(start))
    for _ in range(_ROUNDS):
        value, slope = problem.evaluate(gap, u, every)
        weight = np.where(np.isin(np.arange(value.shape[1]), (3, 4, 5)), 1.0, _EXACT)
        held = np.tile(_HELD * np.eye(nq, u.shape[1]), (len(u), 1, 1))
        rows = np.concatenate([weight[:, None] * slope, held], axis=1)
        right = np.concatenate([weight * value, _HELD * (u - start)[:, :nq]], axis=1)
        u -= (np.linalg.pinv(rows) @ right[..., None])[..., 0]
    return u


def _least(slope: Array, gap: Array) -> Array:
    """(n, nu) steps: the smallest of the least-squares ones where unknowns and equations differ in number."""
    if slope.shape[1] == slope.shape[2]:
        try:
            return np.asarray(np.linalg.solve(slope, gap[..., None]))[..., 0]
        except np.linalg.LinAlgError:
            pass
    out: Array = (np.linalg.pinv(slope, rcond=_INDEPENDENT) @ gap[..., None])[..., 0]
    return out


__all__ = ["Problem", "Solved", "ease_rows", "solve_rows"]
