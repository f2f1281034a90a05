"""Turns and frames for this benchmark alone, mm and rad; stacks of matrices come first."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from .pairs import Array


def turn(axis: str, angle: Array | float) -> Array:
    """(..., 4, 4) about a coordinate axis."""
    a = np.asarray(angle, dtype=float)
    out = np.zeros((*a.shape, 4, 4))
    out[..., range(4), range(4)] = 1.0
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out[..., i, i] = out[..., j, j] = np.cos(a)
    out[..., i, j], out[..., j, i] = -np.sin(a), np.sin(a)
    return out


def shift(x: Array | float = 0.0, y: Array | float = 0.0, z: Array | float = 0.0) -> Array:
    """(..., 4, 4)"""
    x, y, z = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float), np.asarray(z, float))
    out = np.zeros((*x.shape, 4, 4))
    out[..., range(4), range(4)] = 1.0
    out[..., 0, 3], out[..., 1, 3], out[..., 2, 3] = x, y, z
    return out


def frame(xyz: Array, rpy: Array) -> Array:
    """(4, 4) of roll, pitch, yaw (rad): Rz Ry Rx at xyz."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("ZYX", np.asarray(rpy)[::-1]).as_matrix()
    out[:3, 3] = xyz
    return out


def placed(section: dict[str, object] | None) -> Array:
    """(4, 4) of a frame of a machine file, mm and deg; the identity where there is none."""
    given = section or {}
    xyz, rpy = given.get("xyz", (0.0, 0.0, 0.0)), given.get("rpy", (0.0, 0.0, 0.0))
    return frame(np.array(xyz, dtype=float), np.radians(np.array(rpy, dtype=float)))


def inverse(pose: Array) -> Array:
    """(..., 4, 4)"""
    out = np.zeros_like(pose)
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    out[..., :3, :3] = turned
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", turned, pose[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def poses(columns: Array) -> Array:
    """(n, 4, 4) of x y z (mm) and a rotation vector in deg, (n, 6)."""
    out = np.zeros((len(columns), 4, 4))
    out[:, :3, 3], out[:, 3, 3] = columns[:, :3], 1.0
    out[:, :3, :3] = Rotation.from_rotvec(np.radians(columns[:, 3:])).as_matrix()
    return out


def columns(pose: Array) -> Array:
    """(n, 6) x y z and rotation vector (deg) of poses (n, 4, 4)."""
    return np.hstack([pose[:, :3, 3], np.degrees(Rotation.from_matrix(pose[:, :3, :3]).as_rotvec())])
