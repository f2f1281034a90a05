"""The 69 motions of section V-A, and fresh motions to judge a calibration by. Joints in mm and rad.

A motion moves one joint and gives one equation: the cavity's change from its start to its end. The stages are
driven by their own axes (before a calibration nothing else can be commanded), so that "along X_w" is q3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SIDE, DEPTH = 0.150, 0.020
"""Half travel along X_w and Z_w, and along Y_w, mm."""
TILT = np.radians(3.0)
TURN = np.radians(90.0)
LOW = np.array([-SIDE, -DEPTH, -SIDE, -TILT, -TILT, 0.0])
HIGH = np.array([SIDE, DEPTH, SIDE, TILT, TILT, TURN])
"""Range of each joint, in the order q1 (Z_w) q2 (Y_w) q3 (X_w) q4 (about X_w) q5 (about Z_w) q6 (about Y_w)."""


@dataclass(frozen=True)
class Motions:
    """Joints at the start and at the end of each motion, (n, 6)."""

    start: Array
    end: Array

    def __len__(self) -> int:
        return len(self.start)

    def sampled(self, steps: int) -> Array:
        """(n, steps + 1, 6) joints along straight motions, start and end included."""
        share = np.linspace(0.0, 1.0, steps + 1)[:, None]
        return np.asarray(self.start[:, None] + share * (self.end - self.start)[:, None])


def paper_plan() -> Motions:
    """45 rotations at 15 nodes, then 24 translations at eight orientations."""
    pairs = [*_rotations(), *_translations()]
    return Motions(np.array([start for start, _ in pairs]), np.array([end for _, end in pairs]))


def nodes() -> Array:
    """(15, 3) corners, face centres and centre of the cube of Figure 6 in units of half its sides: q1 q2 q3."""
    corners = list(product((-1.0, 1.0), repeat=3))
    faces = [tuple(sign * row) for row in np.eye(3) for sign in (-1.0, 1.0)]
    return np.array([*corners, *faces, (0.0, 0.0, 0.0)])


def _rotations() -> Iterator[tuple[Array, Array]]:
    """At each node one rotation of each rotary joint over its range; the two others stand at zero.

    The paper prints [0, 90] deg "around Z_w": its rotary positioner is the one about Y_w (section VI, Table I).
    """
    for node in nodes():
        for joint in (3, 4, 5):
            start = np.zeros(6)
            start[:3] = node * HIGH[:3]
            end = start.copy()
            start[joint], end[joint] = LOW[joint], HIGH[joint]
            yield start, end


def _translations() -> Iterator[tuple[Array, Array]]:
    """At each of 2^3 orientations one translation along each axis, the two others at the middle."""
    for tilts in product((0.0, 1.0), repeat=3):
        for joint in (2, 1, 0):
            start = np.zeros(6)
            start[3:] = np.array(tilts) * HIGH[3:]
            end = start.copy()
            start[joint], end[joint] = LOW[joint], HIGH[joint]
            yield start, end


def fresh_motions(count: int, rng: np.random.Generator) -> Motions:
    """Motions between two points drawn evenly over the ranges of all joints."""
    return Motions(*(rng.uniform(LOW, HIGH, (count, 6)) for _ in range(2)))
