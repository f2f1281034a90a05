"""Find all joints that put an arm's tool at a pose, and which of them a program means.

A pose in a program has up to eight solutions and whole turns of the joints. Newton's method is started from many places of
the joints' ranges; what it finds is told apart, and a target's configuration, or else the way from the target before,
says which solution is meant.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats.qmc import Halton

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.compensation.inverse import PoseSolver
from truepose.identification.leaves.programs.arm_shape import ArmShape
from truepose.identification.leaves.programs.configurations import Configuration
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import turns_freely

Numbers = tuple[float, ...]
STARTS = 48
"""Places that Newton's method starts from. Of 600 random poses of an IRB 120 and a UR5e it found the
joints they were made from for 599."""
_SAME = 1e-6
"""rad, or part of a metre: solutions nearer than this are one."""
_TURN = 2 * np.pi


class Branches:
    """Solutions of one machine at its solver's present constants."""

    def __init__(self, machine: Machine, solver: PoseSolver) -> None:
        self._solver = solver
        self._actuators = machine.mechanism.actuators
        self._free = [turns_freely(machine.mechanism, name) for name in machine.mechanism.readings]
        self._starts = np.vstack([solver.model.q_home, self._spread(STARTS)])
        try:
            self._shape: ArmShape | None = ArmShape(
                machine, dict(zip(solver.model.names, solver.p.tolist(), strict=True))
            )
        except InputError:  # no open chain: nothing to tell the shape of
            self._shape = None
        self._root, self._reach = self._shape.reach() if self._shape else (np.zeros(3), np.inf)

    def found(
        self, poses: Array, wanted: Sequence[Numbers], configuration: Configuration | None
    ) -> list[Array]:
        """Of each sensor-frame pose (n, 4, 4) distinct solutions (m, nq) in the joints' ranges.

        All that are found; of a pose with the numbers ``wanted`` of a configuration the search ends with the one that has it.
        """
        out: list[list[Array]] = [[] for _ in poses]
        away = np.linalg.norm(poses[:, :3, 3] - self._root, axis=1)
        rows = np.flatnonzero(away <= self._reach * (1 + _SAME))  # a search that finds nothing is the longest
        for start in self._starts if len(rows) else ():
            self._attempt(poses, rows, np.broadcast_to(start, (len(rows), len(start))), out)
            left = [k for k in rows.tolist() if not self._has(out[k], wanted[k], configuration)]
            rows = np.array(left, dtype=np.intp)
            if not len(rows):
                break
        known = [(k, flipped(q)) for k in rows for q in out[k]]
        if known:
            self._attempt(poses, np.array([k for k, _ in known]), np.array([q for _, q in known]), out)
        return [np.array(one).reshape(-1, len(self._actuators)) for one in out]

    def chosen(
        self, q: Array, before: Array, configuration: Configuration | None, numbers: Numbers
    ) -> Array | str:
        """Return the one of solutions (m, nq) that ``numbers`` of a configuration mean, else the next to joints ``before``
        (nq,); or why none can be told."""
        if not len(q):
            return "the nominal machine cannot take this pose with its joints in their ranges"
        turned = self._turns(q)
        if configuration is None or not numbers:
            return np.asarray(turned[int(np.argmin(np.max(np.abs(turned - before), axis=1)))])
        told = ", ".join(f"{n:g}" for n in numbers)
        fit = turned[configuration.fits(numbers, turned)]
        if len(fit) > 1:
            fit = fit[self._decided(fit, configuration, numbers)]
        if not len(fit):
            return f"no joints of the nominal machine that reach it have its configuration ({told})"
        if any(self._apart(other, fit[0]) > _SAME for other in fit):
            return f"several configurations of the joints have these numbers ({told})"
        return np.asarray(fit[int(np.argmin(np.max(np.abs(fit - before), axis=1)))])

    def _has(self, found: list[Array], numbers: Numbers, configuration: Configuration | None) -> bool:
        """Whether one of the solutions has a configuration in all its numbers."""
        if configuration is None or not numbers or not found:
            return False
        turned = self._turns(np.array(found))
        fit = turned[configuration.fits(numbers, turned)]
        return bool(len(fit)) and bool(self._decided(fit, configuration, numbers).any())

    def _decided(self, q: Array, configuration: Configuration, numbers: Numbers) -> Mask:
        if self._shape is None:
            return np.ones(len(q), dtype=bool)
        return configuration.decides(numbers, self._shape.of(q))

    def _attempt(self, poses: Array, rows: Index, start: Array, out: list[list[Array]]) -> None:
        """Add what Newton's method finds for poses ``rows`` (k,) from ``start`` (k, nq)."""
        found = self._solver.inverse(poses[rows], start, restarts=0)
        for k in np.flatnonzero(found.solved):
            q, known = found.q[k], out[rows[k]]
            if all(self._apart(q, other) > _SAME for other in known):
                known.append(q)

    def _turns(self, q: Array) -> Array:
        """Solutions (m, nq) with those that differ by a whole turn of joints, in their ranges."""
        for k, actuator in enumerate(self._actuators):
            if not self._free[k]:
                continue
            low, high = actuator.reading_range or (-_TURN, _TURN)
            both = np.concatenate([q + turn * np.eye(q.shape[1])[k] for turn in (0.0, _TURN, -_TURN)])
            q = both[(both[:, k] >= low - 1e-9) & (both[:, k] <= high + 1e-9)]
        return q

    def _apart(self, q: Array, other: Array) -> float:
        """Largest difference of two solutions (nq,), whole turns aside."""
        turns = np.where(self._free, _TURN, np.inf)
        apart = q - other
        return float(
            np.max(np.abs(np.where(np.isinf(turns), apart, np.remainder(apart + np.pi, _TURN) - np.pi)))
        )

    def _spread(self, count: int) -> Array:
        size = self._solver.size
        widest = [(-size, size) if a.reading_unit == "mm" else (-np.pi, np.pi) for a in self._actuators]
        ranges = [
            _within(a.reading_range, w) if a.reading_range else w
            for a, w in zip(self._actuators, widest, strict=True)
        ]
        low, high = np.array(ranges).T
        share = Halton(len(low), scramble=False).random(count + 1)[1:]
        return np.asarray(low + share * (high - low))


def flipped(q: Array) -> Array:
    """(nq,) where the other solution of a spherical wrist is, for joints (nq,)."""
    return q + np.array([0, 0, 0, np.pi, -2 * q[4], np.pi]) if len(q) == 6 else q


def _within(stated: tuple[float, float], widest: tuple[float, float]) -> tuple[float, float]:
    """A range, of a joint that turns by more than a turn the middle one."""
    if widest[1] != np.pi or stated[1] - stated[0] <= _TURN:
        return stated
    middle = (stated[0] + stated[1]) / 2
    return middle - np.pi, middle + np.pi
