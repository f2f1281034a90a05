"""Read recordings for a machine: its joints and its sensors say which columns are needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from truepose.errors import InputError
from truepose.identification.fringes.lengths import read_fringes, sensor_of, with_readings
from truepose.identification.recording.file import LABEL
from truepose.identification.recording.recording import JointColumn, Recording, read_recording
from truepose.identification.recording.table import read_table
from truepose.models.machine import Machine
from truepose.models.sensors.irradiance import Irradiance
from truepose.models.units import UnitSystem


def load_recording(
    machine: Machine,
    paths: Sequence[Path | str],
    *,
    need_readings: bool = True,
    irradiance: Sequence[Path | str] = (),
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """One or several files as one recording. Raises InputError naming file, row and column.

    ``irradiance``: tables of photocurrents, one for each file without a column ``dL``, in the same order; their
    fringes are counted (see `truepose.identification.fringes`).
    """
    files = [Path(p) for p in paths]
    if not need_readings or not (irradiance or any(s.type == Irradiance.type for s in machine.sensors)):
        if irradiance:
            sensor_of(machine)
        return _read(machine, files, need_readings)
    sensor_of(machine)
    lacking = [k for k, file in enumerate(files) if "dL" not in read_table(file)]
    if lacking and not irradiance:
        raise InputError(f"{files[lacking[0]]}: missing column 'dL', and no --irradiance to count it from")
    if len(irradiance) != len(lacking):
        raise InputError(
            f"--irradiance: found {len(irradiance)} tables, expected {len(lacking)}: one for each recording "
            "without a column 'dL', in the same order"
        )
    if not lacking:
        return _read(machine, files, need_readings)
    rows = _read(machine, files, need_readings, without="dL")
    found = read_fringes(
        machine, rows, {k: Path(p) for k, p in zip(lacking, irradiance, strict=True)}, progress
    )
    others = [file for k, file in enumerate(files) if k not in lacking]
    if others:
        recorded = ~np.isin(rows.source_file, lacking)
        found.change[recorded] = _read(machine, others, need_readings).readings["dL"]
        rows = replace(rows, notes=tuple(note for note in rows.notes if not note.startswith("column 'dL'")))
    return with_readings(rows, found)


def _read(machine: Machine, files: Sequence[Path], need_readings: bool, without: str = "") -> Recording:
    """The files; a column ``without`` may be missing in spite of ``need_readings``."""
    joints = [JointColumn(a.reading, a.reading_unit, a.range) for a in machine.mechanism.actuators]
    columns = {name: unit for sensor in machine.sensors for name, unit in sensor.columns.items()}
    columns |= {name: LABEL for sensor in machine.sensors for name in sensor.label_columns}
    optional = [name for sensor in machine.sensors for name in sensor.optional_labels]
    units = machine.file.units if machine.file else UnitSystem()
    changes = need_readings and any(sensor.differs_from_row for sensor in machine.sensors)
    required = ("from",) if changes else ()
    if without:
        required = (*required, *(name for name in columns if name != without))
        need_readings = False
    return read_recording(
        files, joints, columns, units, need_readings, required=required, optional_labels=optional
    )
