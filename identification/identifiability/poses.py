"""Poses to look at: drawn over the joints' ranges or recorded, with readings or without, and what they see."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.fit.leastsquares import triangular
from truepose.identification.fit.problem import Prior
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.couplings import coupling_matrix
from truepose.models.machine.machine import Machine

SEED = 20


def drawn_poses(machine: Machine, n: int, seed: int = SEED) -> Recording:
    """``n`` configurations drawn evenly over the joints' ranges; changes count from the first one.

    Raises InputError naming the joint that has no range, and for a sensor that compares rows by labels.
    """
    ranges = []
    for actuator in machine.mechanism.actuators:
        if actuator.reading_range is None or not np.isfinite(actuator.reading_range).all():
            raise InputError(
                f"{machine.name}: joint {actuator.reading}: found no range to draw poses from, expected "
                "'range: [low, high]', or a file of poses"
            )
        ranges.append(actuator.reading_range)
    for sensor in machine.sensors:
        if sensor.label_columns:
            raise InputError(
                f"{machine.name}: poses cannot be drawn for a sensor that needs the columns "
                f"{', '.join(sensor.label_columns)}; expected a file of poses"
            )
    low, high = np.array(ranges, dtype=float).T
    q = low + (high - low) * np.random.default_rng(seed).random((n, len(low)))
    return Recording(
        joints=machine.mechanism.readings,
        uncoupling=coupling_matrix(machine.mechanism),
        q=q,
        observations={},
        labels={},
        drivers={},
        files=("drawn poses",),
        source_file=np.zeros(n, dtype=np.int64),
        source_row=np.arange(1, n + 1),
        session=np.ones(n, dtype=np.int64),
        session_recorded=np.zeros(n, dtype=np.bool_),
        validation=np.zeros(n, dtype=np.bool_),
        pose=np.arange(1, n + 1),
        from_row=np.zeros(n, dtype=np.int64),
        shuffled=True,
    )


def measured(machine: Machine, recording: Recording) -> bool:
    """Whether every column of every sensor was recorded."""
    return all(name in recording.observations for sensor in machine.sensors for name in sensor.columns)


def with_observations(machine: Machine, recording: Recording) -> Predictor:
    """A predictor whose recording has readings: where some are missing, what the sensors should have read."""
    predictor = Predictor(machine, recording, machine.effects)
    if measured(machine, recording):
        return predictor
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    x[~good] = predictor.model.home
    names, values, _ = predictor.values(p, x)
    read = dict(zip(names, np.where(good[:, None], values, 0.0).T, strict=True))
    complete = copy.copy(predictor)
    complete.recording = replace(recording, observations={**recording.observations, **read})
    return complete


@dataclass(frozen=True)
class Seen:
    """Triangular factor (n_free, n_free) of the scaled Jacobian, rows (n,) that are in it, how many readings
    say anything."""

    factor: Array
    used: Mask
    n_observations: int

    @classmethod
    def at(cls, predictor: Predictor, prior: Prior, p: Array) -> Seen:
        """At parameters ``p`` (np,)."""
        x, good = predictor.assemble(p)
        used = good & ~predictor.recording.validation
        free, count = prior.free, 0

        def rows() -> Iterator[Array]:
            nonlocal count
            for block in predictor.blocks(p, x, used):
                jacobian = block.jacobian[used[block.rows]][:, :, free] * prior.scale[free]
                flat = jacobian.reshape(-1, len(free))
                count += int(np.sum(np.any(flat != 0.0, axis=1)))
                yield flat

        return cls(triangular(rows(), len(free)), used, count)
