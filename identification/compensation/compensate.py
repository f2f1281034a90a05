"""Commands that make the real machine follow a path: what the drawing says would happen, made to happen.

The target of a row is where nominal joints and links, with the calibrated tool frame, put the tool. ``exact`` solves
the calibrated machine, with its effects, for the readings that put it there. ``first-order`` is the way of Huang et
al. (2019), eq. (16) and Fig. 4, for controllers that know the nominal inverse kinematics only: the predicted pose
error, B times the errors of the parameters, is taken off the target, and the nominal machine is solved for that. It
leaves what is of second order in the errors.

Long paths go through the machine's generated C, compiled on the spot (``compiled``); the rest, and the rows
that the C leaves, go through Newton's method in numpy, on all rows at once (``rows``).

Index of a path solved in numpy, for any machine: Newton's method on all rows at once, and what is refused.

Use ``compensation.compensate``; this is the half of it that needs no compiler.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.compiled import NotCompiledError
from truepose.errors import InputError
from truepose.identification.compensation.inverse import (
    MET,
    CompiledKinematics,
    base_frame,
    in_ranges,
    loop_scales,
    pose_gap,
    shared_out,
)
from truepose.identification.compensation.singular import Easing, Problem, solve_rows
from truepose.identification.prediction.predict import predictor_for
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.file.driver import STEP, Driver
from truepose.models.machine.closure import coordinate_scale
from truepose.models.machine.controllability import free_joints, task_of
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.machine import Machine
from truepose.models.task import WHOLE, Task
from truepose.shown.result import Shown, frame

if TYPE_CHECKING:
    import pandas as pd

Method = Literal["exact", "first-order"]
BLOCK = 8192
"""Rows that are solved together."""


@dataclass(frozen=True, repr=False)
class Compensation(Shown):
    """Readings ``command`` (n, nq) for the path's ``nominal`` ones, in mm and rad (or the column's own unit).

    target (n, 4, 4): the sensor-frame poses that are meant. before, after (n, 6): twists [mm, rad] from the target to
    where the calibrated machine stands with nominal commands, and with the corrected ones; of them what ``task`` asks for.
    not_asked (n, 6): the rest of the twist with the corrected commands. eased (n,): rows next to a singular pose, where a turn
    would make a joint swing; there the position is met, and turns nearly. ``solved_by`` says how.
    """

    readings: tuple[str, ...]
    nominal: Array
    command: Array
    target: Array
    before: Array
    after: Array
    solved_by: str = "numpy"
    task: Task = WHOLE
    not_asked: Array = field(default_factory=lambda: np.zeros((0, 6)))
    eased: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def to_frame(self) -> pd.DataFrame:
        """Commands, one row for each of the path: the joints, ``<joint>.nominal``, then ``before.position``,
        ``before.rotation``, ``after.position``, ``after.rotation`` (errors, mm and rad).
        """
        return frame(self)


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


class Follower:
    """One machine along one path, some rows at a time, so that memory stays flat.

    ``real``, ``ideal`` (np,): constants of the machine, and those that the path's readings mean. ``z`` (n, nz) drivers,
    ``size`` of the machine in mm.
    """

    def __init__(self, machine: Machine, path: Recording) -> None:
        # no reading is looked at: a sensor that counts changes may count them from any row
        self._predictor = predictor_for(machine, replace(path, from_row=np.arange(len(path))))
        self._predictor.origin = None
        self._machine, self._path, self.z = machine, path, self._predictor.z
        model = self._predictor.model
        # a tool that follows a path is not read before it stands: early readings are no errors of it
        self.z[:, [Driver.of(name).kind == STEP for name in model.drivers]] = 0.0
        self.real, self.ideal = model.p_home, ideal_constants(machine, model)
        scale = coordinate_scale(machine, len(model.home), model.gap.numel())
        lengths = [abs(p.nominal) for p in machine.parameters if p.unit == "mm"]
        self.size = max([1.0, *lengths, *scale.size])
        share, unknown = loop_scales(machine, model, self.size)
        self._unit = np.array([*self.reach, *unknown])
        self._closed = max(scale.gap if np.isfinite(scale.gap) else 0.0, MET * self.size)
        self.task = task_of(model)
        self._base = base_frame(machine)[:3, :3]
        self._gap = pose_gap(model, self.task, self.size, share)
        free = free_joints(model, self.task)
        self._easing = Easing(self._gap, self.task, free) if free else None

    @property
    def swings(self) -> bool:
        """True if a joint may have to swing for a turn of the tool, next to a singular pose."""
        return self._easing is not None

    @property
    def reach(self) -> Array:
        """(nq,) readings that move their joint by the machine's size, or by 1 rad."""
        values = self._machine.geometry
        gains = [values[a.gain].nominal if a.gain else 1.0 for a in self._machine.mechanism.actuators]
        units = [a.unit for a in self._machine.mechanism.actuators]
        return np.array([self.size if unit == "mm" else 1.0 for unit in units]) / np.abs(gains)

    @property
    def nominal(self) -> Array:
        """(n, nq) the path's own readings."""
        return self._path.q

    @property
    def readings(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self._machine.mechanism.readings

    def by_numpy(self, rows: Index, method: Method) -> Compensation:
        """Index (k,) of the path, ascending; the first of them that cannot be followed is refused (InputError)."""
        # the same blocks whatever rows are asked for, so that the same row is named
        ends = np.flatnonzero(np.diff(rows // BLOCK)) + 1
        return joined([self._follow(part, method) for part in np.split(rows, ends)])

    def targets(self, rows: Index) -> Array:
        """(k, 4, 4) sensor-frame poses that rows (k,) mean."""
        self._predictor.q, self._predictor.z = self._path.q[rows], self.z[rows]
        return self._predictor.poses(self.ideal, self._assembled(self.ideal, rows))[0]

    def within(self, command: Array) -> Mask:
        """(n, nq) commands in their joints' ranges."""
        return in_ranges(self._machine, command)

    def _follow(self, rows: Index, method: Method) -> Compensation:
        """Index of the path, from their own readings: corrections are small."""
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
        known = self.readings, q, command, target, before, after
        return Compensation(*known, task=self.task, not_asked=not_asked, eased=eased)

    def _readings(self, block: Index, target: Array, p: Array, x: Array) -> tuple[Array, Mask]:
        """(n, nq) readings that put the tool of constants ``p`` at ``target`` (n, 4, 4), and which meet turns nearly."""
        problem, nq = self._problem(block, target, p, x), len(self.readings)
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

    def split(self, target: Array, poses: Array) -> tuple[Array, Array]:
        """Return twists (n, 6) from sensor-frame targets to poses (n, 4, 4): what the task asks for, and the rest."""
        twists = twists_between(target, poses)
        asked = self.task.counted(twists, target, self._base)
        return asked, twists - asked

    def _errors(self, target: Array, rows: Index) -> tuple[Array, Array]:
        """Return the twists from the target to where the calibrated machine puts the tool, split by the task."""
        poses, _ = self._predictor.poses(self.real, self._assembled(self.real, rows))
        return self.split(target, poses)

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
        for k, (actuator, within) in enumerate(
            zip(self._machine.mechanism.actuators, self.within(command).T, strict=True)
        ):
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


METHODS: tuple[Method, ...] = ("exact", "first-order")
COMPILED_FROM = 20_000
"""Rows from which a path repays the compiler."""
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
