"""One file of a recording: which columns mean what, in which unit, and what is refused."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.recording.history import latest_earlier_row
from truepose.identification.recording.joint_readings import (
    JointColumn,
    column_unit,
    joint_readings,
    sized,
    turned_notes,
)
from truepose.identification.recording.table import Table, in_known_case, missing_column
from truepose.identification.recording.times import Times, read_times
from truepose.models.file.driver import APPROACH, MEASURED_LOADS, VELOCITY, DeclaredDriver, Driver
from truepose.models.file.limits import LATEST, ROWS
from truepose.models.machine.columns import OF_ROWS
from truepose.models.units import UnitSystem, convert
from truepose.wording import cut, meant, shortened

IntArray = npt.NDArray[np.int64]

LABEL: Final = "label"
LOGGED: Final = ("payload", "pressure", "humidity")
OF_JOINTS: Final = (APPROACH, VELOCITY, *MEASURED_LOADS)
_ROLES: Final = ("calibration", "validation")
_NAMED: Final = 4
"""Lost readings that a note names."""
_HINTED: Final = 200
"""Columns that are compared with known names."""
_LISTED: Final = 40
"""Columns that a note names."""


@dataclass(frozen=True)
class RecordingPart:
    """One file's rows in internal units; `from_row` counts from this file's first row.

    Observations are NaN where a reading was lost. said: the unit that joints and readings are said to be in. untried: columns
    of numbers that vary and that nobody declared.
    """

    file: str
    q: Array  # (n, n_joints)
    observations: Mapping[str, Array]
    labels: Mapping[str, tuple[str, ...]]
    drivers: Mapping[str, Array]
    validation: Mask
    session: IntArray | None
    pose: IntArray | None
    time: Array | None
    times: Times | None
    from_row: IntArray | None
    notes: tuple[str, ...]
    said: Mapping[str, str]
    untried: tuple[str, ...] = ()


def read_part(
    table: Table,
    joints: Sequence[JointColumn],
    sensor_columns: Mapping[str, str],
    units: UnitSystem,
    needed: Sequence[str],
    declared: Sequence[DeclaredDriver] = (),
) -> RecordingPart:
    """Check one file's table. `needed` names the columns it must have beside the joints; `declared`: drivers
    that the machine file names.
    """
    if table.n_rows > ROWS:
        found = f"{table.file}: found {table.n_rows:,} rows, expected at most {ROWS:,}"
        raise InputError(f"{found}: average what was read at one pose, or split the file")
    names = [joint.name for joint in joints]
    declared = [d for d in declared if d.name not in (*names, *sensor_columns, *OF_ROWS)]
    logged = [*LOGGED, *_of_joints(joints), *(d.name for d in declared)]
    headers = [d.column for d in declared if d.column]
    table = in_known_case(table, (*names, *sensor_columns, *logged, *OF_ROWS, *headers))
    table = _under_drivers_names(table, declared)
    unread = [name for name, unit in sensor_columns.items() if unit != LABEL and table.is_empty(name)]
    table = table.without([name for name in unread if name not in needed])
    _check_there(table, (*names, *needed), unread, (*names, *sensor_columns, *logged, *OF_ROWS))
    present = {name: unit for name, unit in sensor_columns.items() if name in table}
    readings = {name: unit for name, unit in present.items() if unit != LABEL}
    said = {j.name: column_unit(table, j, units) for j in joints}
    said |= {name: table.unit(name, units.written(unit), unit) for name, unit in readings.items()}
    observations = {}
    for name, unit in readings.items():
        read = table.readings(name)
        observations[name] = sized(table, name, convert(read, said[name], unit, table.where(name)), read)
    times = read_times(table) if "time" in table else None
    time = None if times is None else sized(table, "time", times.seconds, largest=LATEST)
    pose = table.integers("pose") if "pose" in table else None
    drivers = _drivers(table, joints, units, declared)
    q = {joint.name: joint_readings(table, joint, said[joint.name]) for joint in joints}
    known = {*names, *sensor_columns, *drivers, *OF_ROWS}
    return RecordingPart(
        file=table.file,
        q=np.column_stack(list(q.values())),
        observations=observations,
        labels={name: table.texts(name) for name, unit in present.items() if unit == LABEL},
        drivers=drivers,
        validation=_validation(table),
        session=table.integers("session") if "session" in table else None,
        pose=pose,
        time=time,
        times=times,
        from_row=_from_row(table, pose, time) if "from" in table else None,
        notes=(
            *table.notes,
            *_lost(table.file, observations),
            *turned_notes(table, joints, q, said),
            *_ignored_columns(table, known, {*LOGGED, *_of_joints(joints)}),
        ),
        said=said,
        untried=_untried_columns(table, {*known, *OF_ROWS}),
    )


def _under_drivers_names(table: Table, declared: Sequence[DeclaredDriver]) -> Table:
    """The table with columns that are of a joint's drive under its name; a note says so."""
    called = {d.column: d.name for d in declared if d.column and d.column in table}
    for column, name in called.items():
        if name in table:
            raise InputError(
                f"{table.file}: found the columns {column!r} and {name!r}, expected one of them: both are {name!r}"
            )
    if not called:
        return table
    told = ", ".join(f"{column!r} as {name!r}" for column, name in called.items())
    return table.renamed(called).with_note(f"{table.file}: read {told}")


def _check_there(table: Table, needed: Sequence[str], empty: Collection[str], known: Sequence[str]) -> None:
    """Refuse a table without a column that is ``needed``, or with no cell in it; ``known`` names are offered."""
    for name in needed:
        if name not in table:
            raise missing_column(table, name, known)
        if name in empty:
            raise InputError(f"{table.where(name)}: every cell is empty, expected readings")


def written_units(
    joints: Sequence[JointColumn],
    sensor_columns: Mapping[str, str],
    drivers: Sequence[str],
    units: UnitSystem,
    declared: Sequence[DeclaredDriver] = (),
) -> dict[str, tuple[str, str]]:
    """Of each column with a unit, the internal one and that of a file of such `units`, unless its header says otherwise."""
    internal, written = {j.name: j.unit for j in joints}, {j.name: j.written_in(units) for j in joints}
    out = {name: (unit, written[name]) for name, unit in internal.items()}
    out |= {name: (unit, units.written(unit)) for name, unit in sensor_columns.items() if unit != LABEL}
    out |= {n: (Driver.of(n).unit(internal), Driver.of(n).unit(written)) for n in drivers}
    return out | {d.name: (d.unit, d.written) for d in declared if d.name in drivers}


def _lost(file: str, observations: Mapping[str, Array]) -> list[str]:
    """Notes on the readings that were lost, and on rows that have none left."""
    gone = sorted((int(row), name) for name, v in observations.items() for row in np.flatnonzero(np.isnan(v)))
    if not gone:
        return []
    where = shortened([f"row {row + 1} {name}" for row, name in gone], _NAMED)
    return [
        f"{file}: {len(gone)} reading is missing ({where}): this channel of this row is not fitted"
        if len(gone) == 1
        else f"{file}: {len(gone)} readings are missing ({where}): these channels of these rows are not fitted",
        *_unread(file, observations),
    ]


def _unread(file: str, observations: Mapping[str, Array]) -> list[str]:
    rows = np.flatnonzero(np.all([np.isnan(values) for values in observations.values()], axis=0)) + 1
    if not rows.size:
        return []
    named = shortened([str(row) for row in rows], _NAMED)
    return [f"{file}: no reading is left in row{'s' if rows.size > 1 else ''} {named}: not fitted"]


def _converted(table: Table, name: str, default: str, internal: str) -> Array:
    values = table.numbers(name)
    converted = convert(values, table.unit(name, default, internal), internal, table.where(name))
    return sized(table, name, converted, values, LATEST)


def _drivers(
    table: Table, joints: Sequence[JointColumn], units: UnitSystem, declared: Sequence[DeclaredDriver]
) -> dict[str, Array]:
    written, internal = {j.name: j.written_in(units) for j in joints}, {j.name: j.unit for j in joints}
    temperatures = [name for name in table.names if Driver.of(name).thermal]
    out = {d.name: _declared(table, d) for d in declared if d.name in table}
    for name in (*LOGGED, *temperatures, *_of_joints(joints)):
        if name in table and name not in out:
            driver = Driver.of(name)
            out[name] = _converted(table, name, driver.unit(written), driver.unit(internal))
    for name, values in out.items():
        if Driver.of(name).kind == APPROACH:
            _refuse_sides(table, name, values)
    return out


def _declared(table: Table, driver: DeclaredDriver) -> Array:
    """A declared column; one whose unit nobody stated stays as it was recorded."""
    if not driver.unit:
        return sized(table, driver.name, table.numbers(driver.name), largest=LATEST)
    return _converted(table, driver.name, driver.written, driver.unit)


def _of_joints(joints: Sequence[JointColumn]) -> list[str]:
    return [Driver(kind, joint.name).name for joint in joints for kind in OF_JOINTS]


def _refuse_sides(table: Table, name: str, values: Array) -> None:
    table.refuse(name, ~np.isin(values, (-1.0, 0.0, 1.0)), lambda row: f"{values[row]:g}", "-1, 0 or 1")


def _validation(table: Table) -> Mask:
    if "role" not in table:
        return np.zeros(table.n_rows, dtype=np.bool_)
    roles = table.texts("role")
    for row, role in enumerate(roles):
        if role not in _ROLES:
            raise InputError(f"{table.where('role', row)}: found {role!r}, expected {' or '.join(_ROLES)}")
    return np.array([role == "validation" for role in roles])


def _from_row(table: Table, pose: IntArray | None, time: Array | None) -> IntArray:
    if pose is None:
        raise InputError(f"{table.file}: missing column 'pose', which the numbers in column 'from' mean")
    origin = table.integers("from")
    rows = latest_earlier_row(pose, origin, time)
    table.refuse("from", rows < 0, lambda row: f"{origin[row]}", "the pose of this or of an earlier row")
    return rows


def _ignored_columns(table: Table, known: Collection[str], optional: Collection[str]) -> tuple[str, ...]:
    """A note on the columns that are not ``known``, with the known or ``optional`` name that may be meant; none without any."""
    others = _others(table, known)
    if not others:
        return ()
    absent = {*known, *optional} - set(table.names)
    hints = {name: meant(name, absent) for name in others[:_HINTED]}
    named = [f"{name!r} ({hint})" for name, hint in hints.items() if hint]
    named += [repr(cut(name)) for name in others if not hints.get(name)]
    return (f"{table.file}: ignored columns that mean nothing here: {shortened(named, _LISTED)}",)


def _untried_columns(table: Table, known: Collection[str]) -> tuple[str, ...]:
    """Columns of numbers that vary, beside those that are ``known``: what might drive an error."""
    return tuple(name for name in _others(table, known) if name and _varies(table, name))


def _others(table: Table, known: Collection[str]) -> list[str]:
    """Columns that are neither known nor say of known ones how they were averaged."""
    named = {*known, "samples", *(f"{name}.sigma" for name in known)}
    named |= {f"{name.rpartition('.')[0]}.samples" for name in known}
    return [name for name in table.names if name not in named]


def _varies(table: Table, name: str) -> bool:
    try:
        return bool(np.ptp(table.numbers(name)) > 0.0)
    except InputError:
        return False
