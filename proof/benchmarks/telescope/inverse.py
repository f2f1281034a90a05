"""The 6-PUS in plain numpy: travels of the actuators from a pose, and the pose from the travels. mm, rad.

Shares no code with truepose. For leg i, with h = p + R b - a, the leg's length says |h - rho u| = l, so that
rho^2 - 2 (h'u) rho + |h|^2 - l^2 = 0 and, the platform being above the actuators,
rho = h'u - sqrt((h'u)^2 - (|h|^2 - l^2)) (telescope paper, eq. 7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
BASE_ANGLES, BASE_RADIUS = (-12.0, 12.0, 108.0, 132.0, 228.0, 252.0), 400.0
PLATFORM_ANGLES, PLATFORM_RADIUS = (-46.0, 46.0, 74.0, 166.0, 194.0, 286.0), 250.0
LENGTH, TRAVEL = 500.0, 1.3
_LIMIT = 50


@dataclass(frozen=True)
class Geometry:
    """a, b (6, 3) joint centres in base and platform, u (6, 2) x and y of the rails' unit vectors, length (6,)."""

    a: Array
    b: Array
    u: Array
    length: Array

    @property
    def rails(self) -> Array:
        """(6, 3) unit vectors of the rails."""
        return np.column_stack([self.u, np.sqrt(1.0 - np.sum(self.u**2, axis=1))])

    def moved(self, rng: np.random.Generator, length: float, angle: float) -> Geometry:
        """Another one: a, b across the rails and leg lengths + N(0, length), u + N(0, angle)."""
        flat = np.array([1.0, 1.0, 0.0])
        a, b = (p + length * flat * rng.standard_normal((6, 3)) for p in (self.a, self.b))
        u = self.u + angle * rng.standard_normal((6, 2))
        return Geometry(a, b, u, self.length + length * rng.standard_normal(6))


def drawing() -> Geometry:
    """The telescope as drawn (design of Fig. 3; radii and angles are this project's, see docs/machines/telescope.md)."""
    return Geometry(
        _circle(BASE_RADIUS, BASE_ANGLES),
        _circle(PLATFORM_RADIUS, PLATFORM_ANGLES),
        np.zeros((6, 2)),
        np.full(6, LENGTH),
    )


def travels(geometry: Geometry, position: Array, turn: Array) -> Array:
    """(6,) travels that put the platform at ``position`` (3,) with rotation ``turn`` (3, 3): eq. (7)."""
    h = position + geometry.b @ turn.T - geometry.a
    along = np.sum(h * geometry.rails, axis=1)
    return np.asarray(along - np.sqrt(along**2 - (np.sum(h * h, axis=1) - geometry.length**2)))


def pose(geometry: Geometry, rho: Array) -> tuple[Array, Array]:
    """Position (3,) and rotation (3, 3) of the platform at travels ``rho`` (6,), by Newton's method on eq. (7)."""
    position, turn = np.array([0.0, 0.0, _height(geometry)]), np.eye(3)
    rails = geometry.rails
    for _ in range(_LIMIT):
        gap = travels(geometry, position, turn) - rho
        arm = geometry.b @ turn.T
        leg = position + arm - geometry.a - (rho + gap)[:, None] * rails
        # |h - rho u| = l: (h - rho u)'(dp + w x arm) = (h - rho u)'u drho
        by_travel = np.sum(leg * rails, axis=1)[:, None]
        jacobian = np.hstack([leg, np.cross(arm, leg)]) / by_travel
        step = np.linalg.solve(jacobian, -gap)
        position, turn = position + step[:3], Rotation.from_rotvec(step[3:]).as_matrix() @ turn
        if np.max(np.abs(step)) < 1e-12 * LENGTH:
            return position, turn
    raise ArithmeticError(f"the platform cannot be assembled at {rho}")


def _circle(radius: float, angles: tuple[float, ...]) -> Array:
    t = np.radians(angles)
    return np.column_stack([radius * np.cos(t), radius * np.sin(t), np.zeros(6)])


def _height(geometry: Geometry) -> float:
    """Height of the platform over the base at zero travel, both level."""
    across = np.linalg.norm(geometry.a[:, :2] - geometry.b[:, :2], axis=1)
    return float(np.mean(np.sqrt(geometry.length**2 - across**2)))
