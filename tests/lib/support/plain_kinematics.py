"""Serial chains in plain numpy: Khalil and Kleinfinger's convention written out, apart from the library. mm and rad."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose.arrays import Array


def frame(xyz: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Return the pose (4, 4) at xyz that is turned by Rz(yaw) Ry(pitch) Rx(roll)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler("xyz", np.asarray(rpy, dtype=float)).as_matrix(), xyz
    return out


def step(row: ArrayLike, q: float | Array = 0.0) -> Array:
    """Return RotY(beta) RotX(alpha) TransX(d) RotZ(theta + q) TransZ(r), shape (..., 4, 4) for q (...)."""
    beta, alpha, d, theta, r = np.asarray(row, dtype=float)
    fixed = Rotation.from_euler("YX", [beta, alpha]).as_matrix()
    turned = fixed @ Rotation.from_rotvec(np.multiply.outer(theta + q, [0.0, 0.0, 1.0])).as_matrix()
    out = np.zeros((*np.shape(q), 4, 4))
    out[..., :3, :3], out[..., 3, 3] = turned, 1.0
    out[..., :3, 3] = d * fixed[:, 0] + r * turned[..., :, 2]
    return out
