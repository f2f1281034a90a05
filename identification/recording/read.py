"""Recordings from tables: every part checked, then joined into one `Recording`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.recording.file import RecordingPart, read_part, written_units
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.recording import IntArray, Recording, frozen
from truepose.identification.recording.table import Table
from truepose.models.file.driver import DeclaredDriver, Driver
from truepose.models.units import UnitSystem


def read_recording(
    tables: Sequence[Table],
    joints: Sequence[JointColumn],
    sensor_columns: Mapping[str, str],
    units: UnitSystem,
    need_observations: bool = True,
    *,
    required: Sequence[str] = (),
    optional_labels: Sequence[str] = (),
    declared: Sequence[DeclaredDriver] = (),
    shuffled: bool = False,
    begun: Mapping[str, float] | None = None,
) -> Recording:
    """Check and join recordings; columns without a unit of their own are in the file's `units`.

    `sensor_columns` maps each column to its internal unit ("mm", "rad", "1"), or to "label" for a text.
    Without `need_observations` sensor columns may be missing. `required` names further columns that must be
    there (`from`), `optional_labels` texts to keep when they are, `declared` further drivers. ``shuffled``: rows are no visits
    one after the other, as a file's comment `order: shuffled` says, too. Raises InputError naming file, row and column.
    """
    if not tables:
        raise InputError("found no recording, expected at least one file")
    asked = {**sensor_columns, **dict.fromkeys(optional_labels, "label")}
    needed = (*(sensor_columns if need_observations else ()), *required)
    parts = [read_part(table, joints, asked, units, needed, declared) for table in tables]
    parts = _on_one_clock(parts, begun or {})
    absent = {driver.name: driver.absent for driver in declared if driver.absent is not None}
    joined = _join(parts, tuple(joint.name for joint in joints), tuple(asked), absent)
    told = [table.file for table in tables if shuffled or table.shuffled]
    if told:
        joined = replace(joined, shuffled=True, notes=(*joined.notes, _without_order(told, parts)))
    written = written_units(joints, sensor_columns, tuple(joined.drivers), units, declared)
    digests, dates = tuple(table.digest for table in tables), tuple(table.date for table in tables)
    return replace(joined, written=written, digests=digests, dates=dates)


def _on_one_clock(parts: Sequence[RecordingPart], begun: Mapping[str, float]) -> list[RecordingPart]:
    """Return the parts with times from the first date in ``begun`` on, where it has some; all rows of a file without times are
    at its date.

    Raises InputError where dates are missing and files count from different things.
    """
    if begun:
        origin = min(begun.values())

        def since(part: RecordingPart, start: float) -> Array:
            return (
                np.full(len(part.q), start - origin)
                if part.times is None
                else part.times.since(origin, start)
            )

        return [replace(part, time=since(part, begun[part.file])) for part in parts]
    timed = [(part.file, part.times.clock) for part in parts if part.times is not None]
    for file, clock in timed:
        first, expected = timed[0]
        if clock is not expected:
            raise InputError(
                f"{file}: column 'time': found {clock.value}, expected {expected.value} as in {first}: all recordings of a "
                "command share one clock"
            )
    return list(parts)


def _join(
    parts: Sequence[RecordingPart],
    joints: tuple[str, ...],
    sensor_columns: tuple[str, ...],
    absent: Mapping[str, float],
) -> Recording:
    sizes = [len(part.q) for part in parts]
    starts = np.cumsum([0, *sizes[:-1]])
    notes = [note for part in parts for note in part.notes]
    names = dict.fromkeys(name for part in parts for name in part.drivers)
    from_rows = [
        None if p.from_row is None else p.from_row + start for p, start in zip(parts, starts, strict=True)
    ]
    has_pose = any(part.pose is not None for part in parts)
    # where repeats are numbered in another file only, every row here is a pose of its own
    poses = [np.arange(len(part.q)) if part.pose is None else part.pose for part in parts]
    return Recording(
        joints=joints,
        q=frozen(np.concatenate([part.q for part in parts])),
        observations=_common(parts, "observations", sensor_columns, notes),
        labels={
            name: _labels(parts, name) for name in sensor_columns if any(name in p.labels for p in parts)
        },
        drivers=_common(parts, "drivers", tuple(names), notes, absent),
        files=tuple(part.file for part in parts),
        source_file=frozen(np.repeat(np.arange(len(parts)), sizes)),
        source_row=frozen(np.concatenate([np.arange(1, size + 1) for size in sizes])),
        session=frozen(np.concatenate(_sessions(parts))),
        session_recorded=frozen(np.repeat([part.session is not None for part in parts], sizes)),
        validation=frozen(np.concatenate([part.validation for part in parts])),
        pose=frozen(np.concatenate(poses)) if has_pose else None,
        time=_if_all([part.time for part in parts], parts, "time", notes),
        from_row=_if_all(from_rows, parts, "from", notes),
        notes=tuple(notes),
        said={n: u for n, u in parts[0].said.items() if all(part.said.get(n) == u for part in parts)},
        untried=tuple(n for n in parts[0].untried if all(n in part.untried for part in parts)),
    )


def _without_order(files: Sequence[str], parts: Sequence[RecordingPart]) -> str:
    """A note on what the rows are not asked for."""
    others = " (so are those of the other files taken)" if len(files) < len(parts) else ""
    return (
        f"{', '.join(files)}: rows are declared shuffled{others}: how joints came to a row is known from approach "
        "columns alone; what depends on their way (friction, hysteresis, creep, early reading) is not looked for"
    )


def _if_all(arrays: Sequence[Any], parts: Sequence[RecordingPart], name: str, notes: list[str]) -> Any:
    """The arrays end to end, None (with a note) when a file has none."""
    without = [part.file for part, array in zip(parts, arrays, strict=True) if array is None]
    if not without:
        return frozen(np.concatenate(arrays))
    if len(without) < len(parts):
        notes.append(f"column {name!r} is not used: {', '.join(without)} has none")
    return None


def _common(
    parts: Sequence[RecordingPart],
    group: str,
    names: Sequence[str],
    notes: list[str],
    absent: Mapping[str, float] | None = None,
) -> dict[str, Array]:
    """Columns of all files end to end; in a file that has none, what is known to hold then (``absent``)."""
    joined, known = {}, absent or {}
    for name in names:
        every = [getattr(part, group) for part in parts]
        arrays = [columns.get(Driver.of(name).served_by(columns)) for columns in every]
        if name in known:
            pairs = zip(parts, arrays, strict=True)
            arrays = [np.full(len(part.q), known[name]) if own is None else own for part, own in pairs]
        values = _if_all(arrays, parts, name, notes)
        if values is not None:
            joined[name] = values
    return joined


def _labels(parts: Sequence[RecordingPart], name: str) -> tuple[str, ...]:
    return tuple(text for part in parts for text in part.labels.get(name, ("",) * len(part.q)))


def _sessions(parts: Sequence[RecordingPart]) -> list[IntArray]:
    """Session numbers of every file; a file without gets the next number nobody recorded."""
    recorded = [part.session for part in parts if part.session is not None]
    following = 1 + max((int(numbers.max()) for numbers in recorded), default=0)
    out = []
    for part in parts:
        if part.session is None:
            out.append(np.full(len(part.q), following, dtype=np.int64))
            following += 1
        else:
            out.append(part.session)
    return out
