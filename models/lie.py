"""Rotations SO(3) and rigid motions SE(3), symbolic (CasADi SX) and numeric (numpy, batched).

Use ``rot_x, rot_y, rot_z, translation, transform`` to build symbolic 4x4 transforms from machine constants,
``log_so3_sx`` for a smooth small rotation error, and the numpy functions for values.
Rotation vectors are in rad; a twist is [v; w] in the world frame: p + v, Exp(w) R.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, wraps

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose.arrays import Array

AXES = ("x", "y", "z", "rx", "ry", "rz")
"""Components of a pose or a twist."""


Formula = Callable[[ca.SX], ca.SX]


def _repeated(size: int) -> Callable[[Formula], Formula]:
    """Decorate a formula of ``size`` numbers: to repeat its recorded operations is ten times as fast as Python."""

    def decorate(formula: Formula) -> Formula:
        @cache
        def recorded() -> ca.Function:
            v = ca.SX.sym("v", size)
            return ca.Function("formula", [v], [formula(v)])

        @wraps(formula)
        def repeat(v: ca.SX) -> ca.SX:
            result: ca.SX = recorded()(v if isinstance(v, ca.SX) else ca.SX(v))
            return result

        return repeat

    return decorate


@_repeated(1)
def rot_x(angle: ca.SX) -> ca.SX:
    """4x4 rotation about x."""
    c, s = ca.cos(angle), ca.sin(angle)
    return _embed(ca.vertcat(_row(1, 0, 0), _row(0, c, -s), _row(0, s, c)))


@_repeated(1)
def rot_y(angle: ca.SX) -> ca.SX:
    """4x4 rotation about y."""
    c, s = ca.cos(angle), ca.sin(angle)
    return _embed(ca.vertcat(_row(c, 0, s), _row(0, 1, 0), _row(-s, 0, c)))


@_repeated(1)
def rot_z(angle: ca.SX) -> ca.SX:
    """4x4 rotation about z."""
    c, s = ca.cos(angle), ca.sin(angle)
    return _embed(ca.vertcat(_row(c, -s, 0), _row(s, c, 0), _row(0, 0, 1)))


def translation(x: ca.SX, y: ca.SX, z: ca.SX) -> ca.SX:
    """4x4 translation, mm."""
    return _translation(ca.vertcat(x, y, z))


@_repeated(3)
def _translation(xyz: ca.SX) -> ca.SX:
    return transform(ca.SX.eye(3), xyz)


def transform(rotation: ca.SX, position: ca.SX) -> ca.SX:
    """4x4 transform of a 3x3 rotation and a position."""
    return ca.vertcat(ca.horzcat(rotation, position), _last_row())


@cache
def _last_row() -> ca.SX:
    return ca.SX(ca.horzcat(0, 0, 0, 1))


def inverse(pose: ca.SX) -> ca.SX:
    """The inverse of a pose (4, 4)."""
    turn = pose[:3, :3].T
    return transform(turn, -turn @ pose[:3, 3])


def rpy_transform(xyz: Sequence[ca.SX], rpy: Sequence[ca.SX]) -> ca.SX:
    """Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll), rpy = (roll, pitch, yaw)."""
    return _rpy_transform(ca.vertcat(*xyz, *rpy))


@_repeated(6)
def _rpy_transform(v: ca.SX) -> ca.SX:
    return ca.mtimes([_translation(v[:3]), rot_z(v[5]), rot_y(v[4]), rot_x(v[3])])


@_repeated(3)
def skew(v: ca.SX) -> ca.SX:
    """3x3 matrix of the cross product with v."""
    return ca.vertcat(_row(0, -v[2], v[1]), _row(v[2], 0, -v[0]), _row(-v[1], v[0], 0))


def vee(m: ca.SX) -> ca.SX:
    """Vector of the skew part of a 3x3 matrix."""
    return 0.5 * ca.vertcat(m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])


def axis_rotation(axis: ca.SX, angle: ca.SX) -> ca.SX:
    """3x3 rotation by ``angle`` about a unit ``axis`` (Rodrigues)."""
    k = skew(axis)
    return ca.SX.eye(3) + ca.sin(angle) * k + (1 - ca.cos(angle)) * ca.mtimes(k, k)


@_repeated(3)
def mrp_rotation(s: ca.SX) -> ca.SX:
    """3x3 rotation of modified Rodrigues parameters s = tan(angle / 4) axis.

    Rational and smooth for every turn below a full one, so Newton's method never meets a singular chart.
    """
    k, n = skew(s), ca.dot(s, s)
    return ca.SX.eye(3) + (4 * (1 - n) * k + 8 * ca.mtimes(k, k)) / (1 + n) ** 2


def log_so3_sx(rotation: ca.SX) -> ca.SX:
    """Rotation vector of a 3x3 rotation, smooth at the identity (turns below 180 deg)."""
    w = vee(rotation)
    sine = ca.sqrt(ca.dot(w, w) + 1e-30)
    cosine = 0.5 * (ca.trace(rotation) - 1)
    return ca.atan2(sine, cosine) / sine * w


def unit_vector(v: Sequence[float]) -> Array:
    """(3,) a vector's direction, however small or large it is. Zero has none and stays zero."""
    largest = max(map(abs, v))
    scaled = np.array(v, dtype=float) / (largest or 1.0)
    return np.asarray(scaled / (np.linalg.norm(scaled) or 1.0))


def exp_so3(w: Array) -> Array:
    """(..., 3) rotation vectors to (..., 3, 3) rotations."""
    w = np.asarray(w, dtype=float)
    return Rotation.from_rotvec(w.reshape(-1, 3)).as_matrix().reshape(*w.shape[:-1], 3, 3)


def log_so3(rotation: Array) -> Array:
    """(..., 3, 3) rotations to (..., 3) rotation vectors with angle in [0, pi]."""
    rotation = np.asarray(rotation, dtype=float)
    flat = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*rotation.shape[:-2], 3)


def rpy_of(rotation: Array) -> Array:
    """(3,) roll, pitch, yaw (rad) of a rotation (3, 3) = Rz(yaw) Ry(pitch) Rx(roll)."""
    yaw, pitch, roll = Rotation.from_matrix(rotation).as_euler("ZYX")
    return np.array([roll, pitch, yaw])


def rpy_matrix(rpy: ArrayLike) -> Array:
    """(3, 3) rotation Rz(yaw) Ry(pitch) Rx(roll) of (roll, pitch, yaw) (3,), rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def nearest_rotation(matrix: Array) -> Array:
    """(..., 3, 3) rotations closest to matrices (..., 3, 3) (Kabsch; Umeyama, PAMI 13, 1991)."""
    u, _, vt = np.linalg.svd(matrix)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return np.asarray(u @ vt)


def pose_of(rotation: ArrayLike, position: ArrayLike) -> Array:
    """(..., 4, 4) poses of rotations (..., 3, 3) and positions (..., 3)."""
    turn, place = np.asarray(rotation), np.asarray(position)
    out = np.zeros((*np.broadcast_shapes(turn.shape[:-2], place.shape[:-1]), 4, 4))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = turn, place, 1.0
    return out


def inverse_pose(pose: Array) -> Array:
    """(..., 4, 4) inverses of transforms (..., 4, 4)."""
    turn = np.swapaxes(pose[..., :3, :3], -1, -2)
    return pose_of(turn, -np.einsum("...ij,...j->...i", turn, pose[..., :3, 3]))


def _row(a: ca.SX | float, b: ca.SX | float, c: ca.SX | float) -> ca.SX:
    row: ca.SX = ca.horzcat(ca.SX(a), ca.SX(b), ca.SX(c))
    return row


def _embed(rotation: ca.SX) -> ca.SX:
    return transform(rotation, ca.SX.zeros(3, 1))
