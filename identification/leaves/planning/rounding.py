"""Planned joint values in the units of the machine file, rounded inside their ranges."""

from __future__ import annotations

import numpy as np

from truepose.arrays import Array
from truepose.models.machine.machine import Machine
from truepose.models.units import convert


def rounded(q: Array, machine: Machine, step: float) -> Array:
    """Joint values (n, nq) rounded to about ``step`` of their range in the file's units, never out of it."""
    out = q.copy()
    for k, actuator in enumerate(machine.mechanism.actuators):
        if actuator.range is None:
            continue
        unit = machine.column_unit(actuator.reading)
        low, high = (convert(end, actuator.reading_unit, unit) for end in actuator.range)
        places = decimals(np.array([high - low]), step)
        values = np.round(convert(q[:, k], actuator.reading_unit, unit), places)
        out[:, k] = np.clip(convert(values, unit, actuator.reading_unit), *actuator.range)
    return out


def decimals(values: Array, step: float) -> int:
    """Decimals that resolve ``step`` of the largest of ``values`` (n,); 0 where all are zero."""
    if not np.any(values):
        return 0
    return int(np.ceil(-np.log10(step * float(np.max(np.abs(values))))))
