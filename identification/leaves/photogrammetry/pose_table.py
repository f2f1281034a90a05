"""A table of points measured on a body in several placements, as the columns of a ``pose`` sensor.

Use ``pose_table`` where a machine file has ``sensor: {type: pose}`` and the metrology gave points.

Displacement of a rigid body from points measured on it before and after: pose, covariance, suspects.

Use ``body_pose`` for photogrammetry or tracker points of one body in two placements; it needs no idea of the
body's shape. (Frames of a cylinder, as in the telescope paper, section 3.1, err by more.)
``pose_table`` turns a whole table of points into the columns of a ``pose`` sensor.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.stats import chi2 as chi2_distribution

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.fit.align import rigid_motion
from truepose.identification.recording.table import Table, read_table
from truepose.models import lie
from truepose.models.lie import pose_of
from truepose.models.units import convert
from truepose.wording import close_matches

# -- Displacement of a rigid body from points measured on it before and after: pose, covariance, suspects

FEWEST = 3
LOOSE = 0.3
"""rad; a rotation whose 1-sigma is larger is not determined, and its linear covariance would mean nothing."""
SUSPICIOUS = 0.01
"""Chance that any good point of a body is called suspect."""
_FLAT = 1e-6


@dataclass(frozen=True)
class BodyPose:
    """Where a body went: ``after = R before + t``, with what the n points say about it.

    pose (4, 4) [R t], mm; covariance (6, 6) of the twist [v; w] (mm, rad) in the frame of ``after``: the true
    pose is Exp(w) R, t + v; residuals (n, 3) after less displaced before, mm; sigma: 1-sigma of one of their coordinates
    before the fit, mm; lever (n, 3) adjusted points less t, mm.
    """

    pose: Array
    covariance: Array
    residuals: Array
    sigma: float
    lever: Array

    @property
    def std(self) -> Array:
        """(6,) 1-sigma of the twist, mm and rad."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def chi2(self) -> float:
        """Sum of squared residuals in units of the noise."""
        return float(np.sum((self.residuals / self.sigma) ** 2))

    @property
    def dof(self) -> int:
        """Degrees of freedom of ``chi2``."""
        return 3 * len(self.residuals) - 6

    @cached_property
    def drops(self) -> Array:
        """(n,) what chi2 falls by when a point is left out; chi2 with 3 degrees of freedom for a good point."""
        r, j = self.residuals / self.sigma, _rows(self.lever) / self.sigma
        spread, axes = np.linalg.eigh(np.eye(3) - j @ self.covariance @ j.transpose(0, 2, 1))
        # a direction in which the others say nothing cannot be checked
        gain = np.divide(1.0, spread, out=np.zeros_like(spread), where=spread > _FLAT)
        return np.asarray(np.sum(gain * np.einsum("nij,ni->nj", axes, r) ** 2, axis=1))

    @property
    def suspects(self) -> tuple[int, ...]:
        """Points that hardly belong to the rigid body, worst first (none can be told among three).

        One bad point drags its neighbours: leave the worst out and fit again before judging the others.
        """
        if len(self.residuals) <= FEWEST:
            return ()
        limit = chi2_distribution.isf(SUSPICIOUS / len(self.residuals), 3)
        return tuple(int(k) for k in np.argsort(-self.drops) if self.drops[k] > limit)


def body_pose(before: ArrayLike, after: ArrayLike, sigma_after: float, sigma_before: float = 0.0) -> BodyPose:
    """Rigid displacement between corresponding points ``before`` and ``after``, both (n, 3), mm, n >= 3.

    The noise of either scatter is the 1-sigma (mm) of every coordinate; errors of different points are independent. The least
    sum of squares of after - (R before + t) is maximum likelihood for noise in both scatters, and found exactly by a singular
    value decomposition (Haralick et al., IEEE Trans. SMC 19, 1989). Raises InputError where a rotation is not determined,
    saying which.
    """
    x, y = _points(before, "before"), _points(after, "after")
    if x.shape != y.shape:
        raise InputError(
            f"found {len(x)} points before and {len(y)} after, expected pairs of the same point in each row"
        )
    if len(x) < FEWEST:
        raise InputError(f"found {len(x)} points, expected at least 3 that are not on one line")
    for what, size in (("sigma_before", sigma_before), ("sigma_after", sigma_after)):
        if not (np.isfinite(size) and size >= 0.0):
            raise InputError(f"{what}: found {size}, expected a number >= 0, mm")
    sigma = float(np.hypot(sigma_before, sigma_after))
    if sigma == 0.0:
        raise InputError("found no noise, expected sigma > 0 in one scatter or both")
    turn, shift = rigid_motion(x, y)
    arm = turn @ x.mean(axis=0)
    r = y - x @ turn.T - shift
    lever = y - (sigma_after / sigma) ** 2 * r - shift
    j = _rows(lever - arm).reshape(-1, 6) / sigma  # about the middle, where it is well conditioned
    information = j.T @ j
    _refuse_loose(information, turn)
    about = np.eye(6)
    about[:3, 3:] = -_rows(arm[None])[0, :, 3:]  # motion of the origin by a twist about the middle
    return BodyPose(pose_of(turn, shift), about @ np.linalg.inv(information) @ about.T, r, sigma, lever)


def _rows(lever: Array) -> Array:
    """(n, 3, 6) motion of points ``lever`` (n, 3) by the twist [v; w]: v + w x lever."""
    out = np.zeros((len(lever), 3, 6))
    out[:, :, :3] = np.eye(3)
    out[:, [0, 1, 2], [4, 5, 3]] = lever[:, [2, 0, 1]]
    out[:, [0, 1, 2], [5, 3, 4]] = -lever[:, [1, 2, 0]]
    return out


def _points(points: ArrayLike, what: str) -> Array:
    p = np.asarray(points, dtype=float)
    if p.ndim != 2 or p.shape[1] != 3:
        raise InputError(f"{what}: found an array of shape {p.shape}, expected (n, 3): x y z of each point")
    bad = np.flatnonzero(~np.isfinite(p).all(axis=1))
    if bad.size:
        raise InputError(f"{what}: point {bad[0]}: found {p[bad[0]]}, expected finite numbers")
    return p


def _refuse_loose(information: Array, turn: Array) -> None:
    """InputError where the points leave a rotation free, named by its axis in the frame of ``before``."""
    shifts, mixed, turns = information[:3, :3], information[:3, 3:], information[3:, 3:]
    strength, axes = np.linalg.eigh(turns - mixed.T @ np.linalg.solve(shifts, mixed))
    loose = strength < np.maximum(LOOSE**-2, 1e-14 * strength[-1])
    if not loose.any():
        return
    if loose.sum() > 1:
        raise InputError(
            "the points coincide within their noise: no rotation is determined; expected 3 that are apart and not on one line"
        )
    axis = turn.T @ axes[:, 0]
    axis = np.round(axis * np.sign(axis[np.argmax(np.abs(axis))]), 3) + 0.0
    raise InputError(
        f"the points lie on one line within their noise: the rotation about ({axis[0]:.3f}, {axis[1]:.3f}, {axis[2]:.3f}) "
        "(frame of the points before) is not determined; expected a point off that line"
    )


# -- A table of points measured on a body in several placements, as the columns of a ``pose`` sensor

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
