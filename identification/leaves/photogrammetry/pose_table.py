"""A table of points measured on a body in several placements, as the columns of a ``pose`` sensor.

Use ``pose_table`` where a machine file has ``sensor: {type: pose}`` and the metrology gave points.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.leaves.photogrammetry.body_pose import FEWEST, BodyPose, body_pose
from truepose.identification.recording.table import Table, read_table
from truepose.models import lie
from truepose.models.units import UnitSystem, convert
from truepose.wording import close_matches

POINT, AXES = "point", ("x", "y", "z")


# -- Files of measured points (CSV or Parquet): the placements, and the body that carries the points. mm


def read_points(path: Path) -> pd.DataFrame:
    """One row a placement: points' columns (``P1.x P1.y P1.z ...``) in mm, NaN where empty; others as they stand.

    A column may carry a unit, ``P1.x [um]``. Raises InputError naming file, row and column for what is no number.
    """
    table = read_table(path)
    out: dict[str, object] = {}
    for column in table.columns:
        if COORDINATE.match(column.name):
            out[column.name] = _lengths(table, column.name)
        else:
            unit = "" if column.unit is None else f" [{column.unit}]"
            out[f"{column.name}{unit}"] = list(table.cells[column.name])
    return pd.DataFrame(out)


def read_body(path: Path) -> dict[str, tuple[float, ...]]:
    """Points in the body's frame, by name, from the columns ``point x y z``. Raises InputError like ``read_points``."""
    table = read_table(path)
    for name in (POINT, *AXES):
        if name not in table:
            raise InputError(f"{path}: missing column {name!r}; {close_matches(name, table.names)}")
    names = table.texts(POINT)
    for row, name in enumerate(names):
        if name in names[:row]:
            raise InputError(f"{table.where(POINT, row)}: found {name!r} again, expected each point once")
    rows = np.column_stack([_lengths(table, axis, gaps=False) for axis in AXES])
    return {name: tuple(float(v) for v in row) for name, row in zip(names, rows, strict=True)}


def _lengths(table: Table, name: str, *, gaps: bool = True) -> Array:
    """(n,) mm; NaN for an empty cell where ``gaps`` are allowed."""
    numbers = table.readings(name) if gaps else table.numbers(name)
    return np.asarray(convert(numbers, table.unit(name, "mm", "length"), "mm"))


# -- A table of points measured on a body in several placements, as the columns of a ``pose`` sensor

COLUMNS = ("x", "y", "z", "rx", "ry", "rz")
PAIRS = tuple(itertools.combinations(COLUMNS, 2))
COORDINATE = re.compile(r"^(?P<point>.+)\.(?P<axis>[xyz])$")
"""Columns of points."""


def pose_table(
    table: pd.DataFrame,
    sigma: float,
    body: Mapping[str, Sequence[float]] | None = None,
    *,
    units: UnitSystem | None = None,
    covariance: bool = False,
) -> pd.DataFrame:
    """The table with its points' columns (``P1.x P1.y P1.z P2.x ...``) replaced by the body's pose.

    New columns: ``x y z`` and the rotation vector ``rx ry rz`` of the body's frame in the sensor's, each with
    ``<column>.std``, then ``chi2_per_dof`` and ``suspects`` (points that hardly fit, separated by blanks).
    ``body`` gives the points in the body's frame, exactly known; without it the first row is the body's shape,
    its pose zero by definition, and its noise counts in every other row. ``sigma`` is the 1-sigma of one coordinate. Lengths
    and angles, ``sigma`` and ``body`` included, are in ``units`` (default mm and deg). An empty coordinate is a
    point that was not seen. ``covariance`` adds the covariance of every two columns, ``x.y.cov`` to ``ry.rz.cov``.
    Rows with fewer than three points, or points on one line, raise InputError naming row and points.
    """
    units = units or UnitSystem()
    names = _point_names(table, body)
    measured = _coordinates(table, names)
    scale = units.to_internal(1.0, "length")
    measured, sigma = scale * measured, scale * sigma
    shape, own = _body(measured, body, names, sigma, scale)
    rows = [_row_pose(shape, points, sigma, own, names, k) for k, points in enumerate(measured, start=1)]
    if body is None:
        rows[0] = (replace(rows[0][0], covariance=np.zeros((6, 6))), rows[0][1])
    rest = [c for c in table.columns if c not in {f"{name}.{axis}" for name in names for axis in "xyz"}]
    added = pd.DataFrame([_values(*row, names, units) for row in rows], index=table.index)
    if not covariance:
        added = added.drop(columns=[f"{a}.{b}.cov" for a, b in PAIRS])
    return pd.concat([table[rest], added], axis=1)


def _point_names(table: pd.DataFrame, body: Mapping[str, Sequence[float]] | None) -> list[str]:
    """Points to use, each with its three columns."""
    columns = [str(c) for c in table.columns]
    found = dict.fromkeys(m["point"] for m in map(COORDINATE.match, columns) if m)
    names = [n for n in found if f"{n}.x" in columns] if body is None else list(body)
    for name in names:
        for axis in "xyz":
            if f"{name}.{axis}" not in columns:
                raise InputError(
                    f"missing column '{name}.{axis}'; {close_matches(f'{name}.{axis}', columns)}"
                )
    if len(names) < FEWEST:
        raise InputError(
            f"found the points {names}, expected columns P1.x P1.y P1.z ... of at least 3 points"
        )
    return names


def _coordinates(table: pd.DataFrame, names: Sequence[str]) -> Array:
    """(rows, points, 3) coordinates, NaN where a point was not seen."""
    out = np.empty((len(table), len(names), 3))
    for k, name in enumerate(names):
        for j, axis in enumerate("xyz"):
            column = table[f"{name}.{axis}"]
            try:
                out[:, k, j] = column.to_numpy(dtype=float)
            except (TypeError, ValueError):
                raise InputError(f"column '{name}.{axis}': found text, expected numbers") from None
    if np.isinf(out).any():
        row, point, _ = np.argwhere(np.isinf(out))[0]
        raise InputError(f"row {row + 1}, point {names[point]}: found infinity, expected finite numbers")
    return out


def _body(
    measured: Array,
    body: Mapping[str, Sequence[float]] | None,
    names: Sequence[str],
    sigma: float,
    scale: float,
) -> tuple[Array, float]:
    """(points, 3) shape of the body and its 1-sigma, mm."""
    if not len(measured):
        raise InputError("found no row, expected at least one")
    if body is not None:
        return scale * np.array([[float(v) for v in body[name]] for name in names]), 0.0
    return measured[0], sigma


def _row_pose(
    shape: Array, points: Array, sigma: float, own: float, names: Sequence[str], row: int
) -> tuple[BodyPose, Mask]:
    seen = np.asarray(np.isfinite(np.hstack([points, shape])).all(axis=1))
    try:
        return body_pose(shape[seen], points[seen], sigma, own), seen
    except InputError as exc:
        used = ", ".join(np.array(names)[seen]) or "none"
        raise InputError(f"row {row}: points {used}: {exc}") from None


def _values(found: BodyPose, seen: Mask, names: Sequence[str], units: UnitSystem) -> dict[str, float | str]:
    """One row: pose, 1-sigmas, fit, covariances."""
    vector = lie.log_so3(found.pose[:3, :3])
    j = np.eye(6)
    j[3:, 3:] = _by_turn(vector)
    size = np.r_[
        np.full(3, units.from_internal(1.0, "length")), np.full(3, units.from_internal(1.0, "angle"))
    ]
    covariance = np.outer(size, size) * (j @ found.covariance @ j.T)
    pose, std = size * np.r_[found.pose[:3, 3], vector], np.sqrt(np.diag(covariance))
    out: dict[str, float | str] = {}
    for suffix, values in (("", pose), (".std", std)):
        out |= {name + suffix: float(v) for name, v in zip(COLUMNS, values, strict=True)}
    out["chi2_per_dof"] = found.chi2 / found.dof
    out["suspects"] = " ".join(np.array(names)[seen][list(found.suspects)])
    upper = covariance[np.triu_indices(6, 1)]
    return out | {f"{a}.{b}.cov": float(v) for (a, b), v in zip(PAIRS, upper, strict=True)}


def _by_turn(vector: Array) -> Array:
    """(3, 3) derivative of the rotation vector by w of Exp(w) R (the inverse left Jacobian of SO(3))."""
    angle = float(np.linalg.norm(vector))
    k = np.cross(vector, np.eye(3)).T  # k @ w = vector x w
    squared = 1.0 / 12.0 if angle < 1e-4 else 1.0 / angle**2 - 0.5 / (angle * np.tan(0.5 * angle))
    return np.asarray(np.eye(3) - 0.5 * k + squared * k @ k)
