"""Commands that make the real machine follow a path: what the drawing says would happen, made to happen.

The target of a row is where nominal joints and links, with the calibrated tool frame, put the tool. ``exact`` solves
the calibrated machine, with its effects, for the readings that put it there. ``first-order`` is the way of Huang et
al. (2019), eq. (16) and Fig. 4, for controllers that know the nominal inverse kinematics only: the predicted pose
error, B times the errors of the parameters, is taken off the target, and the nominal machine is solved for that. It
leaves what is of second order in the errors.

Long paths go through the machine's generated C, compiled on the spot (``compiled``); the rest, and the rows
that the C leaves, go through Newton's method in numpy, on all rows at once (``rows``).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truepose.arrays import Array, Mask
from truepose.codegen.evaluation.compiled import NotCompiledError
from truepose.errors import InputError
from truepose.identification.compensation.compiled import CompiledKinematics, base_frame, shared_out
from truepose.identification.compensation.inverse import MET
from truepose.identification.compensation.rows import Compensation, Follower, Method, twists_between
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

METHODS: tuple[Method, ...] = ("exact", "first-order")
COMPILED_FROM = 20_000
"""Rows from which a path repays the compiler."""
BLOCK = 8192
"""Rows that one call of the C solves."""
_NEAR = 0.05
"""Largest correction that is taken from the C as it is, part of the machine's size or rad; beyond it lie other
assemblies."""
_PROBES = 8
_COLUMNS = ("command", "target", "before", "after", "not_asked", "eased")


def compensate(
    machine: Machine,
    path: Recording,
    *,
    method: Method = "exact",
    compiled_from: int = COMPILED_FROM,
) -> Compensation:
    """Commands for every row of ``path``, whose readings are nominal; drivers are the path's own.

    Nominal values are those of the file's
    ``nominal:``. Paths of ``compiled_from`` rows and more are solved by the generated C where there is a compiler;
    results agree within what counts as met (1e-9 of the machine's size, and 1e-9 rad). Raises InputError naming the
    first row that cannot be followed: out of reach, or with a joint out of its range.
    """
    if method not in METHODS:
        raise InputError(f"--method: found {method!r}, expected one of {', '.join(METHODS)}")
    follower = Follower(machine, path)
    if method != "exact" or len(path) < compiled_from:
        return follower.by_numpy(np.arange(len(path)), method)
    return _compiled(machine, follower)


def _compiled(machine: Machine, follower: Follower) -> Compensation:
    """By the generated C; rows that it leaves, and all where it cannot be had, by numpy."""
    every = np.arange(len(follower.nominal))
    try:
        way = _Way(machine, follower)
    except NotCompiledError as exc:
        return replace(follower.by_numpy(every, "exact"), solved_by=f"numpy: {exc}")
    whole, solved = _empty(follower), np.zeros(len(every), dtype=bool)

    def part(rows: slice) -> None:
        solved[rows] = way.follow(rows, whole)

    shared_out(part, len(every), BLOCK)
    others = every[~solved]
    if not len(others):
        return replace(whole, solved_by="compiled C")
    own = follower.by_numpy(others, "exact")
    for name in _COLUMNS:
        getattr(whole, name)[others] = getattr(own, name)
    return replace(whole, solved_by=f"compiled C; {len(others)} rows by numpy")


def _empty(follower: Follower) -> Compensation:
    """Room for every row: a path in parts and as a whole would take twice the memory."""
    n, nq = follower.nominal.shape
    command, target = np.zeros((n, nq)), np.zeros((n, 4, 4))
    target[:, 3, 3] = 1.0
    before, after, rest = np.zeros((3, n, 6))
    known, eased = (follower.readings, follower.nominal), np.zeros(n, dtype=bool)
    return Compensation(*known, command, target, before, after, "", follower.task, rest, eased)


class _Way:
    """A path by the machine's C, once that has been seen to agree with the model. Raises NotCompiledError."""

    def __init__(self, machine: Machine, follower: Follower) -> None:
        self._kinematics, self._follower = CompiledKinematics(machine, follower.task), follower
        self._base = base_frame(machine)
        every = np.arange(len(follower.nominal))
        rows = every[:: max(len(every) // _PROBES, 1)]
        poses, found = self._meant(follower.nominal[rows])
        if found.any():
            apart = np.abs(twists_between(follower.targets(rows[found]), self._seen(poses[found])))
            if not np.max(apart / ([follower.size] * 3 + [1.0] * 3)) <= MET:
                raise NotCompiledError("the C and the model assemble this machine differently")

    def follow(self, rows: slice, whole: Compensation) -> Mask:
        """Fill in rows as the C solves them; which of them can be taken as they are (k,)."""
        kinematics, follower = self._kinematics, self._follower
        q, z = follower.nominal[rows], follower.z[rows]
        target, meant = self._meant(q)
        command, turned, reached = self._commands(target, q, z)
        (now, stands), (then, met) = kinematics.fk(q, z), kinematics.fk(command, z)
        seen = self._seen(target)
        (before, _), (after, rest) = (follower.split(seen, self._seen(poses)) for poses in (now, then))
        good = meant & reached & stands & met & follower.within(command).all(axis=1)
        good &= np.max(np.abs(command - q) / follower.reach, axis=1) <= _NEAR
        good &= np.max(np.abs(after[:, :3]), axis=1) <= MET * follower.size
        good &= (np.max(np.abs(after[:, 3:]), axis=1) <= MET) | (turned > 0.0)
        whole.eased[rows], whole.command[rows], whole.target[rows, :3] = turned > 0.0, command, seen
        whole.before[rows], whole.after[rows], whole.not_asked[rows] = before, after, rest
        return np.asarray(good)

    def _commands(self, target: Array, q: Array, z: Array) -> tuple[Array, Array, Mask]:
        """Return commands (k, nq), the turn (k,) that each leaves next to a singular pose, and which rows have one."""
        if self._follower.swings:
            return self._kinematics.near(q, z)
        command, reached = self._kinematics.ik(target, q, z)
        return command, np.zeros(len(q)), reached

    def _meant(self, q: Array) -> tuple[Array, Mask]:
        """Poses (k, 3, 4) that nominal readings mean; the drawing has no effects, and no need of drivers."""
        return self._kinematics.fk(q, p=self._follower.ideal)

    def _seen(self, poses: Array) -> Array:
        """Poses (k, 3, 4) in the sensor's frame."""
        out: Array = self._base[:3, :3] @ poses
        out[:, :, 3] += self._base[:3, 3]
        return out
