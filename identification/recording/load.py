"""Read recordings for a machine: its joints and its sensors say which columns are needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from truepose.identification.recording.file import LABEL
from truepose.identification.recording.recording import JointColumn, Recording, read_recording
from truepose.models.machine import Machine


def joint_columns(machine: Machine) -> list[JointColumn]:
    """What the joints' columns of a recording of this machine hold."""
    return [JointColumn(a.reading, a.reading_unit, a.range) for a in machine.mechanism.actuators]


def load_recording(
    machine: Machine, paths: Sequence[Path | str], *, need_observations: bool = True, without: str = ""
) -> Recording:
    """One or several files as one recording. Raises InputError naming file, row and column.

    Without ``need_observations`` the sensors' columns may be missing; else only the column ``without`` may.
    """
    files = [Path(p) for p in paths]
    columns = {name: unit for sensor in machine.sensors for name, unit in sensor.columns.items()}
    columns |= {name: LABEL for sensor in machine.sensors for name in sensor.label_columns}
    optional = [name for sensor in machine.sensors for name in sensor.optional_labels]
    changes = need_observations and any(sensor.differs_from_row for sensor in machine.sensors)
    required = ("from",) if changes else ()
    if without:
        required = (*required, *(name for name in columns if name != without))
        need_observations = False
    recording = read_recording(
        files,
        joint_columns(machine),
        columns,
        machine.units,
        need_observations,
        required=required,
        optional_labels=optional,
    )
    return replace(recording, notes=(*machine.notes, *recording.notes)) if machine.notes else recording
