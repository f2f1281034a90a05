"""Commands next to singular poses, where one joint would have to swing for a small turn of the tool.

A mill whose tool stands along its C axis cannot tilt it sideways: C would have to turn by a right angle for a microradian. One
joint, the one that turns the tool least, is held there. The others meet the position, and all turns but the one that only the
held joint makes. That turn is e rad away, and the joint makes it at a rate of r, so that it would have to move by t = e / r:

* by ``FARTHEST`` or less, or where the rate is ``CALM / 2`` or more: it moves by t, and the task is met;
* else it moves by M^2 / t, where M is the most that it may. That is continuous, goes to nothing at the singular pose, and
  leaves a turn below e. Positions are met all the same.

The generated C does the same (``ease.c.j2``), step by step.

Newton's method for readings and passive coordinates on many rows of a path at once, from readings nearby.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.models.task import CALM, FARTHEST, NOTHING, Task

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
        split = at[:, : self.readings], at[:, self.readings :]
        value, slope = gap(*split, self.z[rows], self.p, self.goal[rows])
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


_STEPS, _SAME_PLACE = 12, 1e-12
_MET = 1e-9


@dataclass(frozen=True)
class Eased:
    """Rows (k,) next to singular poses, and their unknowns (k, nu).

    ``left`` (k, 3) is that of ``solve_rows``, without the turns that are left on purpose, in rows that are ``nearly`` met (k,).
    """

    rows: Index
    u: Array
    left: Array
    nearly: Mask


@dataclass(frozen=True)
class Easing:
    """How to hold a joint: which readings are ``free`` for the turns of the task while the others meet its position."""

    gap: BatchFunction
    task: Task
    free: tuple[int, ...]

    @property
    def _turns(self) -> slice:
        """Rows of turns among those of ``_system``."""
        first = len(self.task.along)
        return slice(first, first + len(self.task.about))

    def ease(self, problem: Problem) -> Eased:
        """Return the commands of the rows that stand next to a singular pose."""
        _, slope = self._system(problem, problem.start, np.arange(len(problem.start)))
        held, open_turn, rate = self._choose(slope)
        rows = np.flatnonzero(np.abs(rate) < CALM)
        near, held, open_turn = problem.some(rows), held[rows], open_turn[rows]
        if not len(rows):
            return Eased(rows, near.start, np.zeros((0, 3)), np.zeros(0, dtype=bool))
        u, left, rate = self._hold(near, near.start, held, open_turn)
        is_met = np.abs(left) <= NOTHING
        swung = self._swing(near, u, held, open_turn, left, np.where(is_met, 1.0, rate))
        u = np.where(is_met[:, None], u, swung)
        rest = left_of(near.evaluate(self.gap, u, np.arange(len(rows)))[0])
        nearly = rest[:, 1] > NOTHING
        rest[nearly, 1] = 0.0
        return Eased(rows, u, rest, nearly)

    def _swing(
        self, near: Problem, u: Array, held: Index, open_turn: Array, left: Array, rate: Array
    ) -> Array:
        """Return ``u`` (n, nu) with the held readings where the turn that is left (n,) takes them, or as far as they may go."""
        every, most = np.arange(len(u)), np.maximum(FARTHEST, 2 * np.abs(left) / CALM)
        reaches = np.abs(left) <= most * np.abs(rate)
        moved = u.copy()
        moved[every, held] += np.where(reaches, left, most**2 * rate) / np.where(reaches, rate, left)
        out, some = self._hold(near, moved, held, open_turn)[0], np.flatnonzero(reaches)
        exact, rest = solve_rows(self.gap, near.some(some), moved[some])
        far = np.abs(exact - near.start[some])[np.arange(len(some)), held[some]] > 2 * most[some]
        is_exact = ~far & (rest[:, :2] <= _MET).all(axis=1)
        out[some[is_exact]] = exact[is_exact]
        return out

    def _system(self, problem: Problem, u: Array, rows: Index) -> tuple[Array, Array]:
        """Return the rows of the gap that count, positions, turns and loops (k, m), and their derivative (k, m, nu)."""
        value, slope = problem.evaluate(self.gap, u, rows)
        counted = [*self.task.rows, *range(6, value.shape[1])]
        return value[:, counted], slope[:, counted]

    def _choose(self, slope: Array) -> tuple[Index, Array, Array]:
        """Return the reading to hold (k,), the turn (k, r) that no other joint makes, and its rate by that reading (k,)."""
        turns, free = self._turns, list(self.free)
        rest = np.delete(np.arange(slope.shape[2]), free)
        kept = np.delete(np.arange(slope.shape[1]), np.arange(turns.start, turns.stop))
        by_free = np.zeros((len(slope), 3, 3)) + np.eye(3)
        for k, reading in enumerate(free):
            follow = least_steps(slope[:, kept][:, :, rest], slope[:, kept, reading])
            made = slope[:, turns, reading] - np.einsum("nij,nj->ni", slope[:, turns][:, :, rest], follow)
            by_free[:, :, k] = 0.0
            by_free[:, : len(free), k] = made
        columns = by_free.transpose(2, 0, 1)
        normal = np.array([np.cross(columns[(k + 1) % 3], columns[(k + 2) % 3]) for k in range(len(free))])
        size = np.linalg.norm(normal, axis=2)
        best, every = np.argmax(size, axis=0), np.arange(len(slope))
        size = np.maximum(size[best, every], np.finfo(float).tiny)
        open_turn = normal[best, every] / size[:, None]
        rate = np.sum(open_turn * columns[best, every], axis=1)
        return np.array(free)[best], open_turn[:, : len(free)], rate

    def _hold(
        self, problem: Problem, start: Array, held: Index, open_turn: Array
    ) -> tuple[Array, Array, Array]:
        """Return unknowns (n, nu) with the held readings (n,) as in ``start``; the turn (n,) left open, and its rate."""
        u, every = start.copy(), np.arange(len(start))
        for _ in range(_STEPS):
            value, slope = self._system(problem, u, every)
            by_held = slope[every, :, held]
            slope[every, :, held] = 0.0
            slope[every, self._turns, held] = open_turn
            step, follow = least_steps(slope, value), least_steps(slope, by_held)
            left, rate = -step[every, held], follow[every, held]
            step[every, held] = 0.0
            u -= step
            if np.max(np.abs(step)) < _SAME_PLACE:
                break
        return u, left, rate
