"""Write a pose as numbers, and read it: Euler angles, quaternions, rotation vectors; write one number.

Several sets of numbers mean the same rotation. The one next to the numbers that stood there before is taken, so that
a small correction changes them little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.models import lie
from truepose.models.units import convert

_LOCKED = 1e-9
"""Cosine of the middle angle below which the other two only count together."""


@dataclass(frozen=True)
class Euler:
    """x y z in mm and A B C in deg, Rz(A) Ry(B) Rx(C): KUKA."""

    decimals: tuple[int, ...] = (4, 4, 4, 6, 6, 6)
    words: str = "x,y,z,a,b,c in mm and deg"

    def poses(self, numbers: Array) -> Array:
        turn = Rotation.from_euler("ZYX", numbers[:, 3:], degrees=True).as_matrix()
        return lie.pose_of(turn, numbers[:, :3])

    def numbers(self, poses: Array, near: Array) -> Array:
        angles = np.array([_euler(pose[:3, :3], old) for pose, old in zip(poses, near[:, 3:], strict=True)])
        return np.hstack([poses[:, :3, 3], angles.reshape(-1, 3)])


@dataclass(frozen=True)
class Quaternion:
    """x y z in mm and a quaternion, its scalar first: ABB. The norm of the numbers that stood there is kept."""

    decimals: tuple[int, ...] = (4, 4, 4, 8, 8, 8, 8)
    words: str = "x,y,z,q1,q2,q3,q4 in mm"

    def poses(self, numbers: Array) -> Array:
        turn = Rotation.from_quat(numbers[:, [4, 5, 6, 3]]).as_matrix()
        return lie.pose_of(turn, numbers[:, :3])

    def numbers(self, poses: Array, near: Array) -> Array:
        quaternion = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
        sign = np.where(np.sum(quaternion * near[:, 3:], axis=1) < 0, -1.0, 1.0)
        norm = np.linalg.norm(near[:, 3:], axis=1)
        return np.hstack([poses[:, :3, 3], (sign * norm)[:, None] * quaternion])


@dataclass(frozen=True)
class RotationVector:
    """x y z and a rotation vector, in units of their own: Universal Robots (m, rad), tables of points."""

    lengths: tuple[str, str, str]
    angles: tuple[str, str, str]
    decimals: tuple[int, ...]
    words: str

    def poses(self, numbers: Array) -> Array:
        place = np.column_stack([convert(numbers[:, k], u, "mm") for k, u in enumerate(self.lengths)])
        turn = np.column_stack([convert(numbers[:, 3 + k], u, "rad") for k, u in enumerate(self.angles)])
        return lie.pose_of(lie.exp_so3(turn), place)

    def numbers(self, poses: Array, near: Array) -> Array:
        turn = lie.log_so3(poses[:, :3, :3])
        old = np.column_stack([convert(near[:, 3 + k], u, "rad") for k, u in enumerate(self.angles)])
        turn = np.array([_whole_turns(a, b) for a, b in zip(turn, old, strict=True)]).reshape(-1, 3)
        return np.column_stack(
            [
                *(convert(poses[:, k, 3], "mm", u) for k, u in enumerate(self.lengths)),
                *(convert(turn[:, k], "rad", u) for k, u in enumerate(self.angles)),
            ]
        )


Form = Euler | Quaternion | RotationVector
"""How a pose is written. ``decimals`` (k,): at least so many are written of each number; ``words`` names the numbers.

``poses`` (n, 4, 4), mm, of numbers (n, k); ``numbers`` (n, k) of poses, of those that mean the same the ones next to ``near``.
"""


def numbers_of(form: Form, pose: Array) -> tuple[float, ...]:
    """Return the numbers of one pose (4, 4), mm."""
    return tuple(form.numbers(pose[None], np.zeros((1, len(form.decimals))))[0].tolist())


def _euler(rotation: Array, old: Array) -> Array:
    """(3,) A B C in deg of a rotation (3, 3), next to ``old`` (3,)."""
    cosine = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    if cosine < _LOCKED:  # A and C count together: A stays
        a = np.radians(old[0])
        rest = Rotation.from_euler("Z", -a).as_matrix() @ rotation
        b, c = np.arctan2(-rest[2, 0], rest[0, 0]), np.arctan2(-rest[1, 2], rest[1, 1])
    else:
        a = np.arctan2(rotation[1, 0], rotation[0, 0])
        b = np.arctan2(-rotation[2, 0], cosine)
        c = np.arctan2(rotation[2, 1], rotation[2, 2])
    one = np.degrees([a, b, c])
    both = [one, np.array([one[0] + 180.0, 180.0 - one[1], one[2] + 180.0])]
    near = [angles + 360.0 * np.round((old - angles) / 360.0) for angles in both]
    return min(near, key=lambda angles: float(np.sum((angles - old) ** 2)))


def _whole_turns(vector: Array, old: Array) -> Array:
    """The rotation vector (3,) by whole turns next to ``old`` (3,), rad."""
    angle = float(np.linalg.norm(vector))
    size = float(np.linalg.norm(old))
    if angle < 1e-12:
        axis = old / size if size > np.pi else np.zeros(3)
    else:
        axis = vector / angle
    about = float(axis @ old)
    turns = np.round((about - angle) / (2 * np.pi)) + np.array([-1, 0, 1])
    near = [(angle + 2 * np.pi * k) * axis for k in turns]
    return min([vector, *near], key=lambda v: float(np.sum((v - old) ** 2)))


def written(value: float, before: str, decimals: int) -> str:
    """A number in the style of the text ``before`` it: no fewer decimals, its plus sign; the same text where it rounds
    to the same."""
    mantissa, _, exponent = before.lower().partition("e")
    there = len(mantissa.partition(".")[2]) - int(exponent or 0)
    places = max(decimals, there)
    if round(value, places) == round(float(before), places):
        return before
    out = f"{value:.{places}f}"
    if "." in out:  # zeros that tell nothing, but for as many as stood there
        least = len(out.partition(".")[0]) + 1 + max(there, 1)
        out = out[:least] + out[least:].rstrip("0")
    if float(out) == 0.0:
        out = out.lstrip("-")
    return f"+{out}" if before.startswith("+") and not out.startswith("-") else out
