"""Drawing of a six-axis arm for 16 kg with a tool, on a laser tracker: constants, masses, machine file.

Rows are those of Khalil and Kleinfinger, T(i-1, i) = RotY(beta) RotX(alpha) TransX(d) RotZ(theta) TransZ(r). mm, deg.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .base import Array
from .ported import Drawn

JOINTS = ("q1", "q2", "q3", "q4", "q5", "q6")
FIELDS = ("beta", "alpha", "d", "theta", "r")
ROWS = np.array(
    [
        (0, 0, 0, 0, 392),
        (0, -90, 155, -90, 0),
        (0, 0, 685, 0, 0),
        (0, -90, 125, 0, 755),
        (0, 90, 0, 0, 0),
        (0, -90, 0, 0, 94),
    ],
    dtype=float,
)
RANGES = ((-165, 165), (-85, 75), (-65, 80), (-175, 175), (-115, 115), (-180, 180))
RATIOS = (153, 141, 129, 101, 101, 81)
LENGTH, ANGLE = 0.2, 0.025
MOUNTS = {
    "base": ("world", (2150.0, 640.0, -310.0), (0.0, 0.0, -128.0), 4.0, 0.8),
    "tool": ("flange", (52.0, 18.0, 146.0), (0.0, 0.0, 0.0), 0.8, 0.4),
}
AXES = ("x", "y", "z", "rx", "ry", "rz")
TARGETS = {"P1": (75.0, 0.0, 0.0), "P2": (-40.0, 70.0, 15.0), "P3": (-35.0, -60.0, 45.0)}
POINTS = 0.01
SIGMA = 0.015
GRAVITY = (0.0, 0.0, -9.80665)
MASSES = {
    "link1": ("link1", 58.0, (70.0, 25.0, -60.0)),
    "link2": ("link2", 41.0, (310.0, 0.0, 95.0)),
    "link3": ("link3", 36.0, (85.0, 10.0, -20.0)),
    "link4": ("link4", 19.0, (0.0, -5.0, -390.0)),
    "link5": ("link5", 6.5, (0.0, 30.0, 0.0)),
    "link6": ("link6", 1.4, (0.0, 0.0, -18.0)),
    "gripper": ("tool", 3.2, (-30.0, 0.0, -60.0)),
    "payload": ("tool", 0.0, (5.0, -10.0, 55.0)),
}
"""Body, kg, centre of mass in its frame (mm)."""
PAYLOADS, HEAVIEST = (0.0, 6.0, 12.0), 16.0
THERMOMETERS = ("base", "link1", "link2", "link3", "link4", "tool", "air")


def drawing(with_targets: bool) -> dict[str, Drawn]:
    """Every parameter by name, mm and rad; those of the targets too when they are read."""
    out: dict[str, Drawn] = {}
    for name, row in zip(JOINTS, ROWS, strict=True):
        for field, value in zip(FIELDS, row, strict=True):
            drawn = (value, LENGTH) if field in "dr" else np.radians([value, ANGLE])
            out[f"{name}.{field}"] = Drawn(*map(float, drawn))
    for mount, (_, xyz, rpy, length, angle) in MOUNTS.items():
        for axis, value in zip(AXES, (*xyz, *np.radians(rpy)), strict=True):
            out[f"{mount}.{axis}"] = Drawn(float(value), float(np.radians(angle)) if "r" in axis else length)
    if with_targets:
        for target, point in TARGETS.items():
            out |= {f"{target}.{a}": Drawn(v, POINTS) for a, v in zip("xyz", point, strict=True)}
    return out


def ranges() -> tuple[Array, Array]:
    """(6,) lower and upper ends of the joints' ranges, rad."""
    low, high = np.radians(np.array(RANGES, dtype=float)).T
    return low, high


def document(name: str, with_targets: bool, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
    """The machine file as data; factors misstate sigma and all tolerances."""
    sigma = {"xyz": SIGMA * sigma_factor}
    sensor: dict[str, Any] = {"type": "position", "sigma": sigma}
    if with_targets:
        points = {k: list(v) for k, v in TARGETS.items()}
        sensor = {
            "type": "targets",
            "points": points,
            "sigma": sigma,
            "tolerance": {"points": POINTS * tolerance_factor},
        }
    return {
        "schema": "truepose/machine/1",
        "name": name.replace("-", "_"),
        "units": {"length": "mm", "angle": "deg"},
        "gravity": list(GRAVITY),
        "mechanism": {"type": "serial", "joints": [_joint(k) for k in range(len(JOINTS))]},
        "frames": {mount: _mount(mount, tolerance_factor) for mount in MOUNTS},
        "sensor": sensor,
        "tolerances": {"length": LENGTH * tolerance_factor, "angle": ANGLE * tolerance_factor},
        "masses": {k: {"kg": kg, "com": list(com), "in": body} for k, (body, kg, com) in MASSES.items()},
    }


def _joint(k: int) -> dict[str, Any]:
    row: Mapping[str, float] = dict(zip(FIELDS, map(float, ROWS[k]), strict=True))
    return {
        "name": JOINTS[k],
        "kind": "revolute",
        **row,
        "range": list(RANGES[k]),
        "gear_ratio": RATIOS[k],
    }


def _mount(name: str, factor: float) -> dict[str, Any]:
    inside, xyz, rpy, length, angle = MOUNTS[name]
    tolerance = {"xyz": length * factor, "rpy": angle * factor}
    return {"in": inside, "xyz": list(xyz), "rpy": list(rpy), "tolerance": tolerance}
