"""Rigid motions by numbers, many at once: exponentials, logarithms and adjoints of twists [v; w] (mm, rad)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_SMALL = 1e-6


def skew(v: Array) -> Array:
    """(n, 3, 3) matrices of the cross product with (n, 3)."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - out.transpose(0, 2, 1)


def exp(twists: Array) -> Array:
    """(n, 4, 4) motions of twists (n, 6)."""
    w = skew(twists[:, 3:])
    angle = np.linalg.norm(twists[:, 3:], axis=1)[:, None, None]
    near = np.maximum(angle, _SMALL)
    small = angle < _SMALL
    a = np.where(small, 1 - angle**2 / 6, np.sin(near) / near)
    b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(near)) / near**2)
    c = np.where(small, 1 / 6 - angle**2 / 120, (near - np.sin(near)) / near**3)
    out = np.zeros((len(twists), 4, 4))
    out[:, :3, :3] = np.eye(3) + a * w + b * (w @ w)
    along = np.eye(3) + b * w + c * (w @ w)
    out[:, :3, 3] = np.einsum("nij,nj->ni", along, twists[:, :3])
    out[:, 3, 3] = 1.0
    return out


def gap(motions: Array) -> Array:
    """(n, 6) twists of motions that are nearly the identity, to first order; zero only at the identity."""
    turn = motions[:, :3, :3]
    w = 0.5 * np.column_stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]
    )
    return np.hstack([motions[:, :3, 3], w])


def adjoint(poses: Array) -> Array:
    """(n, 6, 6) that takes twists of a frame to the frame its pose is told in (eq. A-1)."""
    out = np.zeros((len(poses), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = poses[:, :3, :3]
    out[:, :3, 3:] = skew(poses[:, :3, 3]) @ poses[:, :3, :3]
    return out


def inverse(poses: Array) -> Array:
    """Inverse of (..., 4, 4) poses."""
    out: Array = np.array(np.linalg.inv(poses), dtype=float)
    return out


def shift(xyz: Array, azimuth: float = 0.0) -> Array:
    """(4, 4) Trans(xyz) Rz(azimuth)."""
    out: Array = exp(np.array([[0.0, 0.0, 0.0, 0.0, 0.0, azimuth]]))[0]
    out[:3, 3] = xyz
    return out
