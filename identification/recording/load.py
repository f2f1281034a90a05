"""Read recordings for a machine: its joints and its sensors say which columns are needed.

What is a recording: a path, a DataFrame, a dict of columns, or several of these.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

from truepose.errors import InputError
from truepose.identification.recording.angle_range import TURN, unfold_readings
from truepose.identification.recording.file import LABEL
from truepose.identification.recording.joint_column import JointColumn
from truepose.identification.recording.names import in_known_case
from truepose.identification.recording.own_equipment import begun, with_own_equipment
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table, is_table, read_table, table_in_memory
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import coupling_matrix, turns_freely

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
