"""Poses as metres and roll, pitch, yaw in radians, and numbers as text that reads back the same."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array

MM_PER_M = 1000.0
_NOISE = 1e-15
"""m or rad: what is smaller came from rounding a cosine of a right angle."""


def xyz_rpy(pose: Array) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Position in m and (roll, pitch, yaw) in rad of a pose (4, 4) in mm: Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll).

    Roll is what the other two leave of the rotation, so that no digit is lost at pitch = +-90 deg.
    """
    rotation = pose[:3, :3]
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    roll = math.atan2(s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1])
    x, y, z = (clean(float(v) / MM_PER_M) for v in pose[:3, 3])
    return (x, y, z), (clean(roll), clean(pitch), clean(yaw))


def clean(value: float) -> float:
    """The value; zero (never minus zero) where it is rounding noise."""
    return value if abs(value) > _NOISE else 0.0


def cleaned(values: Array) -> list[float]:
    """A list of clean values."""
    return [clean(float(v)) for v in values]


def quaternion(rotation: Array) -> list[float]:
    """(w, x, y, z) of a rotation (3, 3), w >= 0."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return cleaned(np.array([w, x, y, z]) * (-1.0 if w < 0 else 1.0))


def text(*values: float) -> str:
    """Numbers with a space between, each the shortest that reads back as the same double."""
    return " ".join(repr(float(v)).removesuffix(".0") for v in values)
