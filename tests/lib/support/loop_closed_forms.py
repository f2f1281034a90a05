"""Closed forms of the planar 3-RRR, the delta robot and the hybrid, written out in numpy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array


@dataclass(frozen=True)
class Planar:
    """A 3-RRR in its plane: base pivots, cranks, rods and the platform's corners (mm)."""

    pivots: Array
    cranks: Array
    rods: Array
    corners: Array

    def platform(self, q: Array, side: Sequence[int]) -> tuple[Array, float]:
        """Position and angle of the platform: the corner of limb 3 must meet its circle.

        Corner 1 runs on its circle, corner 2 follows as the intersection of two circles, and the platform's angle
        is that at which corner 3 is as far from its elbow as its rod is long. ``side`` is the sign of corner 2
        beside the line from corner 1, and the number of the root for the angle of rod 1.
        """
        elbows = self.pivots + self.cranks[:, None] * np.column_stack([np.cos(q), np.sin(q)])
        shape = self.corners - self.corners[0]

        def corners(rod: float) -> Array:
            first = elbows[0] + self.rods[0] * np.array([np.cos(rod), np.sin(rod)])
            way = elbows[1] - first
            apart, reach = np.hypot(*way), np.hypot(*shape[1])
            cosine = (apart**2 + reach**2 - self.rods[1] ** 2) / (2 * apart * reach)
            if abs(cosine) > 1:
                return np.full((3, 2), np.nan)
            angle = (
                np.arctan2(way[1], way[0])
                + side[0] * np.arccos(cosine)
                - np.arctan2(shape[1, 1], shape[1, 0])
            )
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            return np.asarray(first + shape @ turn.T)

        def lack(rod: float) -> float:
            return float(np.linalg.norm(corners(rod)[2] - elbows[2]) - self.rods[2])

        found = corners(_roots(lack)[side[1]])
        one, two = found[1] - found[0], shape[1]
        angle = float(np.arctan2(two[0] * one[1] - two[1] * one[0], one @ two))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return found[0] - turn @ self.corners[0], angle


def _roots(function: Callable[[float], float]) -> list[float]:
    """Zeros over a whole turn, by bisection between sign changes of a fine scan."""
    grid = np.linspace(-np.pi, np.pi, 721)
    values = np.array([function(float(t)) for t in grid])
    out = []
    for k in np.flatnonzero(values[:-1] * values[1:] < 0):
        low, high, sign = grid[k], grid[k + 1], np.sign(values[k])
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if np.sign(function(float(middle))) == sign else (low, middle)
        out.append(float((low + high) / 2))
    return out


PLANAR = Planar(
    np.array([[-141.0, -255.0], [291.0, 5.0], [-150.0, 250.0]]),
    np.array([100.0, 103.0, 98.0]),
    np.array([150.0, 147.0, 152.0]),
    np.array([[-130.0, -75.0], [130.0, -74.0], [1.0, 150.0]]),
)


def assemblies(planar: Planar, q: Array) -> list[tuple[Array, float]]:
    """All poses of the platform (six at most) at which the loops close."""
    found = []
    for sign in (1, -1):
        for root in range(8):
            try:
                found.append(planar.platform(q, (sign, root)))
            except IndexError:
                break
    return found


def near(planar: Planar, q: Array, wanted: tuple[Array, float]) -> tuple[Array, float]:
    """The assembly of the closed form that is nearest to a pose."""

    def away(pose: tuple[Array, float]) -> float:
        turn = (pose[1] - wanted[1] + np.pi) % (2 * np.pi) - np.pi
        return float(np.linalg.norm(pose[0] - wanted[0]) + 100 * abs(turn))

    return min(assemblies(planar, q), key=away)


def passive_angles(planar: Planar, q: Array, pose: tuple[Array, float]) -> dict[str, float]:
    """Passive joints of planar.yaml at an assembly, deg."""
    xy, angle = pose
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    elbows = planar.pivots + planar.cranks[:, None] * np.column_stack([np.cos(q), np.sin(q)])
    way = xy + planar.corners @ turn.T - elbows
    rods = np.arctan2(way[:, 1], way[:, 0])
    angles = {f"b{k + 1}": float(rods[k] - q[k]) for k in range(3)} | {"p1": float(angle - rods[0])}
    return {name: float(np.degrees(np.angle(np.exp(1j * value)))) for name, value in angles.items()}


def planar_pose(xy: Array, angle: float) -> Array:
    """Of the tool of planar.yaml, (4, 4)."""
    platform, tool = np.eye(4), np.eye(4)
    platform[:3, :3], platform[:2, 3] = Rotation.from_euler("z", angle).as_matrix(), xy
    tool[:3, :3], tool[:3, 3] = Rotation.from_euler("z", 20, degrees=True).as_matrix(), [10, 5, 30]
    out: Array = platform @ tool
    return out


def delta_position(q: Array, base: float, arms: Array, rods: Array, platform: float) -> Array:
    """(3,) platform of a delta robot: where three spheres about the elbows, moved inwards by its radius, meet."""
    azimuth = np.radians([0, 120, 240])
    out = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)])
    centre = out * (base - platform + arms * np.cos(q))[:, None] - np.outer(arms * np.sin(q), [0, 0, 1])
    one, two = centre[1] - centre[0], centre[2] - centre[0]
    right = [
        (rods[0] ** 2 - rods[k] ** 2 + centre[k] @ centre[k] - centre[0] @ centre[0]) / 2 for k in (1, 2)
    ]
    normal = np.cross(one, two)
    at = np.linalg.solve([one, two, normal], [*right, normal @ centre[0]])
    down = (
        -np.sqrt(rods[0] ** 2 - np.sum((at - centre[0]) ** 2)) * np.sign(normal[2]) / np.linalg.norm(normal)
    )
    return np.asarray(at + down * normal)


def delta(q: Array) -> Array:
    return delta_position(q, 200.0, np.full(3, 250.0), np.full(3, 550.0), 60.0)


def hybrid_inverse(up: Array) -> Array:
    """(3,) limb lengths of the hybrid whose passive limb stands at two angles and a length."""
    turn = Rotation.from_euler("XY", up[:2]).as_matrix()
    azimuth = np.radians([0, 120, 240])
    circle = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)])
    return np.asarray(
        np.linalg.norm((turn @ (165 * circle.T + [[0], [0], [up[2]]])).T - 340 * circle, axis=1)
    )
