"""Readings that were lost: which channels of which rows they take with them.

A lost reading is NaN in the recording. A channel that depends on it reads nothing in that row: its residual and all its
derivatives are zero, as are those of a row that reads its change since itself, so that sums need not know of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Sensor


def all_lost(machine: Machine, parts: Sequence[Mask | None], rows: int) -> Mask | None:
    """(rows, m) where a channel reads nothing, from those of every sensor; None where no reading was lost."""
    if all(part is None for part in parts):
        return None
    sizes = [len(sensor.channels) for sensor in machine.sensors]
    empty = (np.zeros((rows, size), dtype=np.bool_) for size in sizes)
    return np.hstack([none if part is None else part for part, none in zip(parts, empty, strict=True)])


def told(residual: Array, lost: Mask | None) -> Array:
    """(n,) how many channels of each row read something, at least one; ``residual`` (n, m)."""
    rows, channels = residual.shape
    return np.full(rows, float(channels)) if lost is None else np.maximum(channels - lost.sum(axis=1), 1.0)


def lost_of(sensor: Sensor, recording: Recording) -> Mask | None:
    """(n, m) the same of one sensor; None where it lost nothing, or its columns are not there."""
    if not sensor.columns or any(name not in recording.observations for name in sensor.columns):
        return None
    gone = np.column_stack([np.isnan(recording.observations[name]) for name in sensor.columns])
    return gone @ _depends(sensor).T if gone.any() else None


def _depends(sensor: Sensor) -> Mask:
    """(m, k) whether each channel depends on each column: all turns of a pose depend on all of its rotation vector."""
    count = len(sensor.columns)
    if sensor.compares:  # readings are taken off one by one
        return np.eye(count, dtype=np.bool_)
    world, reading = ca.SX.sym("world", 4, 4), ca.SX.sym("reading", count)
    names = [*(parameter.name for parameter in sensor.parameters), *sensor.reads]
    residual = sensor.residual(world, {name: ca.SX.sym(name) for name in names}, reading)
    pattern = ca.jacobian(residual, reading).sparsity()
    return np.asarray(ca.DM(pattern, 1.0).full() != 0, dtype=np.bool_)
