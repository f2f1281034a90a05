"""Which rows of a recording the machine file's section ``recordings`` means, and when their files were begun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import PurePath

import numpy as np

from truepose.arrays import Mask
from truepose.errors import InputError
from truepose.identification.recording.recording import Recording, frozen
from truepose.models.machine.machine import Equipment, Machine
from truepose.wording import joined


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
