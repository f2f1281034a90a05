"""Read recordings for a machine, with changes of length counted from photocurrents where files have none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from truepose.errors import InputError
from truepose.identification.leaves.fringes.lengths import read_fringes, sensor_of, with_lengths
from truepose.identification.recording.load import Sources, tables
from truepose.identification.recording.load import load_recording as load_rows
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table
from truepose.models.given import MachineLike, as_machine
from truepose.models.sensors.irradiance import Irradiance


def load_recording(
    machine: MachineLike,
    source: Sources,
    *,
    need_observations: bool = True,
    irradiance: Sequence[Path | str] = (),
    shuffled: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """One or several recordings as one: paths, DataFrames or dicts of columns, in the units of the machine file unless
    a header says otherwise. Raises InputError naming file, row and column.

    ``irradiance``: tables of photocurrents, one for each file without a column ``dL``, in the same order; their
    fringes are counted. ``shuffled``: rows are no visits one after the other (a comment ``# order: shuffled`` in a file
    says the same), so that nothing is looked for that depends on how joints came to a row.
    """
    machine = as_machine(machine)
    if irradiance:
        sensor_of(machine)
    files = tables(source, machine.mechanism.readings)
    counted = need_observations and any(isinstance(sensor, Irradiance) for sensor in machine.sensors)
    lacking = _to_count(files, len(irradiance)) if counted else []
    if not lacking:
        return load_rows(machine, files, need_observations=need_observations, shuffled=shuffled)
    rows = load_rows(machine, files, without="dL", shuffled=shuffled)
    light = {k: Path(p) for k, p in zip(lacking, irradiance, strict=True)}
    found = read_fringes(machine, rows, light, progress)
    others = [table for k, table in enumerate(files) if k not in lacking]
    if others:
        recorded = ~np.isin(rows.source_file, lacking)
        found.change[recorded] = load_rows(machine, others).observations["dL"]
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
