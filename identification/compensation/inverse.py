"""Joints that put the tool at given poses: damped Newton on many poses at once, any mechanism.

Use ``inverse`` for one call, ``PoseSolver`` where the same machine is asked again. Readings and the passive
coordinates of closed loops are solved for together, with the exact derivative of pose and closure, so that all
constants of the machine (and its effects) are in the answer: the IGM "with all intrinsic parameters" of the
nanopositioner paper (section V-B), which has no closed form.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum

import casadi as ca
import numpy as np
from scipy.stats.qmc import Halton

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.errors import InputError
from truepose.identification.prediction.loops import Loops
from truepose.models import lie
from truepose.models.machine.closure import coordinate_scale
from truepose.models.machine.controllability import task_of
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine, MachineLike, as_machine
from truepose.models.machine.mechanism import turns_freely
from truepose.models.task import Task
from truepose.shown.result import Shown


def base_frame(machine: Machine) -> Array:
    """(4, 4) nominal frame of the base in the sensor's frame, as calibrated: what the C's poses leave out."""
    value = {parameter.name: parameter.nominal for parameter in machine.frames}
    xyz, rpy = ([value[f"base.{of}{axis}"] for axis in "xyz"] for of in ("", "r"))
    return lie.pose_of(lie.rpy_matrix(rpy), xyz)


System = Callable[[Array, Index], tuple[Array, Array]]
"""Unknowns (k, nu) of the rows named (k,) to residuals (k, m) and their derivative (k, m, nu), all scaled."""
MET = 1e-9
"""Gap at which a pose counts as met: parts of the machine's size, and rad."""
LIMIT = 100
RESTARTS = 8
_SETTLED, _FLAT = 1e-13, 1e-8
_LEAST_DAMPING, _MOST_DAMPING = 1e-14, 1e8
_ROTATION_ERROR = 1e-6
_GRAVITY = (0.0, 0.0, -9.80665)


class Reach(IntEnum):
    """How a pose ended; the numbers are those of the generated C."""

    SOLVED = 0
    UNREACHABLE = 1
    ITERATION_LIMIT = 2
    JOINT_RANGE = 3


@dataclass(frozen=True, repr=False)
class Inverse(Shown):
    """Readings q (n, nq) and passive coordinates x (n, nx) for n poses; ``status`` (n,) holds ``Reach`` numbers.

    ``position`` (n,) mm and ``rotation`` (n,) rad are what is left to the pose, in the components of the task. Where
    joints would have to leave their range q is what it would take, and ``beyond`` (n, nq) says which; where the pose is
    out of reach q is the nearest found.
    ``to_frame()``: one row for each pose: the joints (mm, rad or the column's own unit), ``status``, and what is left to
    the pose in ``position`` (mm) and ``rotation`` (rad).
    """

    readings: tuple[str, ...]
    q: Array
    x: Array
    position: Array
    rotation: Array
    status: Index
    beyond: Mask

    @property
    def solved(self) -> Mask:
        """(n,) poses met with every joint in its range."""
        return np.asarray(self.status == Reach.SOLVED)

    def saturated(self, row: int) -> tuple[str, ...]:
        """Joints that the pose of a row asks to leave their range."""
        return tuple(name for name, out in zip(self.readings, self.beyond[row], strict=True) if out)


def inverse(machine: MachineLike, poses: Array, start: Array | None = None) -> Inverse:
    """Readings that put the tool at sensor-frame ``poses`` (n, 4, 4), mm, from ``start`` (nq,) or (n, nq).

    A redundant mechanism is given the solution that its start leads to. Raises InputError for what is no pose.
    """
    machine = as_machine(machine)
    return PoseSolver(machine).inverse(poses, start)


class PoseSolver:
    """Forward and inverse kinematics of one machine with the effects of its file, many rows at once.

    A pose is met in the components of ``task``: by default the file's, or what the readings can hold (``controllability``).
    ``p`` (np,) are parameters, then effect coefficients (default: the machine's own); drivers have their usual values.
    """

    def __init__(self, machine: Machine, p: Array | None = None, task: Task | None = None) -> None:
        model = self.model = symbolic_model(machine, machine.effects)
        self.machine = machine
        self.p = model.p_home if p is None else np.asarray(p, dtype=float)
        self.z = model.z_home
        self.size, self._gap = sizes_of(machine, model)
        share, unit = loop_scales(machine, model, self.size)
        readings = [self.size if a.reading_unit == "mm" else 1.0 for a in machine.mechanism.actuators]
        self._unit = np.array([*readings, *unit])
        self._pose = BatchFunction("pose", [model.q, model.x, model.z, model.p], [model.world])
        self.task = task_of(model) if task is None else task
        self._to_pose = pose_gap(model, self.task, self.size, share)
        self._loops = Loops(model)

    def forward(self, q: Array) -> tuple[Array, Mask]:
        """Sensor-frame poses (n, 4, 4) of the tool at readings (n, nq), and where loops could be closed."""
        q = np.atleast_2d(np.asarray(q, dtype=float))
        z = np.tile(self.z, (len(q), 1))
        x, good = self._loops.assemble(q, z, self.p)
        return self._pose(q, x, z, self.p)[0], good

    def inverse(
        self, poses: Array, start: Array | None = None, *, restarts: int = RESTARTS, rewind: bool = True
    ) -> Inverse:
        """Readings for sensor-frame ``poses`` (n, 4, 4), from ``start`` (nq,) or (n, nq), by default home.

        Poses not met are tried again from ``restarts`` readings spread over the ranges; 0 keeps to the assembly
        that the start leads to. ``rewind`` brings joints by whole turns next to the middle of their ranges; without it
        they stay on the turn of their start. Raises InputError for what is no pose.
        """
        poses = _checked(poses)
        given = self.model.q_home if start is None else np.asarray(start, dtype=float)
        best = self._attempt(poses, np.broadcast_to(given, (len(poses), len(self.model.readings))), rewind)
        for other in self._spread(restarts):
            left = np.flatnonzero(~best.solved)
            if not len(left):
                break
            again = self._attempt(poses[left], np.tile(other, (len(left), 1)), rewind)
            best = _better(best, again, left, self.size)
        return best

    def _attempt(self, poses: Array, start: Array, rewind: bool) -> Inverse:
        flat = poses.transpose(0, 2, 1).reshape(len(poses), 16)
        nq, unit = start.shape[1], self._unit

        def system(u: Array, rows: Index) -> tuple[Array, Array]:
            at = u * unit
            gap, slope = self._to_pose(at[:, :nq], at[:, nq:], self.z, self.p, flat[rows])
            return gap[..., 0], slope * unit

        x = np.broadcast_to(self.model.home, (len(poses), len(self.model.home)))
        u, gap, settled = _damped_newton(system, np.hstack([start, x]) / unit)
        q, x = u[:, :nq] * unit[:nq], u[:, nq:] * unit[nq:]
        q = self._wrapped(q) if rewind else q
        position, rotation, closure = np.split(np.abs(gap), [3, 6], axis=1)
        closed = np.max(closure, axis=1, initial=0.0) * self.size <= self._gap
        met = closed & (np.max(position, axis=1) <= MET) & (np.max(rotation, axis=1) <= MET)
        beyond = ~in_ranges(self.machine, q) & met[:, None]
        status = np.where(settled, Reach.UNREACHABLE, Reach.ITERATION_LIMIT)
        status = np.where(met, np.where(beyond.any(axis=1), Reach.JOINT_RANGE, Reach.SOLVED), status)
        left = np.linalg.norm(position, axis=1) * self.size, np.linalg.norm(rotation, axis=1)
        return Inverse(self.model.readings, q, x, *left, status, beyond)

    def _spread(self, count: int) -> Array:
        """(count, nq) readings that fill the ranges evenly; where none is stated, half a turn or the size."""
        widest = [self.size if a.reading_unit == "mm" else np.pi for a in self.machine.mechanism.actuators]
        ranges = [a.range or (-w, w) for a, w in zip(self.machine.mechanism.actuators, widest, strict=True)]
        low, high = np.array(ranges, dtype=float).T
        share: Array = Halton(len(low), scramble=False).random(count + 1)[1:]
        return np.asarray(low + share * (high - low))

    def _wrapped(self, q: Array) -> Array:
        """Readings in rad brought by whole turns next to the middle of their range."""
        out = q.copy()
        for k, actuator in enumerate(self.machine.mechanism.actuators):
            if turns_freely(self.machine.mechanism, actuator.reading) and actuator.range is not None:
                out[:, k] -= 2 * np.pi * np.round((q[:, k] - np.mean(actuator.range)) / (2 * np.pi))
        return out


def in_ranges(machine: Machine, q: Array) -> Mask:
    """Return which readings (n, nq) are in their joints' ranges, but for rounding; of nan none is."""
    low, high = np.array([a.range or (-np.inf, np.inf) for a in machine.mechanism.actuators]).T
    slack = MET * np.where(np.isfinite(high - low), high - low, 0.0)
    return np.asarray((q >= low - slack) & (q <= high + slack))


def sizes_of(machine: Machine, model: SymbolicModel) -> tuple[float, float]:
    """Return the size of a machine, and the largest gap of closed loops, mm."""
    scale = coordinate_scale(machine, len(model.home), model.gap.numel())
    size = max([1.0, *(abs(p.nominal) for p in machine.parameters if p.unit == "mm"), *scale.size])
    return size, scale.gap if np.isfinite(scale.gap) else MET * size


def loop_scales(machine: Machine, model: SymbolicModel, size: float) -> tuple[Array, Array]:
    """Factors (ne,) that make the loops' equations parts of ``size`` (mm), and units (nx,) of their unknowns: mm, rad, N.

    Leg forces, and what they balance, count in parts of the machine's weight: in N and N mm they would hide the lengths.
    """
    scale = coordinate_scale(machine, len(model.home), model.gap.numel())
    share, unit = np.full(model.equations.numel(), 1.0 / size), scale.size.copy()
    forces = int(np.sum(np.isinf(scale.limit)))
    if forces:  # their balance has a row for each coordinate
        gravity = machine.gravity or _GRAVITY
        weight = max(1.0, sum(mass.kg for mass in machine.masses)) * float(np.linalg.norm(gravity))
        unit[-forces:] = weight
        share[-forces:] *= scale.size[:forces] / weight
    return share, unit


def pose_gap(model: SymbolicModel, task: Task, size: float, share: Array, rows: int = 0) -> BatchFunction:
    """What is left to a pose and to closed loops, (3 + 3 + nc, 1) in parts of ``size`` and rad, with its derivative.

    What the task does not ask for is zero. ``share`` (nc,) is what the loops' equations are multiplied by.
    """
    goal, unknown = ca.SX.sym("goal", 4, 4), ca.vertcat(model.q, model.x)
    left = task.gap(goal, model.world, ca.SX(base_frame(model.machine)[:3, :3]))
    gap = ca.vertcat(left[:3] / size, left[3:], model.equations * share)
    inputs = [model.q, model.x, model.z, model.p, ca.vec(goal)]
    return BatchFunction("gap", inputs, [gap, ca.jacobian(gap, unknown)], rows=rows)


def _better(best: Inverse, again: Inverse, rows: Index, size: float) -> Inverse:
    """``best`` with those of ``rows`` replaced that came out better: met, then in range, then nearer."""

    def rank(found: Inverse) -> Array:
        away = found.position + size * found.rotation
        return np.where(found.solved, -2.0, np.where(found.status == Reach.JOINT_RANGE, -1.0, away))

    better = rank(again) < rank(best)[rows]
    out = {}
    for name in ("q", "x", "position", "rotation", "status", "beyond"):
        out[name] = getattr(best, name).copy()
        out[name][rows[better]] = getattr(again, name)[better]
    return replace(best, **out)


def _checked(poses: Array) -> Array:
    poses = np.asarray(poses, dtype=float)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise InputError(f"poses: found shape {poses.shape}, expected (n, 4, 4)")
    finite: Mask = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    turn = np.where(finite[:, None, None], poses, np.eye(4))[:, :3, :3]
    error = np.max(np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)), axis=(1, 2), initial=0.0)
    bad = ~finite | (error > _ROTATION_ERROR) | (np.linalg.det(turn) < 0)
    if bad.any():
        raise InputError(f"poses[{int(np.argmax(bad))}]: found no rigid motion, expected a rotation and mm")
    return poses


def _damped_newton(system: System, start: Array) -> tuple[Array, Array, Mask]:
    """Unknowns (n, nu) that bring the residuals nearest to zero, the residuals (n, m), and which rows settled.

    Levenberg-Marquardt row by row: each row has its own damping, all rows share the evaluations.
    """
    u = start.copy()
    rows = np.arange(len(u))
    r, slope = system(u, rows)
    cost = np.sum(r**2, axis=1)
    damping, settled = np.full(len(u), 1e-3), np.zeros(len(u), dtype=bool)
    for _ in range(LIMIT):
        if not len(rows):
            break
        step = _step(slope[rows], r[rows], damping[rows])
        trial, by_u = system(u[rows] + step, rows)
        after = np.sum(trial**2, axis=1)
        better = after < cost[rows]
        flat = better & (after > (1 - _FLAT) * cost[rows])  # nearest, and not met: that converges slowly
        linear = np.sum((r[rows] + np.einsum("nij,nj->ni", slope[rows], step)) ** 2, axis=1)
        gain = np.clip((cost[rows] - after) / np.maximum(cost[rows] - linear, 1e-300), -1.0, 2.0)
        small = np.max(np.abs(step), axis=1) < _SETTLED * (1 + np.max(np.abs(u[rows]), axis=1))
        kept = rows[better]
        u[kept] += step[better]
        r[kept], slope[kept], cost[kept] = trial[better], by_u[better], after[better]
        factor = np.where(better, np.clip(1 - (2 * gain - 1) ** 3, 0.01, 2.0), 10.0)
        damping[rows] = np.maximum(factor * damping[rows], _LEAST_DAMPING)
        settled[rows] = small | flat | (damping[rows] > _MOST_DAMPING)
        rows = rows[~settled[rows]]
    return u, r, settled


def _step(slope: Array, r: Array, damping: Array) -> Array:
    """(n, nu) damped Gauss-Newton steps by QR of [J; sqrt(damping) I]: conditioning is not squared."""
    n, _, nu = slope.shape
    below = np.sqrt(damping)[:, None, None] * np.eye(nu)
    q, triangle = np.linalg.qr(np.concatenate([slope, below], axis=1))
    right = np.concatenate([r, np.zeros((n, nu))], axis=1)
    projected = np.einsum("nij,ni->nj", q, right)
    out: Array = np.linalg.solve(triangle, projected[..., None])[..., 0]
    return -out
