"""Serial chains in plain numpy: Khalil and Kleinfinger's convention written out, apart from the library. mm and rad."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose.arrays import Array


def frame(xyz: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Return the pose (4, 4) at xyz that is turned by Rz(yaw) Ry(pitch) Rx(roll)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler("xyz", np.asarray(rpy, dtype=float)).as_matrix(), xyz
    return out


def frame_of(values: Mapping[str, float], name: str) -> Array:
    """Return the pose (4, 4) of a frame whose six parameters are among these."""
    return frame([values[f"{name}.{a}"] for a in "xyz"], [values[f"{name}.r{a}"] for a in "xyz"])


def step(row: ArrayLike, q: float | Array = 0.0) -> Array:
    """Return RotY(beta) RotX(alpha) TransX(d) RotZ(theta + q) TransZ(r), shape (..., 4, 4) for q (...)."""
    beta, alpha, d, theta, r = np.asarray(row, dtype=float)
    fixed = Rotation.from_euler("YX", [beta, alpha]).as_matrix()
    turned = fixed @ Rotation.from_rotvec(np.multiply.outer(theta + q, [0.0, 0.0, 1.0])).as_matrix()
    out = np.zeros((*np.shape(q), 4, 4))
    out[..., :3, :3], out[..., 3, 3] = turned, 1.0
    out[..., :3, 3] = d * fixed[:, 0] + r * turned[..., :, 2]
    return out


def chain(rows: Iterable[ArrayLike], q: ArrayLike, base: Array, tool: Array) -> Array:
    """Return the pose of the tool, shape (..., 4, 4), at joint variables q of shape (..., k)."""
    out = base
    for row, reading in zip(rows, np.moveaxis(np.asarray(q), -1, 0), strict=True):
        out = out @ step(row, reading)
    return out @ tool
