"""A frame of a cylinder of known radius from points on it (telescope paper, section 3.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose.errors import InputError
from truepose.identification.fit.leastsquares import minimise

Array = NDArray[np.float64]
_FLAT = 1e-6
_EXACT = 1e-20  # of a squared radius


def cylinder_frame(points: ArrayLike, radius: float) -> Array:
    """(4, 4) frame of a cylinder of known ``radius`` (mm) from n >= 5 points on it (n, 3), mm.

    z is the axis, from the first point towards the last; the origin is the barycentre's projection on the axis
    and x points from there to the barycentre. The axis is the line whose distances to the points fit the
    radius best: the line of least squared distances (telescope paper, section 3.1, read literally) runs through
    the barycentre, so that x would have no direction. Raises InputError where that happens.
    """
    p = np.asarray(points, dtype=float)
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < 5:
        raise InputError(
            f"found an array of shape {p.shape}, expected (n, 3) with n >= 5 points on a cylinder"
        )
    if not radius > 0.0:
        raise InputError(f"found the radius {radius:g} mm, expected more than 0: a line has no x axis")
    middle = p.mean(axis=0)
    axes = np.linalg.svd(p - middle)[2][[1, 2, 0]]  # two across, one along
    axes[0] *= np.linalg.det(axes)
    local = (p - middle) @ axes.T

    def blocks(u: Array) -> list[Array]:
        """[J r]: distances to the axis through (u0, u1, 0) along (u2, u3, 1), less the radius, in radii."""
        w, v = np.array([u[2], u[3], 1.0]), local - [u[0], u[1], 0.0]
        height = v @ w / (w @ w)
        across = v - height[:, None] * w
        away = np.linalg.norm(across, axis=1)
        out = -across[:, :2] / np.maximum(away, 1e-300)[:, None]
        return [np.column_stack([out, height[:, None] * out, away - radius]) / radius]

    starts = [
        np.array([a * radius, b * radius, 0.0, 0.0]) for a, b in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    u = min((minimise(blocks, start, tolerance=_EXACT) for start in starts), key=lambda fit: fit.cost).t
    z = np.array([u[2], u[3], 1.0]) / np.sqrt(1.0 + u[2] ** 2 + u[3] ** 2)
    foot = np.array([u[0], u[1], 0.0])
    foot = foot - (foot @ z) * z  # where the axis passes the barycentre, the origin here
    if np.linalg.norm(foot) < _FLAT * radius:
        raise InputError("the points' barycentre lies on the cylinder's axis: the x axis has no direction")
    sign = 1.0 if (local[-1] - local[0]) @ z >= 0.0 else -1.0
    across = -foot / np.linalg.norm(foot)
    turn = np.column_stack([across, np.cross(sign * z, across), sign * z])
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = axes.T @ turn, middle + axes.T @ foot
    return out
