"""Recordings whose changes of length are counted from photocurrents, where their files have no column ``dL``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from truepose.errors import InputError
from truepose.identification.leaves.fringes.lengths import Readings, read_samples, sensor_of, with_lengths
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table
from truepose.models.machine.machine import Machine
from truepose.models.sensors.irradiance import Irradiance


def load_counted(
    machine: Machine,
    files: Sequence[Table],
    irradiance: Sequence[Path | str],
    shuffled: bool,
    progress: Callable[[str], None] | None,
) -> Recording | None:
    """Return the rows of files with their fringes counted, None where no file lacks ``dL``. Raises InputError.

    ``irradiance``: tables of photocurrents, one for each file without a column ``dL``, in the same order.
    """
    if not irradiance and not any(isinstance(sensor, Irradiance) for sensor in machine.sensors):
        return None
    sensor = sensor_of(machine)
    lacking = [k for k, table in enumerate(files) if "dL" not in table]
    if lacking and not irradiance:
        raise InputError(
            f"{files[lacking[0]].file}: missing column 'dL', and no --irradiance to count it from"
        )
    if len(irradiance) != len(lacking):
        raise InputError(
            f"--irradiance: found {len(irradiance)} tables, expected {len(lacking)}: one for each recording "
            "without a column 'dL', in the same order"
        )
    if not lacking:
        return None
    rows = load_recording(machine, files, without="dL", shuffled=shuffled)
    found = Readings(machine, sensor, rows)
    for index, path in zip(lacking, irradiance, strict=True):
        found.read(index, read_samples(path, machine.units), progress or (lambda _: None))
    found.close()
    others = [table for k, table in enumerate(files) if k not in lacking]
    if others:
        recorded = ~np.isin(rows.source_file, lacking)
        found.change[recorded] = load_recording(machine, others).observations["dL"]
        rows = replace(rows, notes=tuple(note for note in rows.notes if not note.startswith("column 'dL'")))
    return with_lengths(rows, found)
