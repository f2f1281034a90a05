"""A recording as the machine would give it: its own effects, some more, and the sensor's noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.prediction.predict import predicted, predictor_for
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine
from truepose.models.units import convert


def simulate(
    machine: Machine,
    poses: Recording,
    extra: Sequence[PlacedEffect] = (),
    *,
    seed: int | None = 0,
) -> pd.DataFrame:
    """The sensor's columns for every row of ``poses``, in the machine file's units.

    Noise is the instrument's, drawn from ``seed``; None leaves it out. Raises InputError naming the first row
    that cannot be assembled, and a column of labels that a sensor without readings needs.
    """
    _check_labels(machine, poses)
    predictor = predictor_for(machine.with_effects((*machine.effects, *extra)), poses)
    found = predicted(predictor, with_std=False)
    if not found.good.all():
        row = int(np.flatnonzero(~found.good)[0])
        raise InputError(f"{poses.where(row)}: the mechanism cannot be assembled there; mend or drop the row")
    rng = np.random.default_rng(0 if seed is None else seed)
    units = machine.units
    data: dict[str, Array] = {}
    offset = 0
    for sensor in machine.sensors:
        values = found.values[:, offset : offset + len(sensor.columns)]
        offset += len(sensor.columns)
        read = values if seed is None else sensor.noisy(values, rng)
        if sensor.differs_from_row and poses.from_row is not None:  # a change since itself is nothing
            read = np.where((poses.from_row == np.arange(len(poses)))[:, None], 0.0, read)
        for k, (name, unit) in enumerate(sensor.columns.items()):
            data[name] = convert(read[:, k], unit, units.written(unit))
    return pd.DataFrame(data)


def _check_labels(machine: Machine, poses: Recording) -> None:
    for sensor in machine.sensors:
        for name in sensor.label_columns:
            if name not in poses.labels:
                raise InputError(
                    f"{', '.join(poses.files)}: missing column {name!r}, which the sensor {sensor.type} needs"
                )


def with_inputs(table: Table, simulated: pd.DataFrame) -> pd.DataFrame:
    """The columns of a table of poses as they stand, then the simulated readings in place of its own."""
    kept = {}
    for column in table.columns:
        if column.name not in simulated:
            header = column.name if column.unit is None else f"{column.name} [{column.unit}]"
            kept[header] = list(table.cells[column.name])
    return pd.concat([pd.DataFrame(kept), simulated], axis=1)
