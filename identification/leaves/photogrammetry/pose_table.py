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

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.leaves.photogrammetry.body_pose import FEWEST, BodyPose, body_pose
from truepose.identification.recording.table import Table, read_table
from truepose.models import lie
from truepose.models.units import convert
from truepose.wording import close_matches

POINT, AXES = "point", ("x", "y", "z")


def read_points(path: Path) -> pd.DataFrame:
    """Return one row a placement: points' columns (``P1.x P1.y P1.z ...``) in mm, NaN where empty; others as they stand.

    A column may carry a unit, ``P1.x [um]``. Raises InputError naming file, row and column for what is no number.
    """
    table = read_table(path)
    out: dict[str, object] = {}
    for column in table.columns:
        if COORDINATE.match(column.name):
            out[column.name] = _lengths(table, column.name, table.readings(column.name))
        else:
            unit = "" if column.unit is None else f" [{column.unit}]"
            out[f"{column.name}{unit}"] = list(table.cells[column.name])
    return pd.DataFrame(out)


def read_body(path: Path) -> dict[str, tuple[float, ...]]:
    """Return points in the body's frame, by name, from the columns ``point x y z``. Raises InputError like ``read_points``."""
    table = read_table(path)
    for name in (POINT, *AXES):
        if name not in table:
            raise InputError(f"{path}: missing column {name!r}; {close_matches(name, table.names)}")
    names = table.texts(POINT)
    for row, name in enumerate(names):
        if name in names[:row]:
            raise InputError(f"{table.where(POINT, row)}: found {name!r} again, expected each point once")
    rows = np.column_stack([_lengths(table, axis, table.numbers(axis)) for axis in AXES])
    return dict(zip(names, map(tuple, rows.tolist()), strict=True))


def _lengths(table: Table, name: str, numbers: Array) -> Array:
    """Return the numbers (n,) of a column in mm."""
    return np.asarray(convert(numbers, table.unit(name, "mm", "length"), "mm"))


COLUMNS = ("x", "y", "z", "rx", "ry", "rz")
PAIRS = tuple(itertools.combinations(COLUMNS, 2))
COORDINATE = re.compile(r"^(?P<point>.+)\.(?P<axis>[xyz])$")
"""Columns of points."""


def pose_table(
    table: pd.DataFrame,
    sigma: float,
    body: Mapping[str, Sequence[float]] | None = None,
    *,
    covariance: bool = False,
) -> pd.DataFrame:
    """Return the table with its points' columns (``P1.x P1.y P1.z P2.x ...``) replaced by the body's pose, mm and deg.

    New columns: ``x y z`` and the rotation vector ``rx ry rz`` of the body's frame in the sensor's, each with
    ``<column>.std``, then ``chi2_per_dof`` and ``suspects`` (points that hardly fit, separated by blanks).
    ``body`` gives the points in the body's frame, exactly known; without it the first row is the body's shape,
    its pose zero by definition, and its noise counts in every other row. ``sigma`` is the 1-sigma of one coordinate. An empty
    coordinate is a point that was not seen. ``covariance`` adds the covariance of every two columns, ``x.y.cov`` to
    ``ry.rz.cov``. Rows with fewer than three points, or points on one line, raise InputError naming row and points.
    """
    names = _point_names(table, body)
    measured = _coordinates(table, names)
    if not len(measured):
        raise InputError("found no row, expected at least one")
    shape, own = measured[0], sigma
    if body is not None:
        shape, own = np.array([body[name] for name in names], dtype=float), 0.0
    rows = []
    for k, points in enumerate(measured):
        seen = np.asarray(np.isfinite(np.hstack([points, shape])).all(axis=1))
        used = np.array(names)[seen]
        try:
            found = body_pose(shape[seen], points[seen], sigma, own)
        except InputError as exc:
            raise InputError(f"row {k + 1}: points {', '.join(used) or 'none'}: {exc}") from None
        if body is None and k == 0:
            found = replace(found, covariance=np.zeros((6, 6)))
        rows.append(_values(found, " ".join(used[list(found.suspects)])))
    rest = [c for c in table.columns if c not in {f"{name}.{axis}" for name in names for axis in AXES}]
    added = pd.DataFrame(rows, index=table.index)
    if not covariance:
        added = added.drop(columns=[f"{a}.{b}.cov" for a, b in PAIRS])
    return pd.concat([table[rest], added], axis=1)


def _point_names(table: pd.DataFrame, body: Mapping[str, Sequence[float]] | None) -> list[str]:
    """Return the points to use, each with its three columns."""
    columns = [str(c) for c in table.columns]
    names = [c.removesuffix(".x") for c in columns if c.endswith(".x")] if body is None else list(body)
    for column in (f"{name}.{axis}" for name in names for axis in AXES):
        if column not in columns:
            raise InputError(f"missing column {column!r}; {close_matches(column, columns)}")
    if len(names) < FEWEST:
        raise InputError(
            f"found the points {names}, expected columns P1.x P1.y P1.z ... of at least 3 points"
        )
    return names


def _coordinates(table: pd.DataFrame, names: Sequence[str]) -> Array:
    """Return coordinates (rows, points, 3), NaN where a point was not seen."""
    out = np.empty((len(table), len(names), 3))
    for k, name in enumerate(names):
        for j, axis in enumerate(AXES):
            try:
                out[:, k, j] = table[f"{name}.{axis}"].to_numpy(dtype=float)
            except (TypeError, ValueError):
                raise InputError(f"column '{name}.{axis}': found text, expected numbers") from None
    for row, point, _ in np.argwhere(np.isinf(out)):
        raise InputError(f"row {row + 1}, point {names[point]}: found infinity, expected finite numbers")
    return out


def _values(found: BodyPose, suspects: str) -> dict[str, float | str]:
    """Return one row: pose, 1-sigmas, fit, covariances."""
    vector = lie.log_so3(found.pose[:3, :3])
    j = np.eye(6)
    j[3:, 3:] = _by_turn(vector)
    size = np.r_[np.ones(3), np.full(3, convert(1.0, "rad", "deg"))]
    covariance = np.outer(size, size) * (j @ found.covariance @ j.T)
    pose, std = size * np.r_[found.pose[:3, 3], vector], np.sqrt(np.diag(covariance))
    out: dict[str, float | str] = dict(zip(COLUMNS, pose.tolist(), strict=True))
    out |= {f"{name}.std": float(v) for name, v in zip(COLUMNS, std, strict=True)}
    out |= {"chi2_per_dof": found.chi2 / found.dof, "suspects": suspects}
    upper = covariance[np.triu_indices(6, 1)]
    return out | {f"{a}.{b}.cov": float(v) for (a, b), v in zip(PAIRS, upper, strict=True)}


def _by_turn(vector: Array) -> Array:
    """Return the (3, 3) derivative of the rotation vector by w of Exp(w) R (the inverse left Jacobian of SO(3))."""
    angle = float(np.linalg.norm(vector))
    k = np.cross(vector, np.eye(3)).T  # k @ w = vector x w
    squared = 1.0 / 12.0 if angle < 1e-4 else 1.0 / angle**2 - 0.5 / (angle * np.tan(0.5 * angle))
    return np.asarray(np.eye(3) - 0.5 * k + squared * k @ k)
