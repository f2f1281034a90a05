"""Rigid motions as 4x4 matrices, one elementary motion at a time, many rows at once; mm and rad."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .rigid import frame, roll_pitch_yaw, turn

Array = NDArray[np.float64]


def rotation(axis: int, angle: float | Array) -> Array:
    """(..., 4, 4) rotation about axis 0, 1 or 2."""
    return frame(turn(axis, angle), np.zeros(3))


def shift(axis: int, length: float | Array) -> Array:
    """(..., 4, 4) translation along axis 0, 1 or 2."""
    length = np.asarray(length, dtype=float)
    out = np.zeros((*length.shape, 4, 4))
    out[..., range(4), range(4)] = 1.0
    out[..., axis, 3] = length
    return out


def placed(xyzrpy: Array) -> Array:
    """(..., 4, 4) Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll) of (..., 6)."""
    x = np.asarray(xyzrpy, dtype=float)
    return frame(roll_pitch_yaw(x[..., 3], x[..., 4], x[..., 5]), x[..., :3])


def applied(motions: Array, points: Array) -> Array:
    """(..., 3) points (..., 3) told in a frame, seen from where its pose (..., 4, 4) is told."""
    moved = np.squeeze(motions[..., :3, :3] @ points[..., None], -1) + motions[..., :3, 3]
    return np.asarray(moved, dtype=float)


__all__ = ["applied", "placed", "rotation", "shift"]
