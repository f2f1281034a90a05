"""What a column of a recording is: one thing, a joint, what a sensor reads, or a name that has a meaning of its own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from truepose.errors import InputError
from truepose.models.file.driver import DeclaredDriver, is_known_driver
from truepose.models.machine.sensor import Sensor

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
