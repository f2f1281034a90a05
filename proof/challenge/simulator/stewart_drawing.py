"""Drawing of a Gough-Stewart platform with six screws (6-UPS), read by photogrammetry as poses. mm, deg."""

from __future__ import annotations

from typing import Any

import numpy as np

from .base import Array
from .ported import Drawn

LEGS = tuple(f"leg{k}" for k in range(1, 7))
READINGS = tuple(f"rho{k}" for k in range(1, 7))
PITCH, STROKE, HEIGHT = 4.0, 65.0, 540.0


def _ring(radius: float, half_gap: float) -> Array:
    """(6, 3) joint centres in pairs, ``half_gap`` deg beside the thirds of a circle: legs 6 and 1, 2 and 3, 4 and 5."""
    azimuth = np.radians(120.0 * np.array([0, 1, 1, 2, 2, 3]) + half_gap * np.array([1, -1, 1, -1, 1, -1]))
    ring = radius * np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(6)], axis=-1)
    rounded: Array = np.round(ring, 2)
    return rounded


A, B = _ring(430.0, 13.0), _ring(235.0, 44.0)
OFFSET = float(np.round(np.mean(np.linalg.norm(B - A + np.array([0, 0, HEIGHT]), axis=1)), 1))
LENGTH, SIGMA, TURN_SIGMA = 0.08, 0.008, 0.0012
"""Tolerance of every length (mm); noise in mm and deg."""
MOUNTS = {
    "base": ("world", (-820.0, 310.0, 95.0), (0.0, 0.0, 34.0), 3.0, 0.6),
    "tool": ("flange", (0.0, 24.0, 82.0), (0.0, 0.0, 0.0), 0.6, 0.3),
}
AXES = ("x", "y", "z", "rx", "ry", "rz")
GRAVITY = (0.0, 0.0, -9.80665)
PLATFORM_KG, PLATFORM_COM = 24.0, (0.0, 0.0, 12.0)
PAYLOAD_COM = (10.0, -15.0, 60.0)
PAYLOADS, HEAVIEST = (0.0, 25.0, 50.0), 75.0
THERMOMETERS = ("base", "platform", *LEGS, "air")


def drawing() -> dict[str, Drawn]:
    """Every parameter by name, mm and rad."""
    out: dict[str, Drawn] = {}
    for leg, a, b in zip(LEGS, A, B, strict=True):
        for point, values in (("a", a), ("b", b)):
            out |= {f"{leg}.{point}.{x}": Drawn(float(v), LENGTH) for x, v in zip("xyz", values, strict=True)}
        out |= {f"{leg}.offset": Drawn(OFFSET, LENGTH), f"{leg}.gain": Drawn(1.0)}
    for mount, (_, xyz, rpy, length, angle) in MOUNTS.items():
        for axis, value in zip(AXES, (*xyz, *np.radians(rpy)), strict=True):
            out[f"{mount}.{axis}"] = Drawn(float(value), float(np.radians(angle)) if "r" in axis else length)
    return out


def document(name: str, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
    """The machine file as data; factors misstate sigma and all tolerances."""
    return {
        "schema": "truepose/machine/1",
        "name": name,
        "units": {"length": "mm", "angle": "deg"},
        "gravity": list(GRAVITY),
        "mechanism": {
            "type": "6-ups",
            "legs": [_leg(k) for k in range(6)],
            "home": [0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0],
        },
        "frames": {mount: _mount(mount, tolerance_factor) for mount in MOUNTS},
        "sensor": {"type": "pose", "sigma": {"xyz": SIGMA * sigma_factor, "rot": TURN_SIGMA * sigma_factor}},
        "tolerances": {"length": LENGTH * tolerance_factor, "angle": 0.0},
        "masses": {
            "platform": {"kg": PLATFORM_KG, "com": list(PLATFORM_COM), "in": "platform"},
            "payload": {"kg": 0.0, "com": list(PAYLOAD_COM), "in": "tool"},
        },
    }


def _leg(k: int) -> dict[str, Any]:
    return {
        "name": LEGS[k],
        "joint": READINGS[k],
        "a": [float(v) for v in A[k]],
        "b": [float(v) for v in B[k]],
        "offset": OFFSET,
        "range": [-STROKE, STROKE],
        "screw_pitch": PITCH,
    }


def _mount(name: str, factor: float) -> dict[str, Any]:
    inside, xyz, rpy, length, angle = MOUNTS[name]
    tolerance = {"xyz": length * factor, "rpy": angle * factor}
    return {"in": inside, "xyz": list(xyz), "rpy": list(rpy), "tolerance": tolerance}
