"""Newton's method for readings and passive coordinates on many rows of a path at once, from readings nearby."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Index
from truepose.codegen.evaluation.batch import BatchFunction

_NEWTON = 30
_SETTLED = 1e-13
_INDEPENDENT = 1e-12
"""Singular value, in parts of the largest, below which equations say nothing: those of what no task asks for."""
_LONGEST = 0.1
"""Longest step of an unknown: part of the machine's size, or rad."""


@dataclass(frozen=True)
class Problem:
    """Index to solve: where they start (n, nu), in units (nu,) of the unknowns, the first ``readings`` of which are readings;
    drivers z (n, nz), constants p (np,) and goals (n, 16), column by column."""

    start: Array
    unit: Array
    readings: int
    z: Array
    p: Array
    goal: Array

    def some(self, rows: Index) -> Problem:
        """Return the problem of rows (k,)."""
        return replace(self, start=self.start[rows], z=self.z[rows], goal=self.goal[rows])

    def evaluate(self, gap: BatchFunction, u: Array, rows: Index) -> tuple[Array, Array]:
        """Return gaps (k, m) of rows (k,) at unknowns (k, nu), and their derivative (k, m, nu)."""
        at = u * self.unit
        value, slope = gap(
            at[:, : self.readings], at[:, self.readings :], self.z[rows], self.p, self.goal[rows]
        )
        return value[..., 0], slope * self.unit


def solve_rows(gap: BatchFunction, problem: Problem, start: Array | None = None) -> tuple[Array, Array]:
    """Return unknowns (n, nu) where ``gap`` is zero next to ``start`` (n, nu), by default the problem's, and what
    is left there (n, 3), as of ``left_of``."""
    u = (problem.start if start is None else start).copy()
    rows, left = np.arange(len(u)), np.full((len(u), 3), np.inf)
    for _ in range(_NEWTON):
        if not len(rows):
            break
        value, slope = problem.evaluate(gap, u[rows], rows)
        step = least_steps(slope, value)
        step /= np.maximum(1.0, np.max(np.abs(step), axis=1, keepdims=True) / _LONGEST)
        u[rows] -= step
        left[rows] = left_of(value)
        rows = rows[~(np.max(np.abs(step), axis=1) < _SETTLED * (1 + np.max(np.abs(u[rows]), axis=1)))]
    return u, left


def left_of(gap: Array) -> Array:
    """Return the largest entries (n, 3) of position, turns and loops in gaps (n, m), in parts of the size and rad."""
    parts = np.split(np.abs(gap), [3, 6], axis=1)
    return np.column_stack([np.max(part, axis=1, initial=0.0) for part in parts])


def least_steps(slope: Array, gap: Array) -> Array:
    """Return steps (n, nu) that slopes (n, m, nu) take to gaps (n, m); if m is not nu, the smallest that come nearest."""
    if slope.shape[1] == slope.shape[2]:
        try:
            return np.asarray(np.linalg.solve(slope, gap[..., None]))[..., 0]
        except np.linalg.LinAlgError:
            pass
    out: Array = (np.linalg.pinv(slope, rcond=_INDEPENDENT) @ gap[..., None])[..., 0]
    return out
