"""Commands that make the real machine follow a path: what the drawing says would happen, made to happen.

The target of a row is where nominal joints and links, with the calibrated tool frame, put the tool. ``exact`` solves
the calibrated machine, with its effects, for the readings that put it there. ``first-order`` is the way of Huang et
al. (2019), eq. (16) and Fig. 4, for controllers that know the nominal inverse kinematics only: the predicted pose
error, B times the errors of the parameters, is taken off the target, and the nominal machine is solved for that. It
leaves what is of second order in the errors.

Newton's method solves many rows of the path at once, each from its own readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.compensation.inverse import (
    MET,
    base_frame,
    in_ranges,
    loop_scales,
    pose_gap,
    sizes_of,
)
from truepose.identification.compensation.singular import Easing, Problem, solve_rows
from truepose.identification.prediction.outside import outside_notes
from truepose.identification.prediction.predict import predictor_for
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.file.driver import STEP, Driver
from truepose.models.machine.controllability import free_joints, task_of
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.machine import Machine
from truepose.models.task import WHOLE, Task
from truepose.shown.result import Shown

Method = Literal["exact", "first-order"]
METHODS: tuple[Method, ...] = ("exact", "first-order")
BLOCK = 8192
"""Rows that are solved together."""
VISITS = 8
"""How often each row is evaluated, about."""


@dataclass(frozen=True, repr=False)
class Compensation(Shown):
    """Readings ``command`` (n, nq) for the path's ``nominal`` ones, in mm and rad (or the column's own unit).

    target (n, 4, 4): the sensor-frame poses that are meant. before, after (n, 6): twists [mm, rad] from the target to
    where the calibrated machine stands with nominal commands, and with the corrected ones; of them what ``task`` asks for.
    not_asked (n, 6): the rest of the twist with the corrected commands. eased (n,): rows next to a singular pose, where a turn
    would make a joint swing; there the position is met, and turns nearly. notes: rows that lie outside of what the calibration
    saw.
    ``to_frame()``: commands, one row for each of the path: the joints, ``<joint>.nominal``, then ``before.position``,
    ``before.rotation``, ``after.position``, ``after.rotation`` (errors, mm and rad).
    """

    readings: tuple[str, ...]
    nominal: Array
    command: Array
    target: Array
    before: Array
    after: Array
    task: Task = WHOLE
    not_asked: Array = field(default_factory=lambda: np.zeros((0, 6)))
    eased: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))
    notes: tuple[str, ...] = ()


def ideal_constants(machine: Machine, model: SymbolicModel) -> Array:
    """(np,) the drawing's joints and links with the calibrated frames, and no effect."""
    drawing = machine.file.nominal if machine.file else {}
    mechanism = {parameter.name for parameter in machine.mechanism.parameters}
    geometry = {parameter.name for parameter in machine.parameters}
    out = model.p_home.copy()
    for k, name in enumerate(model.names):
        if name in mechanism:
            out[k] = drawing.get(name, out[k])
        elif name not in geometry:
            out[k] = 0.0
    return out


class _Follower:
    """One machine along one path, some rows at a time, so that memory stays flat.

    ``real``, ``ideal`` (np,): constants of the machine, and those that the path's readings mean. ``z`` (n, nz) drivers,
    ``size`` of the machine in mm.
    """

    def __init__(self, machine: Machine, path: Recording) -> None:
        # no reading is looked at: a sensor that counts changes may count them from any row
        self._predictor = predictor_for(machine, replace(path, from_row=np.arange(len(path))), visits=VISITS)
        self._predictor.origin = None
        self._machine, self._path, self.z = machine, path, self._predictor.z
        model = self._predictor.model
        # a tool that follows a path is not read before it stands: early readings are no errors of it
        self.z[:, [Driver.of(name).kind == STEP for name in model.drivers]] = 0.0
        self.real, self.ideal = model.p_home, ideal_constants(machine, model)
        self.notes = outside_notes(model, path.q, self.z, path.where)
        self.size, gap = sizes_of(machine, model)
        share, unknown = loop_scales(machine, model, self.size)
        self._unit = np.array([*self._reach(), *unknown])
        self._closed = max(gap, MET * self.size)
        self.task = task_of(model)
        self._base = base_frame(machine)[:3, :3]
        self._gap = pose_gap(model, self.task, self.size, share, rows=VISITS * len(path))
        free = free_joints(model, self.task)
        self._easing = Easing(self._gap, self.task, free) if free else None

    def _reach(self) -> Array:
        """(nq,) readings that move their joint by the machine's size, or by 1 rad."""
        values, actuators = self._machine.geometry, self._machine.mechanism.actuators
        gains = [values[a.gain].nominal if a.gain else 1.0 for a in actuators]
        return np.array([self.size if a.unit == "mm" else 1.0 for a in actuators]) / np.abs(gains)

    def follow(self, rows: Index, method: Method) -> Compensation:
        """Rows (k,) of the path, from their own readings: corrections are small.

        Raises InputError about the first that cannot be followed.
        """
        predictor, q = self._predictor, self._path.q[rows]
        predictor.q, predictor.z = q, self.z[rows]
        x = self._assembled(self.ideal, rows)
        if method == "exact":
            target, _ = predictor.poses(self.ideal, x)
            command, eased = self._readings(rows, target, self.real, x)
        else:
            target, twist = predictor.twists(self.ideal, x)
            aim = _displaced(target, twist @ (self.ideal - self.real))
            command, eased = self._readings(rows, aim, self.ideal, x)
        self._check_ranges(command, rows)
        before, _ = self._errors(target, rows)
        predictor.q = command
        after, not_asked = self._errors(target, rows)
        readings = self._machine.mechanism.readings
        return Compensation(readings, q, command, target, before, after, self.task, not_asked, eased)

    def _readings(self, block: Index, target: Array, p: Array, x: Array) -> tuple[Array, Mask]:
        """(n, nq) readings that put the tool of constants ``p`` at ``target`` (n, 4, 4), and which meet turns nearly."""
        problem = self._problem(block, target, p, x)
        nq = problem.readings
        u, left, eased = problem.start.copy(), np.zeros((len(block), 3)), np.zeros(len(block), dtype=bool)
        others = np.ones(len(block), dtype=bool)
        if self._easing is not None:
            near = self._easing.ease(problem)
            held = self._met(near.left)  # else it is the position that is singular there
            some = near.rows[held]
            u[some], left[some], eased[some] = near.u[held], near.left[held], near.nearly[held]
            others[some] = False
        rest = np.flatnonzero(others)
        u[rest], left[rest] = solve_rows(self._gap, problem.some(rest))
        self._check_met(left, block)
        return np.asarray(u[:, :nq] * self._unit[:nq]), eased

    def _problem(self, block: Index, target: Array, p: Array, x: Array) -> Problem:
        """Return rows (k,) of the path with targets (k, 4, 4) of the tool, to be solved from their own readings."""
        q, goal = self._path.q[block], target.transpose(0, 2, 1).reshape(len(target), 16)
        return Problem(np.hstack([q, x]) / self._unit, self._unit, q.shape[1], self.z[block], p, goal)

    def _assembled(self, p: Array, rows: Index) -> Array:
        x, good = self._predictor.assemble(p)
        if not good.all():
            row = self._where(rows, int(np.argmin(good)))
            raise InputError(f"{row}: the mechanism cannot be assembled there; mend or drop the row")
        return x

    def _errors(self, target: Array, rows: Index) -> tuple[Array, Array]:
        """Twists (n, 6) from the target to where the calibrated machine puts the tool: what the task asks for, and the rest."""
        poses, _ = self._predictor.poses(self.real, self._assembled(self.real, rows))
        twists = twists_between(target, poses)
        asked = self.task.counted(twists, target, self._base)
        return asked, twists - asked

    def _where(self, rows: Index, row: int) -> str:
        return self._path.where(int(rows[row]))

    def _met(self, left: Array) -> Mask:
        """(n,) rows whose pose is met and whose loops are closed: what is left (n, 3), in parts of the size and rad."""
        return np.asarray((left[:, :2] <= MET).all(axis=1) & (left[:, 2] * self.size <= self._closed))

    def _check_met(self, left: Array, rows: Index) -> None:
        """Refuse rows that are not met: what is left (n, 3), in parts of the size and rad."""
        met = self._met(left)
        if not met.all():
            row = int(np.argmin(met))
            raise InputError(
                f"{self._where(rows, row)}: found no readings that put the tool where the path asks "
                f"({left[row, 0] * self.size:.3g} mm and {left[row, 1]:.3g} rad are left), expected a pose within reach"
            )

    def _check_ranges(self, command: Array, rows: Index) -> None:
        inside = in_ranges(self._machine, command).T
        for k, (actuator, within) in enumerate(zip(self._machine.mechanism.actuators, inside, strict=True)):
            if within.all() or actuator.range is None:
                continue
            row, (low, high) = int(np.argmin(within)), actuator.range
            raise InputError(
                f"{self._where(rows, row)}, column {actuator.reading!r}: found that the corrected command would "
                f"be {command[row, k]:.6g} {actuator.reading_unit}, expected it in the joint's range "
                f"[{low:.6g}, {high:.6g}] {actuator.reading_unit}"
            )


def joined(parts: Sequence[Compensation]) -> Compensation:
    """One after the other."""
    names = ("nominal", "command", "target", "before", "after", "not_asked", "eased")
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in names
    }
    return replace(parts[0], **columns)


def twists_between(target: Array, poses: Array) -> Array:
    """(n, 6) twists [mm, rad] from targets to poses (n, 4, 4), told at the target's origin."""
    turn = poses[:, :3, :3] @ target[:, :3, :3].transpose(0, 2, 1)
    twice = [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]
    out = np.column_stack([poses[:, :3, 3] - target[:, :3, 3], *twice])
    sine = np.linalg.norm(out[:, 3:], axis=1) / 2
    small = (sine < 0.5) & (np.trace(turn, axis1=1, axis2=2) > 1.0)  # where its sine tells the angle
    near = np.where(small & (sine > 0), sine, 1.0)
    out[:, 3:] *= np.where(sine > 0, np.arcsin(np.minimum(near, 1.0)) / near, 1.0)[:, None] / 2
    out[~small, 3:] = lie.log_so3(turn[~small])
    return out


def _displaced(poses: Array, twist: Array) -> Array:
    """(n, 4, 4) poses moved by twists (n, 6): p + v, Exp(w) R."""
    out = poses.copy()
    out[:, :3, 3] += twist[:, :3]
    out[:, :3, :3] = lie.exp_so3(twist[:, 3:]) @ poses[:, :3, :3]
    return out


def compensate(machine: Machine, path: Recording, *, method: Method = "exact") -> Compensation:
    """Commands for every row of ``path``, whose readings are nominal; drivers are the path's own.

    Nominal values are those of the file's ``nominal:``. Raises InputError naming the first row that cannot be followed: out of
    reach, or with a joint out of its range.
    """
    if method not in METHODS:
        raise InputError(f"--method: found {method!r}, expected one of {', '.join(METHODS)}")
    follower, rows = _Follower(machine, path), np.arange(len(path))
    parts = np.split(rows, range(BLOCK, len(rows), BLOCK))
    return replace(joined([follower.follow(part, method) for part in parts]), notes=follower.notes)
