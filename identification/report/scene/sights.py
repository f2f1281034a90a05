"""Where each row was measured and by how much a fit misses it there, as points and arrows in the base's frame.

A sensor of points shows where they are itself. Of one that reads lengths, the point is the tool's origin, and the arrow
the shortest displacement of the tool that would explain the residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.machine.sensor import TOOL_IN_WORLD, Sensor

FLAT = 1e-9
"""A direction that changes a reading by less than this share of the most is none."""


@dataclass(frozen=True)
class Sights:
    """Points (n, k, 3), mm, in the base's frame, and arrows (n, k, 3), mm, from where the model has each point to where it was
    measured; NaN where nothing was read. k is 0 for a sensor of angles alone."""

    points: Array
    arrows: Array


def sights(fit: Estimate, recording: Recording) -> Sights:
    """Of a fit in all rows of its recording."""
    machine = fit.nominal
    base = base_pose(fit)
    tool = Predictor(machine, recording, fit.effects).poses(fit.p, fit.x)[0]
    points, arrows, first = [], [], 0
    for sensor in machine.sensors:
        own = slice(first, first + len(sensor.channels))
        first = own.stop
        missed = -fit.residual[:, own] * [channel.sigma for channel in sensor.channels]
        if fit.lost is not None:
            missed = np.where(fit.lost[:, own], np.nan, missed)
        if sensor.view.relative or sensor.joints:  # its readings are in a frame that moves, or in none
            continue
        for place, arrow in _of_sensor(sensor, machine, fit, recording, tool, missed):
            points.append((place - base[:3, 3]) @ base[:3, :3])
            arrows.append(arrow @ base[:3, :3])
    empty = np.zeros((len(recording), 0, 3))
    return Sights(np.stack(points, axis=1), np.stack(arrows, axis=1)) if points else Sights(empty, empty)


def base_pose(fit: Estimate) -> Array:
    """(4, 4) pose of the base in the sensor's frame."""
    values = dict(zip(fit.prior.names, fit.p.tolist(), strict=True))
    numbers = [ca.SX(values[f"base.{axis}"]) for axis in AXES]
    return np.array(ca.evalf(lie.rpy_transform(numbers[:3], numbers[3:])))


def _of_sensor(
    sensor: Sensor, machine: Machine, fit: Estimate, recording: Recording, tool: Array, missed: Array
) -> list[tuple[Array, Array]]:
    """Points (n, 3) of a sensor with their arrows (n, 3), in its frame."""
    out, names = [], [channel.name for channel in sensor.channels]
    spare: list[int] = []
    for at in _points(sensor):
        axes = [names[k] for k in at]
        if len(at) == 3 and all(name in recording.observations for name in axes):
            read = np.column_stack([recording.observations[name] for name in axes])
            lost = np.isnan(read).any(axis=1, keepdims=True)
            out.append((read, np.where(lost, np.nan, missed[:, at])))
        else:
            spare += at
    if spare and sensor.view == TOOL_IN_WORLD:
        slopes = _slopes(sensor, machine, fit, tool)
        if slopes is not None and slopes.shape[1] == len(names):
            out.append((tool[:, :3, 3], _shortest(slopes[:, spare], missed[:, spare])))
    return out


def _points(sensor: Sensor) -> list[list[int]]:
    """Channels of lengths by the point that they are of."""
    groups: dict[str, list[int]] = {}
    for k, channel in enumerate(sensor.channels):
        if channel.unit == "mm":
            groups.setdefault(f"{channel.kind}.{channel.point}", []).append(k)
    return list(groups.values())


def _slopes(sensor: Sensor, machine: Machine, fit: Estimate, tool: Array) -> Array | None:
    """(n, m, 3) change of each predicted column by a displacement of the tool."""
    move = ca.SX.sym("move", 3)
    pose = ca.SX.sym("pose", 4, 4)
    moved = ca.vertcat(ca.horzcat(pose[:3, :3], pose[:3, 3] + move), pose[3, :])
    values = dict(zip(fit.prior.names, fit.p.tolist(), strict=True))
    wanted = [*(p.name for p in sensor.parameters), *sensor.reads]
    if any(name not in values for name in wanted):
        return None
    read = sensor.predict(moved, {name: ca.SX(values[name]) for name in wanted})
    slope = ca.Function("slope", [pose, move], [ca.jacobian(read, move)])
    rows = [np.array(slope(matrix, 0.0)) for matrix in tool]
    return np.array(rows) if rows else None


def _shortest(slopes: Array, missed: Array) -> Array:
    """(n, 3) the shortest displacement that changes the readings (n, m) by what was missed."""
    out = np.full((len(slopes), 3), np.nan)
    for k, (slope, value) in enumerate(zip(slopes, missed, strict=True)):
        if np.isfinite(slope).all() and np.isfinite(value).all():
            out[k] = np.linalg.pinv(slope, rcond=FLAT) @ value
    return out


__all__ = ["Sights", "base_pose", "sights"]
