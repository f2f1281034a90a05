"""Read recordings for a machine: its joints and its sensors say which columns are needed.

What is a recording: a path, a DataFrame, a dict of columns, or several of these.

Which rows of a recording the machine file's section ``recordings`` means, and when their files were begun.

Columns that nobody declared, as drivers: those that a user tries, and what joints' drives hold, which needs none.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path, PurePath
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from truepose.arrays import Mask
from truepose.errors import InputError
from truepose.identification.recording.file import LABEL
from truepose.identification.recording.joint_readings import TURN, JointColumn, unfold_readings
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording, frozen
from truepose.identification.recording.table import (
    Table,
    in_known_case,
    is_table,
    read_table,
    table_in_memory,
)
from truepose.models.file.driver import MEASURED_LOADS, DeclaredDriver, Driver
from truepose.models.file.sections import DriverEntry
from truepose.models.machine.columns import declared_driver
from truepose.models.machine.machine import Equipment, Machine
from truepose.models.machine.mechanism import coupling_matrix, turns_freely
from truepose.wording import close_matches, joined

Source: TypeAlias = "str | os.PathLike[str] | Table | pd.DataFrame | Mapping[str, Any]"
"""One recording: a file (text, Parquet, Excel, a ROS bag), a DataFrame, or a dict of columns; units as in a file."""
Sources: TypeAlias = "Source | Sequence[Source]"


def joint_columns(machine: Machine) -> list[JointColumn]:
    """What the joints' columns of a recording of this machine hold."""
    return [
        JointColumn(
            a.reading,
            a.reading_unit,
            a.reading_range,
            written=machine.column_unit(a.reading),
            counted=a.counted is not None,
            wrap=a.wrap,
            plain_wrap=a.plain_wrap,
            turn=TURN if turns_freely(machine.mechanism, a.reading) else None,
        )
        for a in machine.mechanism.actuators
    ]


def tables(source: Sources, readings: Sequence[str] = ()) -> list[Table]:
    """Return the table of every recording in ``source``, for a machine whose joints are ``readings``.

    Raises InputError for what is none, and as ``read_table`` does.
    """
    alone = isinstance(source, (str, os.PathLike, Table)) or is_table(source)
    sources: Sequence[Any] = source if isinstance(source, Sequence) and not alone else [source]
    out = []
    for k, one in enumerate(sources, start=1):
        number = f" {k}" if len(sources) > 1 else ""
        if isinstance(one, Table):
            out.append(one)
        elif isinstance(one, (str, os.PathLike)):
            out.append(read_table(Path(one), readings))
        elif is_table(one):
            out.append(table_in_memory(one, f"{type(one).__name__}{number}"))
        else:
            raise InputError(
                f"recording{number}: found {type(one).__name__}, expected a path, a DataFrame, a dict of columns, "
                "or several of these"
            )
    return out


def load_recording(
    machine: Machine,
    source: Sources,
    *,
    need_observations: bool = True,
    without: str = "",
    shuffled: bool = False,
) -> Recording:
    """One or several recordings as one. Raises InputError naming file, row and column.

    Without ``need_observations`` the sensors' columns may be missing; else only the column ``without`` may. ``shuffled``:
    rows are no visits one after the other.
    """
    columns = {name: unit for sensor in machine.sensors for name, unit in sensor.columns.items()}
    columns |= {name: LABEL for sensor in machine.sensors for name in sensor.label_columns}
    optional = [name for sensor in machine.sensors for name in sensor.optional_labels]
    changes = need_observations and any(sensor.differs_from_row for sensor in machine.sensors)
    required = ("from",) if changes else ()
    if without:
        required = (*required, *(name for name in columns if name != without))
        need_observations = False
    files = tables(source, machine.mechanism.readings)
    recording = read_recording(
        files,
        joint_columns(machine),
        columns,
        machine.units,
        need_observations,
        required=required,
        optional_labels=optional,
        declared=machine.declared_drivers,
        shuffled=shuffled,
        begun=begun(machine, [table.file for table in files]),
    )
    recording = replace(recording, uncoupling=coupling_matrix(machine.mechanism))
    recording = unfold_readings(machine, with_own_equipment(machine, recording))
    notes = (*machine.notes, *_without_force(machine, files))
    return replace(recording, notes=(*notes, *recording.notes)) if notes else recording


def _without_force(machine: Machine, files: Sequence[Table]) -> list[str]:
    """A note on each file without a measured force. Raises InputError for a file that has some of its columns only."""
    notes = []
    for table in (in_known_case(table, machine.force_columns) for table in files):
        for force in machine.forces:
            stated = f"forces.{force.name}.columns: {', '.join(force.columns)}"
            missing = [column for column in force.columns if column not in table]
            if missing and len(missing) < len(force.columns):
                raise InputError(
                    f"{table.file}: missing column {missing[0]!r}, expected all or none of {stated}"
                )
            if missing:
                notes.append(f"{table.file}: found no column of {stated}; this force counts as 0 there")
    return notes


def as_recording(
    machine: Machine, source: Recording | Sources, *, need_observations: bool = True
) -> Recording:
    """The recording itself, or what ``load_recording`` makes of anything that is one."""
    if isinstance(source, Recording):
        return source
    return load_recording(machine, source, need_observations=need_observations)


def with_own_equipment(machine: Machine, recording: Recording) -> Recording:
    """The recording with the drivers ``recording.NAME`` of its rows, and a note on every entry that means none of them.

    Raises InputError for rows that two entries give a tool, or a payload.
    """
    if not machine.equipment:
        return recording
    drivers, notes = dict(recording.drivers), list[str]()
    rows = {own.name: _rows(own, recording) for own in machine.equipment}
    for kind, owners in (
        ("tool", [own.name for own in machine.equipment if own.tool is not None]),
        ("payload", [own.name for own in machine.equipment if own.mass is not None]),
    ):
        _refuse_two(kind, {name: rows[name] for name in owners}, recording)
    for own in machine.equipment:
        if rows[own.name].any():
            drivers[own.driver] = frozen(rows[own.name].astype(float))
        else:
            drivers.pop(own.driver, None)
            notes.append(f"recordings.{own.name}: none of {', '.join(recording.files)} is {_meant(own)}")
    return replace(recording, drivers=drivers, notes=(*recording.notes, *notes))


def begun(machine: Machine, files: Sequence[str]) -> Mapping[str, float]:
    """When each file was begun, s since 1970; empty where the machine file dates none.

    Raises InputError where it dates some of them only, or one twice.
    """
    dates: dict[str, float] = {}
    for own in machine.equipment:
        for file in files if own.date is not None else ():
            if not _is_of(own, file):
                continue
            if file in dates and dates[file] != own.date:
                raise InputError(
                    f"{file}: recordings.{own.name}.date: found two dates of this file, expected one"
                )
            dates[file] = own.date or 0.0
    without = [file for file in files if file not in dates]
    if dates and without:
        raise InputError(
            f"{without[0]}: found no date of it in `recordings`, expected one beside those of {joined(list(dates))}: "
            "they share one clock"
        )
    return dates


def _is_of(own: Equipment, file: str) -> bool:
    name = PurePath(file).name
    return any(fnmatchcase(name, pattern) or fnmatchcase(file, pattern) for pattern in own.files)


def _rows(own: Equipment, recording: Recording) -> Mask:
    """(n,) rows that an entry means, or that a column ``recording.NAME`` says are of it."""
    of_file = np.array([_is_of(own, file) for file in recording.files], dtype=bool)
    rows = of_file[recording.source_file] | np.isin(recording.session, own.sessions)
    said = recording.drivers.get(own.driver)
    return rows if said is None else rows | (said != 0.0)


def _meant(own: Equipment) -> str:
    if own.files:
        return f"called {joined(own.files, 'or')}"
    return f"of session {joined([str(number) for number in own.sessions], 'or')}"


def _refuse_two(kind: str, rows: Mapping[str, Mask], recording: Recording) -> None:
    if not rows:
        return
    stacked = np.array(list(rows.values()))
    twice = np.flatnonzero(stacked.sum(axis=0) > 1)
    if twice.size:
        row = int(twice[0])
        names = [f"recordings.{name}" for name, own in rows.items() if own[row]]
        raise InputError(f"{recording.where(row)}: found its {kind} in {joined(names)}, expected one of them")


def try_columns(machine: Machine, source: Sources, names: Sequence[str] = ()) -> Machine:
    """The machine with undeclared columns of a recording as drivers: the ``names``, or all that hold numbers which vary.

    A recording that is loaded for it has them, and ``diagnose`` weighs what they drive, each at a share of the prior that the
    number of them divides. Raises InputError for a name that is no such column.
    """
    files = tables(source, machine.mechanism.readings)
    untried = load_recording(machine, files, need_observations=False).untried
    known = [d.name for d in machine.declared_drivers]
    for name in names:
        if name not in untried and name not in known:
            raise InputError(
                f"--try-columns: found {name!r}, expected a column of numbers that vary and that nothing else reads; "
                f"{close_matches(name, untried) or 'this recording has none'}"
            )
    wanted = [name for name in untried if name in names or not names]
    return _with(machine, [_tried(machine, files[0], name) for name in wanted])


def with_measured_loads(machine: Machine, recording: Recording) -> Machine:
    """The machine with the torques and currents of its joints that were recorded as drivers."""
    of_joints = [n for n in recording.drivers if Driver.of(n).kind in MEASURED_LOADS]
    missing = [n for n in of_joints if n not in machine.drivers]
    units = machine.mechanism.reading_units
    added = [declared_driver(n, Driver.of(n).unit(units), "", DriverEntry(name=n)) for n in missing]
    return _with(machine, added)


def tried(machine: Machine) -> tuple[str, ...]:
    """Names of the columns that are tried."""
    return tuple(driver.name for driver in machine.declared_drivers if driver.tried)


def _tried(machine: Machine, table: Table, name: str) -> DeclaredDriver:
    own = Driver.of(name).unit(machine.mechanism.reading_units)
    return declared_driver(name, own, table.unit(name, own, own or "any"), DriverEntry(name=name), tried=True)


def _with(machine: Machine, added: Sequence[DeclaredDriver]) -> Machine:
    if not added:
        return machine
    return replace(
        machine,
        drivers=(*machine.drivers, *(driver.name for driver in added)),
        declared_drivers=(*machine.declared_drivers, *added),
    )
