"""Columns of recordings: the drivers that a machine file declares, and which one thing each column is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

from truepose.errors import InputError
from truepose.models.file.driver import (
    MEASURED_LOADS,
    DeclaredDriver,
    Driver,
    driven_by_unit,
    is_known_driver,
)
from truepose.models.file.machine_file import MachineFile
from truepose.models.file.sections import DriverEntry
from truepose.models.machine.mechanism import Mechanism
from truepose.models.machine.sensor import Sensor
from truepose.models.units import INTERNAL, compatible, parse_unit
from truepose.wording import close_matches


def declared_drivers(file: MachineFile, mechanism: Mechanism) -> tuple[DeclaredDriver, ...]:
    """What the file says of each driver, of a name that stands twice the first. Raises InputError naming the field.

    A name alone is a driver whose kind says the rest (``temperature.base``); a joint's is none.
    """
    out: dict[str, DeclaredDriver] = {}
    for k, spec in enumerate(file.drivers):
        where = f"{file.path}: drivers[{k}]"
        if spec.name in mechanism.readings:
            if spec.unit is not None:
                raise InputError(
                    f"{where}.name: found {spec.name!r}, a joint, expected a column beyond the joints"
                )
            continue
        driver = _declared(spec, mechanism, where) if spec.of is None else _of_joint(spec, mechanism, where)
        if driver.column and driver.name in out:
            other = out[driver.name].column or driver.name
            raise InputError(
                f"{where}.of: found {spec.of!r}, of which {other!r} already is, expected one column"
            )
        out.setdefault(driver.name, driver)
    return tuple(out.values())


def driver_names(file: MachineFile, declared: Sequence[DeclaredDriver]) -> tuple[str, ...]:
    """What the drivers of the file are called: as it writes them, or as the joint that they are of says."""
    called = {driver.column: driver.name for driver in declared if driver.column}
    return tuple(called.get(spec.name, spec.name) for spec in file.drivers)


def _declared(spec: DriverEntry, mechanism: Mechanism, where: str) -> DeclaredDriver:
    driver = Driver.of(spec.name)
    own = driver.unit(mechanism.reading_units)
    written = spec.unit
    if written is not None:
        written = parse_unit(written, own or "any", f"{where}.unit")
    return declared_driver(spec.name, own, written or own, spec)


def _of_joint(spec: DriverEntry, mechanism: Mechanism, where: str) -> DeclaredDriver:
    """A column that stands for what the drive of a joint holds: its torque (a slide: force) or its motor's current."""
    limbs = {limb.name: limb.reading for limb in mechanism.limbs}
    joint = limbs.get(spec.of or "", spec.of or "")
    if joint not in mechanism.readings:
        hint = close_matches(joint, (*mechanism.readings, *limbs))
        raise InputError(f"{where}.of: found {spec.of!r}, expected a joint; {hint}")
    for kind in MEASURED_LOADS:
        driver = Driver(kind, joint)
        own = driver.unit(mechanism.reading_units)
        if spec.unit is not None and compatible(spec.unit, own):
            known = declared_driver(driver.name, own, spec.unit, spec)
            return replace(known, column="" if spec.name == driver.name else spec.name)
    units = " or ".join(Driver(kind, joint).unit(mechanism.reading_units) for kind in MEASURED_LOADS)
    raise InputError(f"{where}.unit: found {spec.unit!r}, expected {units}: what the drive of {joint} holds")


def declared_driver(
    name: str, own: str, written: str, spec: DriverEntry, *, tried: bool = False
) -> DeclaredDriver:
    """A driver whose columns are ``written`` in a unit (empty: as they are); ``own``: that of its kind, where it has one."""
    unit = own or next((known for known in INTERNAL.values() if compatible(written, known)), written)
    drives = spec.drives or Driver.of(name).drives or driven_by_unit(unit)
    everywhere = spec.drives is not None and Driver.of(name).kind in MEASURED_LOADS
    return DeclaredDriver(name, unit, written, drives, tried, everywhere=everywhere)


OF_ROWS: Final = ("time", "session", "pose", "from", "role")
"""Columns that say what a row is."""
_SAMPLES: Final = "samples"
"""How many samples a row is the average of."""
_POSE: Final = "pose."
"""Opens the tool's pose in what `predict` writes."""


def has_own_meaning(name: str) -> bool:
    """Return True if a column of this name says something of its row, whatever joints and sensors are called."""
    return name in (*OF_ROWS, _SAMPLES) or name.startswith(_POSE) or is_known_driver(name)


def check_column_names(
    joints: Sequence[str], made: Sequence[Sensor], declared: Iterable[DeclaredDriver], path: str
) -> None:
    """Refuse a column that two things would be read from. Raises InputError that says what to rename."""
    for k, joint in enumerate(joints):
        if joint in joints[:k]:
            raise InputError(
                f"{path}: mechanism: found two joints called {joint!r}, expected a name for each"
            )
        if has_own_meaning(joint):
            raise InputError(
                f"{path}: mechanism: found a joint called {joint!r}, a column that has a meaning of its own in "
                "recordings, expected another name"
            )
    read = _read_columns(made, path)
    for joint in joints:
        if joint in read:
            raise InputError(
                f"{path}: sensor: found the column {joint!r}, which is a joint, too, expected another one: "
                f"{_mend(read[joint], joint)}"
            )
    for driver in declared:
        column = driver.column or driver.name
        if column in read:
            raise InputError(
                f"{path}: drivers: found {column!r}, which the sensor reads, expected a column beyond its own"
            )


def _read_columns(made: Sequence[Sensor], path: str) -> dict[str, Sensor]:
    """Return which sensor reads each column. Raises InputError where sensors of different frames read one."""
    read: dict[str, Sensor] = {}
    for sensor in made:
        for column in (*sensor.columns, *sensor.label_columns, *sensor.optional_labels):
            if has_own_meaning(column):
                raise InputError(
                    f"{path}: sensor: found the column {column!r}, which has a meaning of its own in recordings, "
                    "expected another name"
                )
            if read.setdefault(column, sensor).view != sensor.view:
                raise InputError(
                    f"{path}: sensor: found two sensors of different frames that read the column {column!r}, "
                    "expected columns of their own: give each a `name`, which opens them (`NAME.x`)"
                )
    return read


def _mend(sensor: Sensor, column: str) -> str:
    """Return what to do about a column of a sensor that is a joint."""
    if sensor.opens_columns:
        return f"give the sensor a `name`, `name: sensor`, and the recording the column `sensor.{column}`"
    return "rename the joint, or what the sensor calls it"
