"""Files of other programs as recordings: told apart by content, joined with a table of joints, ready to be written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from truepose.errors import InputError
from truepose.files import read_input
from truepose.identification.leaves.readers.bags import is_bag, read_bag
from truepose.identification.leaves.readers.headings import (
    XYZ,
    asked_columns,
    chosen_columns,
    is_asked,
    read_column,
)
from truepose.identification.leaves.readers.points import PROGRAMS, is_marked, read_points
from truepose.identification.leaves.readers.reading import MAGIC
from truepose.identification.leaves.readers.tpoint import is_tpoint, machine_text, read_tpoint
from truepose.identification.recording.languages import refuse_languages
from truepose.identification.recording.table import Column, Table, in_known_case, read_table, table_of
from truepose.identification.recording.text import SI, decoded
from truepose.models.units import parse_unit
from truepose.wording import joined, shortened

FORMATS: Final = ("auto", *PROGRAMS, "tpoint", "excel", "bag", "table")
_KEYS: Final = ("name", "point", "target", "pose")
"""Columns of a joints table that name each row's point."""
_READ_ALONE: Final = (
    ("dL",),
    ("length",),
    ("azimuth", "elevation"),
    ("ux", "uy", "uz"),
    ("tilt.x", "tilt.y"),
)
"""Columns of readings that are no point."""
_BEGINNING: Final = 20_000
"""Characters that tell the language of a text."""


def read_foreign(
    path: Path,
    form: str = "auto",
    *,
    unit: str | None = None,
    topic: str | None = None,
    joints: Sequence[str] = (),
    columns: str | None = None,
) -> Table:
    """A file of another program as a table; ``form`` is one of FORMATS.

    ``unit``: of the lengths of a point list; ``topic``: of the poses in a bag; ``joints``: those of a bag that matter;
    ``columns``: what columns are, ``x=TCPX,y=TCPY,z=TCPZ``. Raises InputError for an unknown format, for a file that is not of
    it, and for one that does not say which columns are x, y and z.
    """
    chosen = chosen_columns(columns)
    if form not in FORMATS:
        raise InputError(f"--format: found {form!r}, expected {joined(FORMATS, 'or')}")
    try:
        asked, form = form, _form(path) if form == "auto" else form
        if form == "bag":
            return _with_choice(table_of(str(path), read_bag(path, topic, joints)), chosen)
        if form in ("excel", "table"):
            table = _with_choice(read_table(path), chosen)
            if asked == "auto" and not _has_readings(table) and is_asked(table.names):
                raise asked_columns(table.names, table.file)
            return _with_lengths(table, unit)
        text, notes = decoded(read_input(path), str(path))
    except OSError as exc:
        raise InputError(f"{path}: cannot read the file: {exc.strerror or exc}") from None
    if form == "tpoint":
        return _with_choice(read_tpoint(text, str(path)), chosen)
    marked = form in PROGRAMS or is_marked(text)
    found = None
    if asked == "auto":
        refuse_languages(text[:_BEGINNING], str(path))
        found = _plain_table(path, chosen) if chosen or not marked else None
    if found is not None:
        return _with_lengths(found, unit)
    others = [new for new in chosen if new not in XYZ]
    if others:
        raise InputError(f"--columns: found {others[0]!r}, expected x, y and z, which a list of points has")
    found = read_points(text, str(path), unit, chosen, marked=marked)
    return replace(found, notes=(*notes, *found.notes))


def machine_of(path: Path) -> str:
    """Text of a machine file to start from, where a format tells the machine. Raises InputError where it does not."""
    if _form(path) != "tpoint":
        raise InputError(
            f"--machine: found {path}, expected TPOINT's stars: other formats say nothing of the machine"
        )
    return machine_text(decoded(read_input(path), str(path))[0], str(path))


def _form(path: Path) -> str:
    """Return the format of a file by its content; ``points`` for a text that is not TPOINT's."""
    if is_bag(path):
        return "bag"
    with path.open("rb") as stream:
        data = stream.read(4)
    if data.startswith(MAGIC):
        return "excel"
    if data.startswith(b"PAR1"):
        return "table"
    return "tpoint" if is_tpoint(decoded(read_input(path), str(path))[0]) else "points"


def _plain_table(path: Path, chosen: Mapping[str, str]) -> Table | None:
    """Return the table of a text that has one header, with readings among its columns, and rows of numbers below."""
    try:
        table = _with_choice(read_table(path), chosen)
        return table if _has_readings(table) else None
    except InputError:
        return None


def _has_readings(table: Table) -> bool:
    """Return True if columns are readings by their names. Raises InputError for cells of theirs that are no numbers."""
    names = [name for group in _groups(table) if all(name in table for name in group) for name in group]
    for name in names:
        table.readings(name)
    return bool(names)


def _groups(table: Table) -> list[tuple[str, ...]]:
    """Return columns that are readings where all of a group are there: of a point, of a direction, or of a length."""
    heads = dict.fromkeys(name[:-1] for name in table.names if name.endswith(".x"))
    return [*(tuple(f"{head}{axis}" for axis in XYZ) for head in ("", *heads)), *_READ_ALONE]


def _with_choice(table: Table, chosen: Mapping[str, str]) -> Table:
    """Return the table with columns called as chosen, and with x, y and z as their headings write them, units included."""
    for new, old in chosen.items():
        if old not in table:
            raise asked_columns(table.names, f"{table.file}: --columns: found no column {old!r}")
        if new in table:
            raise InputError(f"--columns {new}={old}: found a column {new!r} already")
    table = table.renamed({old: new for new, old in chosen.items()})
    read = {column.name: read_column(column.header) for column in table.columns}
    places = {
        name: c for name, c in read.items() if c.name in XYZ and (c.name == name or c.name not in table)
    }
    if len({column.name for column in places.values()}) < len(places):
        raise asked_columns(table.names, table.file)
    columns = tuple(places.get(column.name, column) for column in table.columns)
    renamed = table.renamed({name: column.name for name, column in places.items()})
    return in_known_case(replace(renamed, columns=columns), _KEYS)


def _with_lengths(table: Table, unit: str | None) -> Table:
    """Return the table with a unit for x, y and z without one. Raises InputError for one that is no length."""
    columns = tuple(replace(c, unit=c.unit or unit) if c.name in XYZ else c for c in table.columns)
    for column in columns:
        if column.name in XYZ and column.unit not in (None, SI):
            parse_unit(column.unit, "length", table.where(column.name))
    return replace(table, columns=columns)


def with_joints(points: Table, joints: Table) -> Table:
    """The points' columns beside those of the joints table, joined by its column of names, else in order.

    Raises InputError where numbers of rows differ, or names are not the same.
    """
    joints = in_known_case(joints, _KEYS)
    key = next((name for name in _KEYS if name in joints and "name" in points), None)
    key = key if key != "pose" or _named_alike(points, joints) else None
    order: Sequence[int] = range(points.n_rows)
    if points.n_rows != joints.n_rows:
        raise InputError(
            f"{joints.file}: found {joints.n_rows} rows of joints, expected {points.n_rows}, one for each point of "
            f"{points.file}"
        )
    if key is not None:
        order = _matched(points, joints, key)
    own = [c for c in points.columns if c.name != "name" and c.name not in joints]
    twice = [c.name for c in points.columns if c.name in joints and c.name not in ("name", "time")]
    if twice:
        raise InputError(
            f"{joints.file}: column {twice[0]!r}: found there and in {points.file}, expected it in one"
        )
    cells = {c.name: [points.cells[c.name][k] for k in order] for c in own}
    kept = joints if key in (None, "pose") else joints.without([str(key)])
    note = f"{joints.file}: joined with {points.file} by " + ("order" if key is None else f"column {key!r}")
    return replace(
        kept,
        columns=(*kept.columns, *own),
        cells={**kept.cells, **cells},
        notes=(*kept.notes, *points.notes, note),
    )


def _named_alike(points: Table, joints: Table) -> bool:
    """Whether the column `pose` holds the points' own names: a pose number may also say what is a repeat."""
    return sorted(joints.texts("pose")) == sorted(_short(name) for name in points.texts("name"))


def _matched(points: Table, joints: Table, key: str) -> list[int]:
    """Row of the points for each row of the joints."""
    names, wanted = points.texts("name"), joints.texts(key)
    at: dict[str, int] = {}
    for row, name in enumerate(names):
        for known in dict.fromkeys((name, _short(name))):
            if known in at and key != "pose":
                raise InputError(
                    f"{points.where('name', row)}: found {known!r} again, expected names that differ"
                )
            at[known] = row
    missing = [name for name in wanted if name not in at]
    if missing:
        told = shortened([repr(name) for name in missing], 4)
        raise InputError(f"{joints.file}: column {key!r}: found {told}, no point of {points.file}")
    first: dict[str, int] = {}
    again = next((k for k, name in enumerate(wanted) if first.setdefault(name, k) != k), None)
    if again is not None:
        found = f"{joints.where(key, again)}: found {wanted[again]!r} again"
        raise InputError(f"{found}, expected names that differ")
    return [at[name] for name in wanted]


def _short(name: str) -> str:
    """``P1`` of ``Collection::Group::P1`` and of ``Station/P1``."""
    return name.rpartition("::")[2].rpartition("/")[2]


def renamed(table: Table, names: Mapping[str, str]) -> Table:
    """The table with other names for columns. Raises InputError for a column that is not there, or is already."""
    for old, new in names.items():
        if old not in table:
            raise InputError(
                f"--rename {old}={new}: found no column {old!r}, expected {joined(table.names, 'or')}"
            )
        if new in table:
            raise InputError(f"--rename {old}={new}: found a column {new!r} already")
    return table.renamed(names)


def frame_of(table: Table, prismatic: Sequence[str] = ()) -> pd.DataFrame:
    """The table as it is written: units in the headers; joints of a bag in rad, in m where they are ``prismatic``."""
    out: dict[str, object] = {}
    for column in table.columns:
        unit = column.unit if column.unit != SI else "m" if column.name in prismatic else "rad"
        out[column.name if unit is None else f"{column.name} [{unit}]"] = _values(table, column)
    return pd.DataFrame(out)


def _values(table: Table, column: Column) -> object:
    try:
        values = table.readings(column.name)
    except InputError:  # texts
        return list(table.cells[column.name])
    whole = column.unit is None and np.isfinite(values).all() and not np.mod(values, 1.0).any()
    return values.astype(np.int64) if whole else values
