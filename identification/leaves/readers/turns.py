"""Rotations as instruments write them, quaternions or roll, pitch and yaw, as rotation vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.recording.table import Column, Table, in_known_case
from truepose.identification.recording.text import ArrowCells
from truepose.models.units import convert
from truepose.wording import joined

_VECTOR: Final = ("rx", "ry", "rz")
_QUATERNION: Final = ("qx", "qy", "qz", "qw")
_RPY: Final = ("roll", "pitch", "yaw")
FORMS: Final = {
    "auto": (_QUATERNION, _RPY), "vector": (_VECTOR,), "quaternion": (_QUATERNION,), "rpy": (_RPY, _VECTOR),
}  # fmt: skip
"""Columns that each form reads, the first that are there."""
_UNIT_LENGTH: Final = 0.05
"""How far the length of a quaternion may be from 1: more is no rounding."""


def with_rotation_vector(table: Table, form: str = "auto") -> Table:
    """Return the table with rx ry rz [deg] for its quaternion qx qy qz qw, or its roll pitch yaw: Rz(yaw) Ry(pitch) Rx(roll).

    ``form``: one of FORMS; ``rpy`` also reads columns rx ry rz as roll, pitch and yaw. A row with an empty cell has no
    rotation. A table without a rotation stays as it is. Raises InputError for an unknown form, for one whose columns are
    not there, and for a quaternion that is none.
    """
    if form not in FORMS:
        raise InputError(f"--rotation: found {form!r}, expected {joined(FORMS, 'or')}")
    table = in_known_case(table, (*_VECTOR, *_QUATERNION, *_RPY))
    names = next((names for names in FORMS[form] if all(name in table for name in names)), None)
    if names is None and form != "auto":
        raise InputError(
            f"{table.file}: --rotation {form}: found the columns {joined(table.names)}, expected {joined(FORMS[form][0])}"
        )
    if names is None or form == "vector":
        return table
    values = _quaternions(table) if names == _QUATERNION else _angles(table, names)
    vectors, known = np.full((len(values), 3), np.nan), np.isfinite(values).all(axis=1)
    if known.any():
        turns = values[known]
        rotation = (
            Rotation.from_quat(turns)
            if names == _QUATERNION
            else Rotation.from_euler("ZYX", turns, degrees=True)
        )
        vectors[known] = np.degrees(rotation.as_rotvec())
    rest = table.without(names)
    cells = {name: ArrowCells(vectors[:, k]) for k, name in enumerate(_VECTOR)}
    columns = (*rest.columns, *(Column(name, "deg") for name in _VECTOR))
    return replace(rest, columns=columns, cells={**rest.cells, **cells})


def has_quaternion(table: Table) -> bool:
    """Return True if a table names the four components of a quaternion."""
    return all(name in in_known_case(table, _QUATERNION) for name in _QUATERNION)


def _quaternions(table: Table) -> Array:
    """Return quaternions (n, 4), NaN where a cell is empty. Raises InputError for one whose length is not 1."""
    values = np.column_stack([table.readings(name) for name in _QUATERNION])
    with np.errstate(over="ignore"):  # it is then no unit quaternion
        length = np.linalg.norm(values, axis=1)
    wrong = np.isfinite(values).all(axis=1) & ~(np.abs(length - 1.0) <= _UNIT_LENGTH)
    table.refuse("qx", wrong, lambda row: f"a quaternion of length {length[row]:.4g}", "1")
    return values


def _angles(table: Table, names: Sequence[str]) -> Array:
    """Return yaw, pitch and roll (n, 3), deg."""
    angles = [convert(table.readings(name), table.unit(name, "deg", "deg"), "deg") for name in names]
    return np.column_stack(angles[::-1])
