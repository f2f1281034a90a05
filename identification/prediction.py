"""What a machine's sensors should read for every row of a recording, with exact derivatives.

Closed loops are solved by Newton's method with the exact derivative of the closure; derivatives of the pose
follow from the implicit function theorem, dx/dp = -(dg/dx)^-1 dg/dp, never from differentiating iterations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.codegen.batch import BatchFunction
from truepose.errors import InputError
from truepose.identification.recording import Recording
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect
from truepose.models.kinematics import load_scale, symbolic_model
from truepose.models.machine import Machine
from truepose.models.sensors.base import Channel, Sensor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_MAX_NEWTON = 40
_BLOCK = 1024


@dataclass(frozen=True)
class Block:
    """Some rows: residuals whitened by sigma (n, m) and their derivative (n, m, np) by p at the row itself.

    Where a sensor reads the change since another row, ``before`` is the derivative by p at that row.
    """

    rows: slice
    residual: Array
    here: Array
    before: Array | None

    @property
    def jacobian(self) -> Array:
        """(n, m, np) derivative of the residual by p."""
        return self.here if self.before is None else self.here - self.before


class Predictor:
    """Residuals, poses and loads of one machine with some effects over one recording."""

    def __init__(self, machine: Machine, recording: Recording, effects: Sequence[PlacedEffect] = (), *, ports: bool = False) -> None:
        self.machine, self.recording = machine, recording
        self.model = symbolic_model(machine, effects, ports=ports)
        self.q = recording.q
        self.z = np.empty((len(self.q), len(self.model.drivers)))
        for k, name in enumerate(self.model.drivers):
            recorded = recording.driver(name)
            self.z[:, k] = self.model.z_home[k] if recorded is None else recorded
        m = self.model
        inputs, flat, twist = [m.x, m.q, m.z, m.p], ca.vec(m.world[:3, :]), _twist_rows(m.world)
        self._closure = BatchFunction("closure", inputs, [m.closure, ca.jacobian(m.closure, m.x)])
        self._pose = BatchFunction("pose", inputs, [m.world])
        outputs = [m.world, twist @ ca.jacobian(flat, m.x), twist @ ca.jacobian(flat, m.p)]
        outputs += [ca.jacobian(m.closure, m.x), ca.jacobian(m.closure, m.p)]
        self._kinematics = BatchFunction("kinematics", inputs, outputs)
        self._sensors = [_SensorFunctions(sensor, m.names) for sensor in machine.sensors]

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Residual components of every sensor, in order."""
        return tuple(channel for sensor in self.machine.sensors for channel in sensor.channels)

    def _build(self) -> None:
        m = self.model
        inputs = [m.x, m.q, m.z, m.p]
        self._closure = BatchFunction("closure", inputs, [m.closure, ca.jacobian(m.closure, m.x)])
        twist = twist_rows(m.world)
        flat = ca.vec(m.world[:3, :])
        self._pose = BatchFunction("pose", inputs, [m.world])
        self._kinematics = BatchFunction(
            "kinematics",
            inputs,
            [m.world, twist @ ca.jacobian(flat, m.x), twist @ ca.jacobian(flat, m.p), ca.jacobian(m.closure, m.x), ca.jacobian(m.closure, m.p)],
        )
        self._sensors = [_SensorFunctions(sensor, m.names) for sensor in self.machine.sensors]
        self._readings = [
            np.column_stack([self.recording.readings[c] for c in s.columns]) if all(c in self.recording.readings for c in s.columns) else None
            for s in self.machine.sensors
        ]

    def assemble(self, p: Array, start: Array | None = None) -> tuple[Array, Mask]:
        """Passive coordinates (n, nx) that close the loops, and which rows could be assembled."""
        n, nx = len(self.q), len(self.model.home)
        x = np.tile(self.model.home, (n, 1)) if start is None else start.copy()
        if nx == 0:
            return x, np.ones(n, dtype=bool)
        x, good = self._newton(x, self.q, self.z, p)
        if not good.all():
            bad = np.flatnonzero(~good)
            x[bad], good[bad] = self._continue(bad, p)
        return x, good

    def _newton(self, x: Array, q: Array, z: Array, p: Array) -> tuple[Array, Mask]:
        """Newton's method on every row at once; steps are shortened to a tenth of the machine's size."""
        reach = max(1.0, float(np.max(np.abs(self.model.home))))
        good = np.zeros(len(x), dtype=bool)
        active = np.arange(len(x))
        for _ in range(_MAX_NEWTON):
            g, gx = self._closure(x[active], q[active], z[active], p)
            step = _solve(gx, g)[..., 0]
            size = np.max(np.abs(step), axis=1)
            step *= np.minimum(1.0, 0.2 * reach / np.maximum(size, 1e-300))[:, None]
            x[active] -= step
            done = size < 1e-11 * reach
            good[active[done]] = True
            active = active[~done & np.isfinite(size)]
            if not len(active):
                break
        return x, good

    def _continue(self, rows: NDArray[np.intp], p: Array, steps: int = 8) -> tuple[Array, Mask]:
        """Follow rows from where all readings are zero to where they are."""
        x, z, good = np.tile(self.model.home, (len(rows), 1)), self.z[rows], np.zeros(len(rows), dtype=bool)
        for fraction in np.linspace(0.0, 1.0, steps + 1):
            x, good = self._newton(x, fraction * self.q[rows], z, p)
        return x, good

    def poses(self, p: Array, x: Array | None = None) -> tuple[Array, Mask]:
        """Sensor-frame poses of the tool (n, 4, 4); rows that cannot be assembled are False."""
        good = np.ones(len(self.q), dtype=bool)
        if x is None:
            x, good = self.assemble(p)
        return self._pose(x, self.q, self.z, p)[0], good

    def blocks(self, p: Array, x: Array) -> Iterator[Block]:
        """Whitened residuals and exact Jacobians, some rows at a time, so that memory stays flat."""
        step = len(self.q) if any(s.differs_from_row for s in self.machine.sensors) else _BLOCK
        for start in range(0, len(self.q), max(step, 1)):
            rows = slice(start, min(start + step, len(self.q)))
            pose, twist = self._total(rows, p, x)
            parts = [f.residual(pose, twist, p, self.recording, rows) for f in self._sensors]
            here = np.concatenate([part[1] for part in parts], axis=1)
            earlier = [np.zeros_like(part[1]) if part[2] is None else part[2] for part in parts]
            before = np.concatenate(earlier, axis=1) if any(part[2] is not None for part in parts) else None
            yield Block(rows, np.concatenate([part[0] for part in parts], axis=1), here, before)

    def columns(self, p: Array, x: Array) -> tuple[list[str], Array, Array, Array]:
        """Column names, predicted values (n, k), their Jacobian (n, k, np) and poses (n, 4, 4)."""
        pose, twist = self._total(slice(0, len(self.q)), p, x)
        names = [name for s in self.machine.sensors for name in s.columns]
        parts = [f.prediction(pose, twist, p, self.recording) for f in self._sensors]
        return names, np.hstack([v for v, _ in parts]), np.concatenate([j for _, j in parts], axis=1), pose

    def twists(self, p: Array, x: Array) -> tuple[Array, Array]:
        """Poses (n, 4, 4) and their total derivative by p as world twists (n, 6, np)."""
        return self._total(slice(0, len(self.q)), p, x)

    def loads(self, p: Array, x: Array) -> Array:
        """Gravity's conjugate load at every entry of p (n, np): N along lengths, N m about angles."""
        m = self.model
        gradient = BatchFunction("energy", [m.x, m.q, m.z, m.p], [ca.gradient(m.energy, m.x).T, ca.gradient(m.energy, m.p).T])
        vx, vp = gradient(x, self.q, self.z, p)
        force = -vp[:, 0, :]
        if x.shape[1]:
            _, _, _, gx, gp = self._kinematics(x, self.q, self.z, p)
            multipliers = _solve(gx.transpose(0, 2, 1), vx.transpose(0, 2, 1))[..., 0]
            force += np.einsum("nk,nkp->np", multipliers, gp)
        ports = {*self.machine.geometry, *self.machine.ports}
        return force / np.array([load_scale(self.machine, name) if name in ports else 1.0 for name in m.names])

    def _total(self, rows: slice, p: Array, x: Array) -> tuple[Array, Array]:
        pose, tx, tp, gx, gp = self._kinematics(x[rows], self.q[rows], self.z[rows], p)
        if x.shape[1]:
            tp = tp - tx @ _solve(gx, gp)
        return pose, tp


def _solve(a: Array, b: Array) -> Array:
    """Row-wise solution; rows without one are NaN."""
    try:
        return np.linalg.solve(a, b)
    except np.linalg.LinAlgError:
        out = np.full(b.shape, np.nan)
        for k in range(len(a)):
            if np.isfinite(a[k]).all() and np.linalg.matrix_rank(a[k]) == len(a[k]):
                out[k] = np.linalg.solve(a[k], b[k])
        return out


class _SensorFunctions:
    """One sensor as functions of the pose: residuals whitened by sigma, predictions, and their Jacobians."""

    def __init__(self, sensor: Sensor, names: Sequence[str]) -> None:
        self.sensor = sensor
        own = [parameter.name for parameter in sensor.parameters]
        self._own = np.array([names.index(name) for name in own], dtype=int)
        self._sigma = np.array([channel.sigma for channel in sensor.channels])
        world, small = ca.SX.sym("world", 4, 4), ca.SX.sym("twist", 6)
        s, y = {name: ca.SX.sym(name) for name in own}, ca.SX.sym("y", len(sensor.columns))
        moved = lie.transform(world[:3, :3] + lie.skew(small[3:]) @ world[:3, :3], world[:3, 3] + small[:3])
        constants = ca.vertcat(*s.values()) if s else ca.SX(0, 1)
        predicted, residual = sensor.predict(moved, s), sensor.residual(moved, s, y)
        self._predict = self._function("predict", predicted, world, constants, y, small)
        self._residual = self._function("residual", residual, world, constants, y, small)

    @staticmethod
    def _function(name: str, value: ca.SX, world: ca.SX, constants: ca.SX, y: ca.SX, small: ca.SX) -> BatchFunction:
        outputs = [value, ca.jacobian(value, small), ca.jacobian(value, constants)]
        still = [ca.substitute(output, small, ca.SX.zeros(6)) for output in outputs]
        return BatchFunction(name, [ca.vec(world), constants, y], still)

    def residual(
        self, pose: Array, twist: Array, p: Array, recording: Recording, rows: slice
    ) -> tuple[Array, Array, Array | None]:
        """(n, m) whitened residuals, their (n, m, np) Jacobian at the row and, for a change, at the row before."""
        y = np.column_stack([recording.readings[c][rows] for c in self.sensor.columns])
        value, jacobian = self._evaluate(self._residual, pose, twist, p, y)
        if not self.sensor.differs_from_row:
            return value / self._sigma, jacobian / self._sigma[:, None], None
        before, by_p = self._reference(pose, twist, p, recording)
        return (value - before) / self._sigma, jacobian / self._sigma[:, None], by_p / self._sigma[:, None]

    def prediction(self, pose: Array, twist: Array, p: Array, recording: Recording) -> tuple[Array, Array]:
        """(n, k) column values and their (n, k, np) Jacobian."""
        y = np.zeros((len(pose), len(self.sensor.columns)))
        value, jacobian = self._evaluate(self._predict, pose, twist, p, y)
        if self.sensor.differs_from_row:
            before, by_p = self._reference(pose, twist, p, recording)
            return value - before, jacobian - by_p
        return self.sensor.values(pose, value), jacobian

    def _reference(self, pose: Array, twist: Array, p: Array, recording: Recording) -> tuple[Array, Array]:
        if recording.from_row is None:
            raise InputError(f"{', '.join(recording.files)}: column 'from': found none, expected one for sensor {self.sensor.type}")
        y = np.zeros((len(pose), len(self.sensor.columns)))
        value, jacobian = self._evaluate(self._predict, pose, twist, p, y)
        return value[recording.from_row], jacobian[recording.from_row]

    def _evaluate(self, function: BatchFunction, pose: Array, twist: Array, p: Array, y: Array) -> tuple[Array, Array]:
        flat = pose.transpose(0, 2, 1).reshape(len(pose), 16)
        value, by_twist, by_own = function(flat, p[self._own], y)
        jacobian = by_twist @ twist
        jacobian[:, :, self._own] += by_own
        return value[..., 0], jacobian


def _twist_rows(world: ca.SX) -> ca.SX:
    """(6, 12) map from the derivative of vec([R|p]) to the twist [dp; vee(dR R')]."""
    rows = ca.SX.zeros(6, 12)
    rows[:3, 9:] = ca.SX.eye(3)
    for k in range(3):
        rows[3:, 3 * k : 3 * k + 3] = 0.5 * lie.skew(world[:3, k])
    return rows
