"""Rotations as instruments write them, quaternions or roll, pitch and yaw, as rotation vectors."""

from __future__ import annotations

from collections.abc import Callable
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

FORMS: Final = ("auto", "vector", "quaternion", "rpy")
_VECTOR: Final = ("rx", "ry", "rz")
_QUATERNION: Final = ("qx", "qy", "qz", "qw")
_RPY: Final = ("roll", "pitch", "yaw")
_UNIT_LENGTH: Final = 0.05
"""How far the length of a quaternion may be from 1: more is no rounding."""


def with_rotation_vector(table: Table, form: str = "auto") -> Table:
    """The table with rx ry rz [deg] for its quaternion qx qy qz qw, or for its roll pitch yaw: Rz(yaw) Ry(pitch) Rx(roll).

    ``form``: one of FORMS; ``rpy`` also reads columns rx ry rz as roll, pitch and yaw. A row with an empty cell has no
    rotation. A table without a rotation stays as it is. Raises InputError for an unknown form, for one whose columns are
    not there, and for a quaternion that is none.
    """
    if form not in FORMS:
        raise InputError(f"--rotation: found {form!r}, expected {joined(FORMS, 'or')}")
    table = in_known_case(table, (*_VECTOR, *_QUATERNION, *_RPY))
    if all(n in table for n in _QUATERNION) and form in ("auto", "quaternion"):
        return _replaced(table, _QUATERNION, _of_quaternions(table))
    for names in (_RPY, _VECTOR) if form == "rpy" else (_RPY,) if form == "auto" else ():
        if all(name in table for name in names):
            angles = np.column_stack([_degrees(table, name) for name in names])
            turned = _vectors(lambda v: Rotation.from_euler("ZYX", v, degrees=True), angles[:, ::-1])
            return _replaced(table, names, turned)
    if form == "auto" or (form == "vector" and all(name in table for name in _VECTOR)):
        return table
    wanted = {"vector": _VECTOR, "quaternion": _QUATERNION, "rpy": _RPY}[form]
    raise InputError(
        f"{table.file}: --rotation {form}: found the columns {joined(table.names)}, expected {joined(wanted)}"
    )


def has_quaternion(table: Table) -> bool:
    """Return True if a table names the four components of a quaternion."""
    return all(name in in_known_case(table, _QUATERNION) for name in _QUATERNION)


def _of_quaternions(table: Table) -> Array:
    values = np.column_stack([table.readings(name) for name in _QUATERNION])
    with np.errstate(over="ignore"):  # it is then no unit quaternion
        length = np.linalg.norm(values, axis=1)
    wrong = np.isfinite(values).all(axis=1) & ~(np.abs(length - 1.0) <= _UNIT_LENGTH)
    table.refuse("qx", wrong, lambda row: f"a quaternion of length {length[row]:.4g}", "1")
    return _vectors(Rotation.from_quat, values)


def _vectors(made: Callable[[Array], Rotation], values: Array) -> Array:
    """(n, 3) rotation vectors, deg; NaN where a cell was empty."""
    out, known = np.full((len(values), 3), np.nan), np.isfinite(values).all(axis=1)
    if known.any():
        out[known] = np.degrees(made(values[known]).as_rotvec())
    return out


def _degrees(table: Table, name: str) -> Array:
    return convert(table.readings(name), table.unit(name, "deg", "deg"), "deg")


def _replaced(table: Table, names: tuple[str, ...], vectors: Array) -> Table:
    """The table with rx ry rz [deg] for its columns ``names``."""
    rest = table.without(names)
    cells = {name: ArrowCells(vectors[:, k]) for k, name in enumerate(_VECTOR)}
    columns = (*rest.columns, *(Column(name, "deg") for name in _VECTOR))
    return replace(rest, columns=columns, cells={**rest.cells, **cells})
