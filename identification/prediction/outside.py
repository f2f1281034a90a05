"""Say which rows lie outside of what the calibration saw: there effects are held or extrapolated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from truepose.arrays import Array
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.machine import Machine
from truepose.models.machine.seen import Range, SeenRanges, values_of
from truepose.models.units import convert


def outside_notes(
    model: SymbolicModel,
    q: Array,
    z: Array,
    where: Callable[[int], str],
    *,
    of_tool: bool = True,
    rows: str = "rows",
) -> tuple[str, ...]:
    """Return a note on rows that lie outside of what the calibration saw; none where all lie inside or nothing is known.

    q (n, nq), z (n, nz): readings and drivers. where: names a row. of_tool: only effects that move the tool count. rows: what
    rows are called. Raises InputError for ranges in the machine's file that cannot be read.
    """
    seen = SeenRanges.of(model, of_tool=of_tool)
    values = values_of(model, q, z)[:, list(seen.places)]
    outside = seen.outside(values)
    if not outside.any():
        return ()
    count, told = int(outside.any(axis=1).sum()), []
    for k in np.flatnonzero(outside.any(axis=0)).tolist():
        farthest = _farthest(model.machine, seen.names[k], values[:, k], (seen.low[k], seen.high[k]))
        first = where(int(np.argmax(outside[:, k])))
        told.append(f"{farthest} in {outside[:, k].sum()}, first at {first}")
    return (
        f"{count} of {len(q)} {rows} {'lies' if count == 1 else 'lie'} outside of what the calibration saw, where effects are "
        f"held or extrapolated: {'; '.join(told)}",
    )


def _farthest(machine: Machine, name: str, values: Array, seen: Range) -> str:
    """Return the value of a source that is farthest outside of its range, and the range, in the file's units."""
    reading, (low, high) = machine.mechanism.reading_units.get(name), seen
    unit = reading or machine.driver_unit(name)
    shown = machine.units.of_joint(reading) if reading else machine.units.written(unit)
    value = values[np.argmax(np.maximum(low - values, values - high))]
    numbers = [f"{convert(float(v), unit, shown):.6g}" for v in (value, low, high)]
    after = "" if shown in ("", "1") else f" {shown}"
    way = "up to" if value > high else "down to"
    return f"{name} {way} {numbers[0]}{after} (seen {numbers[1]} to {numbers[2]}{after})"
