"""Readings that hold the motion of other joints, too: recorded J3 = own angle of J3 + k * recorded J2.

The one place where readings become each joint's own motion, and the other way round. Builders state what is coupled, models,
recordings and exports ask here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.file.machine_file import MachineFile
from truepose.models.machine.mechanism import Actuator, Mechanism
from truepose.models.units import convert
from truepose.wording import close_matches

Range = tuple[float, float]
_SINGULAR = 1e-9
"""Determinant below which readings do not tell the joints' own motions."""


def resolve_couplings(mechanism: Mechanism, file: MachineFile) -> Mechanism:
    """Return the mechanism with couplings in the units of its readings. Raises InputError for what cannot be coupled."""
    known, actuators = mechanism.reading_units, []
    for actuator in mechanism.actuators:
        where = f"{file.path}: mechanism: joint {actuator.reading!r}: coupled"
        factors = {}
        for other, factor in actuator.coupled.items():
            if other not in known or other == actuator.reading:
                others = [name for name in known if name != actuator.reading]
                raise InputError(
                    f"{where}: found {other!r}, expected another joint that is read; {close_matches(other, others)}"
                )
            own, theirs = (file.units.of_joint(unit) for unit in (actuator.reading_unit, known[other]))
            scale = convert(1.0, own, actuator.reading_unit) / convert(1.0, theirs, known[other])
            factors[other] = factor * scale
        actuators.append(replace(actuator, coupled=factors))
    stated = {actuator.reading: actuator.range for actuator in actuators}
    actuators = [replace(actuator, reads=_recorded_range(actuator, stated)) for actuator in actuators]
    found = replace(mechanism, actuators=tuple(actuators))
    matrix = coupling_matrix(found)
    if matrix is not None and abs(np.linalg.det(matrix)) < _SINGULAR:
        raise InputError(
            f"{file.path}: mechanism: found joints {', '.join(_coupled(found))} coupled to each other so that their "
            "readings do not tell their own motions, expected couplings one way"
        )
    return found


def _recorded_range(actuator: Actuator, stated: Mapping[str, Range | None]) -> Range | None:
    """Return what a joint can read: its own range, as a data sheet states it, and what others add to it within theirs."""
    if actuator.range is None:
        return None
    low, high = actuator.range
    for other, factor in actuator.coupled.items():
        theirs = stated[other]
        if factor and theirs is None:
            return None
        theirs = theirs or (0.0, 0.0)
        ends = sorted(factor * end for end in theirs)
        low, high = low + ends[0], high + ends[1]
    return low, high


def coupling_matrix(mechanism: Mechanism) -> Array | None:
    """Return the matrix (nq, nq) that takes readings to the joints' own motions; None where they are the same."""
    if not _coupled(mechanism):
        return None
    place, out = {name: k for k, name in enumerate(mechanism.readings)}, np.eye(len(mechanism.readings))
    for actuator in mechanism.actuators:
        for other, factor in actuator.coupled.items():
            out[place[actuator.reading], place[other]] -= factor
    out.setflags(write=False)
    return out


def own_motions(mechanism: Mechanism, readings: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Return each joint's own motion by name, in the unit of its reading: what is recorded, less what others add to it."""
    out = dict(readings)
    for actuator in mechanism.actuators:
        for other, factor in actuator.coupled.items():
            out[actuator.reading] -= factor * readings[other]
    return out


def recorded_reading(mechanism: Mechanism, reading: str, own: Mapping[str, ca.SX]) -> ca.SX:
    """Return what a joint's encoder reads, of all joints' own motions."""
    matrix = coupling_matrix(mechanism)
    if matrix is None:
        return own[reading]
    row = np.linalg.inv(matrix)[mechanism.readings.index(reading)]
    return sum((float(r) * own[name] for r, name in zip(row, mechanism.readings, strict=True) if r), ca.SX(0))


def turns_freely(mechanism: Mechanism, reading: str) -> bool:
    """Return whether a whole turn of a reading leaves the machine where it is."""
    actuator = mechanism.actuator(reading)
    moved = [other.coupled.get(reading, 0.0) for other in mechanism.actuators if other.unit == "rad"]
    slides = any(other.coupled.get(reading) for other in mechanism.actuators if other.unit != "rad")
    whole = not slides and all(float(factor).is_integer() for factor in moved)
    return actuator.unit == "rad" and actuator.gain is None and whole


def _coupled(mechanism: Mechanism) -> list[str]:
    return [actuator.reading for actuator in mechanism.actuators if any(actuator.coupled.values())]
