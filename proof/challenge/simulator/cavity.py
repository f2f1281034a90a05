"""The nanopositioner's geometry: equations (4)-(29) of Bettahar et al. 2022, mm and rad.

It shares no code with truepose's models and computes the cavity another way: the light's line and the mirror's plane
are cut as equations (15)-(24) say, from 4x4 matrices multiplied one elementary motion at a time. Constants may
differ from row to row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .motions import rotation, shift

Array = NDArray[np.float64]
PRISMATIC = (True, True, True, False, False, False)


@dataclass(frozen=True)
class Constants:
    """Everything the paper identifies: ``rows`` (..., 6, 5) beta alpha d theta r; ``beam`` (..., 5) x y z beta theta;
    ``mirror`` (..., 3) z beta theta. mm, rad; beam angles as they act, 90 deg included. Leading axes: rows or none."""

    rows: Array
    beam: Array
    mirror: Array


def end_effector(constants: Constants, q: Array, errors: Array | None = None) -> Array:
    """(n, 4, 4) world to end effector, equation (12), for joints (n, 6) in mm and rad.

    ``errors`` (n, 6, 4, 4): what each joint's slide or bearing adds behind its motion.
    """
    q = np.atleast_2d(q)
    out = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for k, prismatic in enumerate(PRISMATIC):
        beta, alpha, d, theta, r = np.moveaxis(constants.rows[..., k, :], -1, 0)
        turned, moved = (theta, r + q[:, k]) if prismatic else (theta + q[:, k], r)
        out = (
            out @ rotation(1, beta) @ rotation(0, alpha) @ shift(0, d) @ rotation(2, turned) @ shift(2, moved)
        )
        out = out if errors is None else out @ errors[:, k]
    return out


def mirror_pose(constants: Constants, q: Array, errors: Array | None = None) -> Array:
    """(n, 4, 4) world to mirror, equation (19)."""
    z, beta, theta = np.moveaxis(constants.mirror, -1, 0)
    return end_effector(constants, q, errors) @ shift(2, z) @ rotation(0, beta) @ rotation(1, theta)


def light(constants: Constants) -> tuple[Array, Array]:
    """Origin (..., 3) and direction (..., 3) of the light in the world: fourth and third column of equation (13)."""
    x, y, z, beta, theta = np.moveaxis(constants.beam, -1, 0)
    frame = shift(0, x) @ shift(1, y) @ shift(2, z) @ rotation(0, beta) @ rotation(2, theta)
    return frame[..., :3, 3], frame[..., :3, 2]


def cavity(constants: Constants, mirror: Array) -> Array:
    """(n,) cavity length for mirror poses (n, 4, 4): equations (18) and (24), mm."""
    origin, along = light(constants)
    plane = mirror[:, :3, 2]
    level = -np.sum(plane * mirror[:, :3, 3], axis=1)
    return np.asarray(-(np.sum(plane * origin, axis=1) + level) / np.sum(plane * along, axis=1))


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


__all__ = [
    "PRISMATIC",
    "Constants",
    "cavity",
    "end_effector",
    "lengths",
    "light",
    "mirror_pose",
    "normals",
    "reflection",
]
