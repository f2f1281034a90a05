"""Rotations as 3x3 matrices, written so that a complex step passes through them.

Every function takes any number of leading axes. Angles in rad. Products `w*w` are never conjugated: the
equilibrium's exact derivatives are taken as imag(f(x + ih))/h.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

# arcsin(s)/s = sum_k c_k s^(2k); ten terms hold to rounding for angles below 0.2 rad
_ARCSIN_SERIES = (1.0, 1 / 6, 3 / 40, 15 / 336, 105 / 3456, 945 / 42240, 10395 / 599040, 135135 / 9676800)


def hat(w: Array) -> Array:
    """(..., 3) vector to the (..., 3, 3) matrix of its cross product."""
    zero = np.zeros_like(w[..., 0])
    rows = [
        np.stack([zero, -w[..., 2], w[..., 1]], axis=-1),
        np.stack([w[..., 2], zero, -w[..., 0]], axis=-1),
        np.stack([-w[..., 1], w[..., 0], zero], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def exp_so3(w: Array) -> Array:
    """Rotation matrix (..., 3, 3) of the rotation vector w (..., 3), rad (Rodrigues)."""
    t2 = np.sum(w * w, axis=-1)[..., None, None]
    small = np.abs(t2) < 1e-4
    t = np.sqrt(np.where(small, 1.0, t2))
    sinc = np.where(small, 1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42)), np.sin(t) / t)
    cosc = np.where(small, 0.5 - t2 / 24 * (1 - t2 / 30 * (1 - t2 / 56)), (1 - np.cos(t)) / (t * t))
    W = hat(w)
    return np.asarray(np.eye(3) + sinc * W + cosc * (W @ W))


def log_small(R: Array) -> Array:
    """Rotation vector (..., 3) of a rotation below 0.2 rad, by the series of arcsin(s)/s."""
    v = 0.5 * np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    s2 = np.sum(v * v, axis=-1)[..., None]
    factor = np.zeros_like(s2)
    for c in reversed(_ARCSIN_SERIES):
        factor = factor * s2 + c
    return np.asarray(v * factor)


def rpy_matrix(rpy: Array) -> Array:
    """(3, 3) Rz(yaw) Ry(pitch) Rx(roll) of rpy = (roll, pitch, yaw) (3,), rad."""
    roll, pitch, yaw = (np.array(v) for v in np.eye(3) * np.asarray(rpy)[:, None])
    return exp_so3(yaw) @ exp_so3(pitch) @ exp_so3(roll)


def transform(R: Array, p: Array) -> Array:
    """(..., 4, 4) transforms of rotations R (..., 3, 3) and translations p (..., 3), mm."""
    T = np.zeros((*p.shape[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T
