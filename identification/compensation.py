"""Commands that make the real machine follow a path: what the drawing says would happen, made to happen.

The target of a row is where nominal joints and links, with the calibrated tool frame, put the tool. ``exact`` solves
the calibrated machine, with its effects, for the readings that put it there. ``first-order`` is the way of Huang et
al. (2019), eq. (16) and Fig. 4, for controllers that know the nominal inverse kinematics only: the predicted pose
error, B times the errors of the parameters, is taken off the target, and the nominal machine is solved for that. It
leaves what is of second order in the errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.codegen.batch import BatchFunction
from truepose.errors import InputError
from truepose.identification.inverse import MET
from truepose.identification.predict import predictor_for
from truepose.identification.recording import Recording
from truepose.models import lie
from truepose.models.home import coordinate_scale
from truepose.models.kinematics import SymbolicModel
from truepose.models.machine import Machine

Array = NDArray[np.float64]
Method = Literal["exact", "first-order"]
METHODS: tuple[Method, ...] = ("exact", "first-order")
_BLOCK = 8192
_NEWTON = 30
_SETTLED = 1e-13
_LONGEST = 0.1
"""Longest step of an unknown: part of the machine's size, or rad."""


@dataclass(frozen=True)
class Compensation:
    """Readings ``command`` (n, nq) for the path's ``nominal`` ones, in mm and rad (or the column's own unit).

    target (n, 4, 4): the sensor-frame poses that are meant. before, after (n, 6): twists [mm, rad] from the target to
    where the calibrated machine stands with nominal commands, and with the corrected ones.
    """

    readings: tuple[str, ...]
    nominal: Array
    command: Array
    target: Array
    before: Array
    after: Array


def compensate(machine: Machine, path: Recording, *, method: Method = "exact") -> Compensation:
    """Commands for every row of ``path``, whose readings are nominal; drivers are the path's own.

    Nominal values are those of the file's ``nominal:``. Raises InputError naming the first row that cannot be
    followed: out of reach, or with a joint out of its range.
    """
    if method not in METHODS:
        raise InputError(f"--method: found {method!r}, expected one of {', '.join(METHODS)}")
    follower = _Follower(machine, path)
    parts = [
        follower.follow(slice(start, start + _BLOCK), method) for start in range(0, max(len(path), 1), _BLOCK)
    ]
    joined = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("nominal", "command", "target", "before", "after")
    )
    return Compensation(machine.mechanism.readings, *joined)


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
    """One machine along one path, some rows at a time, so that memory stays flat."""

    def __init__(self, machine: Machine, path: Recording) -> None:
        # no reading is looked at: a sensor that counts changes may count them from any row
        self._predictor = predictor_for(machine, replace(path, from_row=np.arange(len(path))))
        self._machine, self._path, self._z = machine, path, self._predictor.z
        model = self._predictor.model
        self._real, self._ideal = model.p_home, ideal_constants(machine, model)
        scale = coordinate_scale(machine, len(model.home), model.gap.numel())
        lengths = [abs(p.nominal) for p in machine.parameters if p.unit == "mm"]
        self._size = max([1.0, *lengths, *scale.size])
        units = [a.reading_unit for a in machine.mechanism.actuators]
        self._unit = np.array([self._size if unit == "mm" else 1.0 for unit in units] + [*scale.size])
        self._closed = max(scale.gap if np.isfinite(scale.gap) else 0.0, MET * self._size)
        self._gap = _gap_of(model, self._size)

    def follow(self, rows: slice, method: Method) -> Compensation:
        """Rows of the path, from their own readings: corrections are small."""
        predictor, q = self._predictor, self._path.q[rows]
        predictor.q, predictor.z = q, self._z[rows]
        x = self._assembled(self._ideal, rows)
        if method == "exact":
            target, _ = predictor.poses(self._ideal, x)
            command = self._readings(rows, target, self._real, x)
        else:
            target, twist = predictor.twists(self._ideal, x)
            aim = _displaced(target, twist @ (self._ideal - self._real))
            command = self._readings(rows, aim, self._ideal, x)
        self._check_ranges(command, rows)
        before = self._errors(target, rows)
        predictor.q = command
        return Compensation(predictor.model.readings, q, command, target, before, self._errors(target, rows))

    def _readings(self, block: slice, target: Array, p: Array, x: Array) -> Array:
        """(n, nq) readings that put the tool of constants ``p`` at ``target`` (n, 4, 4): Newton, all rows at once."""
        q, z = self._path.q[block], self._z[block]
        nq = q.shape[1]
        u = np.hstack([q, x]) / self._unit
        goal = target.transpose(0, 2, 1).reshape(len(target), 16)
        rows, left = np.arange(len(u)), np.full((len(u), 3), np.inf)
        for _ in range(_NEWTON):
            at = u[rows] * self._unit
            gap, slope = self._gap(at[:, :nq], at[:, nq:], z[rows], p, goal[rows])
            step = _least(slope * self._unit, gap[..., 0])
            step /= np.maximum(1.0, np.max(np.abs(step), axis=1, keepdims=True) / _LONGEST)
            u[rows] -= step
            parts = np.split(np.abs(gap[..., 0]), [3, 6], axis=1)
            left[rows] = np.column_stack([np.max(part, axis=1, initial=0.0) for part in parts])
            rows = rows[~(np.max(np.abs(step), axis=1) < _SETTLED * (1 + np.max(np.abs(u[rows]), axis=1)))]
            if not len(rows):
                break
        self._check_met(left * np.array([self._size, 1.0, self._size]), block)
        out: Array = u[:, :nq] * self._unit[:nq]
        return out

    def _assembled(self, p: Array, rows: slice) -> Array:
        x, good = self._predictor.assemble(p)
        if not good.all():
            row = self._where(rows, int(np.argmin(good)))
            raise InputError(f"{row}: the mechanism cannot be assembled there; mend or drop the row")
        return x

    def _errors(self, target: Array, rows: slice) -> Array:
        """(n, 6) twists from the target to where the calibrated machine puts the tool."""
        poses, _ = self._predictor.poses(self._real, self._assembled(self._real, rows))
        turned = lie.log_so3(poses[:, :3, :3] @ target[:, :3, :3].transpose(0, 2, 1))
        return np.hstack([poses[:, :3, 3] - target[:, :3, 3], turned])

    def _where(self, rows: slice, row: int) -> str:
        return self._path.where(rows.start + row)

    def _check_met(self, left: Array, rows: slice) -> None:
        """Refuse rows whose pose is not met, or whose loops are not closed: (n, 3) mm, rad, mm."""
        met = (left[:, 0] <= MET * self._size) & (left[:, 1] <= MET) & (left[:, 2] <= self._closed)
        if not met.all():
            row = int(np.argmin(met))
            raise InputError(
                f"{self._where(rows, row)}: found no readings that put the tool where the path asks "
                f"({left[row, 0]:.3g} mm and {left[row, 1]:.3g} rad are left), expected a pose within reach"
            )

    def _check_ranges(self, command: Array, rows: slice) -> None:
        for k, actuator in enumerate(self._machine.mechanism.actuators):
            low, high = actuator.range or (-np.inf, np.inf)
            slack = MET * (high - low) if np.isfinite(high - low) else 0.0
            out = (command[:, k] < low - slack) | (command[:, k] > high + slack)
            if out.any():
                row = int(np.argmax(out))
                raise InputError(
                    f"{self._where(rows, row)}, column {actuator.reading!r}: found that the corrected command would "
                    f"be {command[row, k]:.6g} {actuator.reading_unit}, expected it in the joint's range "
                    f"[{low:.6g}, {high:.6g}] {actuator.reading_unit}"
                )


def _gap_of(model: SymbolicModel, size: float) -> BatchFunction:
    """What is left to a pose and to closed loops, (3 + 3 + nc, 1) in parts of ``size`` and rad, with its derivative."""
    goal, unknown = ca.SX.sym("goal", 4, 4), ca.vertcat(model.q, model.x)
    place = (model.world[:3, 3] - goal[:3, 3]) / size
    turn = lie.log_so3_sx(model.world[:3, :3] @ goal[:3, :3].T)
    gap = ca.vertcat(place, turn, model.equations / size)
    inputs = [model.q, model.x, model.z, model.p, ca.vec(goal)]
    return BatchFunction("gap", inputs, [gap, ca.jacobian(gap, unknown)])


def _least(slope: Array, gap: Array) -> Array:
    """(n, nu) steps: the smallest of the least-squares ones where unknowns and equations differ in number."""
    if slope.shape[1] == slope.shape[2]:
        try:
            return np.asarray(np.linalg.solve(slope, gap[..., None]))[..., 0]
        except np.linalg.LinAlgError:
            pass
    out: Array = (np.linalg.pinv(slope) @ gap[..., None])[..., 0]
    return out


def _displaced(poses: Array, twist: Array) -> Array:
    """(n, 4, 4) poses moved by twists (n, 6): p + v, Exp(w) R."""
    out = poses.copy()
    out[:, :3, 3] += twist[:, :3]
    out[:, :3, :3] = lie.exp_so3(twist[:, 3:]) @ poses[:, :3, :3]
    return out


__all__ = ["METHODS", "Compensation", "Method", "compensate", "ideal_constants"]
