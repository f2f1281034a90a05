"""Planned poses as the rows of a file, joints in the units of the machine file."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from truepose.arrays import Array
from truepose.identification.leaves.planning.discriminate.experiment import Experiment
from truepose.identification.leaves.planning.information import decimals
from truepose.identification.leaves.planning.plan import Plan
from truepose.models.file.driver import APPROACH, SESSION, TIME, Driver
from truepose.models.machine.machine import Machine
from truepose.models.units import convert

_FINEST = 1e-12
BETWEEN = 30.0
"""Seconds from one row to the next, where time is planned."""


def plan_table(plan: Plan) -> pd.DataFrame:
    """``pose``, ``from`` where readings are changes, and the joints, in the units of the machine file.

    Rows of the same joint values share a ``pose`` number: they are repeats.
    """
    n = len(plan.q)
    data: dict[str, Array | NDArray[np.int64]] = {}
    if plan.origin is None:
        data["pose"] = _numbered(plan.q)
    else:  # the number says which row a change counts from
        data["pose"], data["from"] = np.arange(1, n + 1), plan.origin.astype(np.int64) + 1
    return pd.DataFrame({**data, **_joints(plan.q, plan.machine)})


def experiment_table(experiment: Experiment) -> pd.DataFrame:
    """``pose``, ``from`` where readings are changes (all from the first row, a reference), ``session`` and ``time``
    where they matter, the joints, then payload (kg), temperatures (degC), sides and other drivers.

    Rows of one pose share a number when nothing but the side of approach differs: they are repeats.
    """
    rows, machine = experiment.rows, experiment.machine
    q, drivers = rows.q, dict(rows.drivers)
    data: dict[str, Array | NDArray[np.int64]] = {}
    if experiment.reference is None:
        held = [values for name, values in drivers.items() if Driver.of(name).kind not in (APPROACH, TIME)]
        data["pose"] = _numbered(np.column_stack([q, *held]))
    else:
        q = np.concatenate([experiment.reference[None], q])
        drivers = {name: np.concatenate([values[:1], values]) for name, values in drivers.items()}
        data["pose"], data["from"] = np.arange(1, len(q) + 1), np.ones(len(q), dtype=np.int64)
    if SESSION in drivers:
        data[SESSION] = drivers.pop(SESSION).astype(np.int64)
    if TIME in drivers:
        data[TIME] = _one_by_one(drivers.pop(TIME))
    data |= _joints(q, machine)
    joints = machine.mechanism.reading_units
    columns = {name: machine.column_unit(name) for name in joints}
    for name, values in drivers.items():
        known, driver = machine.declared(name), Driver.of(name)
        units = (known.unit, known.written) if known else (driver.unit(joints), driver.unit(columns))
        written = convert(values, *units) if all(units) else values
        data[name] = np.round(written, decimals(written, _FINEST)) + 0.0
    return pd.DataFrame(data)


def _joints(q: Array, machine: Machine) -> dict[str, Array | NDArray[np.int64]]:
    """Joint values (n, nq) by column, in the units of the machine file."""
    data: dict[str, Array | NDArray[np.int64]] = {}
    for k, actuator in enumerate(machine.mechanism.actuators):
        written = convert(q[:, k], actuator.reading_unit, machine.column_unit(actuator.reading))
        # what is left of the conversion's rounding would make long numbers of short ones
        data[actuator.reading] = np.round(written, decimals(written, _FINEST)) + 0.0
    return data


def _one_by_one(time: Array) -> Array:
    """Times (n,), ascending, of rows that are due at once: one after the other."""
    first = np.searchsorted(time, time)
    return np.asarray(time + BETWEEN * (np.arange(len(time)) - first))


def _numbered(q: Array) -> NDArray[np.int64]:
    """(n,) numbers from 1 in order of appearance, the same for the same joint values."""
    _, first, group = np.unique(q, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.asarray(1 + rank[group.reshape(-1)], dtype=np.int64)
