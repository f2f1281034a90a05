"""The nanopositioner's geometry in plain numpy: equations (4)-(29) of the paper, mm and rad.

It shares no code with truepose and computes the cavity another way: the light's line and the mirror's plane are
cut as equations (15)-(24) say, from 4x4 matrices multiplied one elementary motion at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .tables import BEAM_ZERO, JOINTS, NOMINAL, PRISMATIC, Tabled

Array = NDArray[np.float64]
MM = 1e-3
"""mm in a um."""


@dataclass(frozen=True)
class Constants:
    """Everything the paper identifies: ``rows`` (6, 5) beta alpha d theta r; ``beam`` x y z beta theta;
    ``mirror`` z beta theta. mm, rad; beam angles as they act, 90 deg included."""

    rows: Array
    beam: Array
    mirror: Array

    @classmethod
    def of(cls, intrinsic: Mapping[str, float], extrinsic: Mapping[str, float]) -> Constants:
        """From tables in um and deg; what ``intrinsic`` does not name is that of Table I."""
        rows = np.zeros((6, 5))
        for k, joint in enumerate(JOINTS):
            for j, name in enumerate(("beta", "alpha", "d", "theta", "r")):
                value = intrinsic.get(f"{joint}.{name}", NOMINAL[joint].get(name, 0.0))
                rows[k, j] = value * MM if name in "dr" else np.radians(value)
        e = extrinsic
        beam = [e["x_wf"] * MM, e["y_wf"] * MM, e["z_wf"] * MM]
        beam += [np.radians(e["beta_wf"] + BEAM_ZERO), np.radians(e["theta_wf"])]
        mirror = [e["z_et"] * MM, np.radians(e["beta_et"]), np.radians(e["theta_et"])]
        return cls(rows, np.array(beam), np.array(mirror))

    @classmethod
    def tabled(cls, table: Tabled) -> Constants:
        """From one day's tables."""
        return cls.of(table.intrinsic, table.extrinsic)


def end_effector(constants: Constants, q: Array) -> Array:
    """(n, 4, 4) world to end effector, equation (12), for joints (n, 6) in mm and rad."""
    q = np.atleast_2d(q)
    out = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for k, prismatic in enumerate(PRISMATIC):
        beta, alpha, d, theta, r = constants.rows[k]
        turned, moved = (theta, r + q[:, k]) if prismatic else (theta + q[:, k], r)
        out = (
            out @ rotation(1, beta) @ rotation(0, alpha) @ shift(0, d) @ rotation(2, turned) @ shift(2, moved)
        )
    return out


def mirror_pose(constants: Constants, q: Array) -> Array:
    """(n, 4, 4) world to mirror, equation (19)."""
    z, beta, theta = constants.mirror
    return end_effector(constants, q) @ shift(2, z) @ rotation(0, beta) @ rotation(1, theta)


def light(constants: Constants) -> tuple[Array, Array]:
    """Origin (3,) and direction (3,) of the light in the world: fourth and third column of equation (13)."""
    x, y, z, beta, theta = constants.beam
    frame = shift(0, x) @ shift(1, y) @ shift(2, z) @ rotation(0, beta) @ rotation(2, theta)
    return frame[:3, 3], frame[:3, 2]


def cavity(constants: Constants, mirror: Array) -> Array:
    """(n,) cavity length for mirror poses (n, 4, 4): equations (18) and (24), mm."""
    origin, along = light(constants)
    plane = mirror[:, :3, 2]
    level = -np.sum(plane * mirror[:, :3, 3], axis=1)
    return np.asarray(-(plane @ origin + level) / (plane @ along))


def lengths(constants: Constants, q: Array) -> Array:
    """(n,) cavity length at joints (n, 6), mm."""
    return cavity(constants, mirror_pose(constants, q))


def reflection(constants: Constants, q: Array) -> tuple[Array, Array]:
    """Where the light meets the mirror: (n, 3) in the world, equation (28), and in the mirror, (29)."""
    origin, along = light(constants)
    pose = mirror_pose(constants, q)
    world = origin + cavity(constants, pose)[:, None] * along
    return world, np.einsum("nji,nj->ni", pose[:, :3, :3], world - pose[:, :3, 3])


def normals(constants: Constants, q: Array) -> Array:
    """(n, 3) mirror normals in the world."""
    return mirror_pose(constants, q)[:, :3, 2]


def rotation(axis: int, angle: float | Array) -> Array:
    """(..., 4, 4) rotation about axis 0, 1 or 2: equations (5), (6) and (8)."""
    angle = np.asarray(angle, dtype=float)
    one, two = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((*angle.shape, 4, 4))
    out[..., axis, axis] = out[..., 3, 3] = 1.0
    out[..., one, one] = out[..., two, two] = np.cos(angle)
    out[..., two, one] = np.sin(angle)
    out[..., one, two] = -np.sin(angle)
    return out


def shift(axis: int, length: float | Array) -> Array:
    """(..., 4, 4) translation along axis 0, 1 or 2: equations (7) and (9)."""
    length = np.asarray(length, dtype=float)
    out = np.zeros((*length.shape, 4, 4))
    out[..., range(4), range(4)] = 1.0
    out[..., axis, 3] = length
    return out
