"""Recordings whose changes of length are counted from photocurrents, where their files have no column ``dL``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from truepose.errors import InputError
from truepose.identification.leaves.fringes.lengths import read_fringes, sensor_of, with_lengths
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
    if irradiance:
        sensor_of(machine)
    counted = any(isinstance(sensor, Irradiance) for sensor in machine.sensors)
    lacking = _to_count(files, len(irradiance)) if counted else []
    if not lacking:
        return None
    rows = load_recording(machine, files, without="dL", shuffled=shuffled)
    light = {k: Path(p) for k, p in zip(lacking, irradiance, strict=True)}
    found = read_fringes(machine, rows, light, progress)
    others = [table for k, table in enumerate(files) if k not in lacking]
    if others:
        recorded = ~np.isin(rows.source_file, lacking)
        found.change[recorded] = load_recording(machine, others).observations["dL"]
        rows = replace(rows, notes=tuple(note for note in rows.notes if not note.startswith("column 'dL'")))
    return with_lengths(rows, found)


def _to_count(files: Sequence[Table], given: int) -> list[int]:
    """Which files have no column ``dL``. Raises InputError where as many photocurrents were not given."""
    lacking = [k for k, table in enumerate(files) if "dL" not in table]
    if lacking and not given:
        raise InputError(
            f"{files[lacking[0]].file}: missing column 'dL', and no --irradiance to count it from"
        )
    if given != len(lacking):
        raise InputError(
            f"--irradiance: found {given} tables, expected {len(lacking)}: one for each recording "
            "without a column 'dL', in the same order"
        )
    return lacking
