"""A hexapod of six legs of changing length in plain numpy: the platform's pose by Newton's method, and its machine file."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
ANGLES = np.radians([-12.0, 12.0, 108.0, 132.0, 228.0, 252.0])
UPPER = np.radians([-48.0, 48.0, 72.0, 168.0, 192.0, 288.0])
BASE = np.column_stack([420 * np.cos(ANGLES), 420 * np.sin(ANGLES), np.zeros(6)])
PLATFORM = np.column_stack([230 * np.cos(UPPER), 230 * np.sin(UPPER), np.zeros(6)])
HEIGHT = 540.0
LENGTH = 0.08
SIGMA, TURN_SIGMA = 0.006, 0.001
"""mm, deg."""
HOME = np.linalg.norm(PLATFORM + np.array([0.0, 0.0, HEIGHT]) - BASE, axis=1)
TOOL = np.array([0.0, 20.0, 80.0])


def pose(a: Array, b: Array, lengths: Array) -> tuple[Array, Rotation]:
    """Origin and rotation of the platform whose legs have these ``lengths`` (6,): mm."""
    at, turn = np.array([0.0, 0.0, HEIGHT]), Rotation.identity()
    for _ in range(50):
        arms = turn.apply(b)
        legs = at + arms - a
        size = np.linalg.norm(legs, axis=1)
        along = legs / size[:, None]
        step = np.linalg.solve(np.hstack([along, np.cross(arms, along)]), lengths - size)
        at, turn = at + step[:3], Rotation.from_rotvec(step[3:]) * turn
        if np.abs(step).max() < 1e-12:
            break
    return at, turn


def readings(a: Array, b: Array, lengths: Array, rng: np.random.Generator) -> dict[str, float]:
    """Pose of the tool as a camera in a frame of its own reads it: mm, rotation vector in deg."""
    at, turn = pose(a, b, lengths)
    stand = Rotation.from_euler("z", 25.0, degrees=True)
    place = stand.apply(at + turn.apply(TOOL)) + np.array([-500.0, 200.0, 80.0])
    place += rng.normal(scale=SIGMA, size=3)
    noise = Rotation.from_rotvec(np.radians(rng.normal(scale=TURN_SIGMA, size=3)))
    vector = np.degrees((stand * turn * noise).as_rotvec())
    return dict(zip(("x", "y", "z", "rx", "ry", "rz"), [*place, *vector], strict=True))


def document() -> dict[str, Any]:
    """The machine file: drawing, tolerances, base and tool nearly known."""
    legs = [
        {
            "name": f"leg{k + 1}",
            "joint": f"rho{k + 1}",
            "a": BASE[k].round(6).tolist(),
            "b": PLATFORM[k].round(6).tolist(),
            "offset": float(HOME[k]),
            "range": [-70.0, 70.0],
        }
        for k in range(6)
    ]
    return {
        "schema": "truepose/machine/1",
        "name": "hexapod",
        "mechanism": {"type": "6-ups", "legs": legs, "home": [0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0]},
        "frames": {
            "base": {
                "in": "world",
                "xyz": [-500.0, 200.0, 80.0],
                "rpy": [0.0, 0.0, 25.0],
                "tolerance": {"xyz": 3.0, "rpy": 0.5},
            },
            "tool": {"in": "flange", "xyz": TOOL.tolist()},
        },
        "sensor": {"type": "pose", "sigma": {"xyz": SIGMA, "rot": TURN_SIGMA}},
        "tolerances": {"length": LENGTH, "angle": 0.0},
    }


__all__ = ["BASE", "HOME", "LENGTH", "PLATFORM", "document", "readings"]
