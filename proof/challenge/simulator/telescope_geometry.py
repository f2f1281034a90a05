"""The telescope's geometry row by row: where rails, legs and platform stand, and the forces in the legs. mm, N."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from .base import Array
from .joint_physics import Axes
from .motions import applied
from .ported import Work
from .rigid import frame
from .telescope_ring.machine import Machine
from .telescope_ring.statics import closed

LEGS = tuple(f"leg{k}" for k in range(1, 7))
TRAVEL, FLEXURE, PITCH = 8.0, 60.0, 1.0
"""mm: half range of the rails, length of a flexure, lead of a screw."""
AXES = Axes(tuple(f"rho{k}" for k in range(1, 7)), np.full(6, -TRAVEL), np.full(6, TRAVEL), np.full(6, 0.25))
DOWN, G = np.array([0.0, 0.0, -1.0]), 9.80665
MASSES: Mapping[str, tuple[float, tuple[float, float, float], str]] = MappingProxyType(
    {"hub": (20.0, (0.0, 0.0, 40.0), "platform"), "payload": (0.0, (10.0, -5.0, 30.0), "tool")}
)
"""kg, centre of mass (mm) and body."""
HEIGHT = 440.0
"""mm above the base at which the platform is looked for."""


@dataclass(frozen=True)
class Assembled:
    """Solved rows in the base frame: lower, upper (n, 6, 3) joint centres, platform (n, 4, 4); lengths (n, 6)."""

    lower: Array
    upper: Array
    platform: Array
    lengths: Array

    @property
    def along(self) -> Array:
        """(n, 6, 3) unit vectors of the legs, lower to upper centre."""
        return np.asarray((self.upper - self.lower) / self.lengths[..., None])


def points(work: Work, end: str) -> Array:
    """(n, 6, 3) points ``a`` or ``b`` of the legs in their own frames."""
    return np.stack([work.stacked(tuple(f"{leg}.{end}.{c}" for c in "xyz")) for leg in LEGS], axis=1)


def per_leg(work: Work, key: str) -> Array:
    """(n, 6) values of a parameter of every leg."""
    return work.stacked(tuple(f"{leg}.{key}" for leg in LEGS))


def rails(work: Work) -> Array:
    """(n, 6, 3) directions of the rails."""
    ux, uy = per_leg(work, "u.x"), per_leg(work, "u.y")
    return np.stack([ux, uy, np.sqrt(1 - ux**2 - uy**2)], axis=-1)


def travel(work: Work) -> Array:
    """(n, 6) true travel of the slides: reading, offset, and what physics adds, mm."""
    return np.asarray(work.campaign.q + per_leg(work, "offset") + work.moved)


def assembled(work: Work) -> Assembled:
    """Ball joints closed in every row. Raises NoEquilibriumError out of reach."""
    lower = points(work, "a") + travel(work)[..., None] * rails(work)
    seats, lengths = points(work, "b"), per_leg(work, "length")
    poses = closed(lower, seats, lengths, HEIGHT)
    platform = frame(poses.rotation, poses.position)
    return Assembled(lower, applied(platform[:, None], seats), platform, lengths)


def leg_forces(work: Work, tool: Array) -> Array:
    """(n, 6) N, tension positive: forces and moments on the platform in balance. tool (n, 4, 4): platform to tool."""
    solved: Assembled = work.solved
    wrench = np.zeros((len(work), 6))
    for name, (kg, com, body) in MASSES.items():
        mass = work.campaign.payload if name == "payload" else np.full(len(work), kg)
        held = solved.platform @ tool if body == "tool" else solved.platform
        force = G * mass[:, None] * DOWN
        wrench += np.hstack([force, np.cross(applied(held, np.array(com)), force)])
    pull = np.concatenate([-solved.along, np.cross(solved.upper, -solved.along)], axis=-1)
    # moments in mm beside forces: scaled alike, the matrix is well conditioned
    return np.asarray(np.linalg.solve(np.swapaxes(pull, 1, 2), -wrench[..., None])[..., 0])


def as_built(work: Work) -> Machine:
    """The first row's parameters as a machine of ``telescope_ring``."""
    return Machine({name: float(value[0]) for name, value in work.values.items() if not name.startswith("P")})


__all__ = [
    "AXES",
    "FLEXURE",
    "LEGS",
    "MASSES",
    "PITCH",
    "TRAVEL",
    "Assembled",
    "as_built",
    "assembled",
    "leg_forces",
    "per_leg",
    "points",
    "rails",
    "travel",
]
