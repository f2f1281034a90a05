"""Rotations and frames of many rows at once, mm and rad."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def turn(axis: int, angle: ArrayLike) -> Array:
    """(..., 3, 3) rotation about coordinate axis 0, 1 or 2."""
    angle = np.asarray(angle, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    out = np.zeros((*angle.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[..., axis, axis] = 1.0
    out[..., i, i], out[..., j, j] = c, c
    out[..., i, j], out[..., j, i] = -s, s
    return out


def roll_pitch_yaw(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Array:
    """(..., 3, 3) Rz(yaw) Ry(pitch) Rx(roll)."""
    R: Array = turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)
    return R


def frame(R: Array, p: Array) -> Array:
    """(..., 4, 4) from rotations (..., 3, 3) and origins (..., 3)."""
    shape = np.broadcast_shapes(R.shape[:-2], p.shape[:-1])
    out = np.zeros((*shape, 4, 4))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = R, p, 1.0
    return out


def moved(twist: Array) -> Array:
    """(..., 4, 4) shift by ``twist[..., :3]`` (mm) and rotation vector ``twist[..., 3:]`` (rad); identity for zeros."""
    w = twist[..., 3:]
    R = Rotation.from_rotvec(w.reshape(-1, 3)).as_matrix().reshape(*w.shape[:-1], 3, 3)
    return frame(R, twist[..., :3])


def rotation_vector(R: Array) -> Array:
    """(n, 3) of (n, 3, 3)."""
    vector: Array = Rotation.from_matrix(R).as_rotvec()
    return vector


def unit_vector(rng: np.random.Generator) -> Array:
    """(3,) any direction, equally likely."""
    v = rng.standard_normal(3)
    direction: Array = v / np.linalg.norm(v)
    return direction
