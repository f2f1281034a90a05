"""The hybrid polishing robot: three limbs and a passive one carry a platform with a wrist, seen by a laser tracker.

Nominal dimensions are Table 1 of Huang, Zhao, Yin, Tian and Chetwynd (2019). The robot hangs over its table.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from . import joint_physics as joints
from . import mount_physics as mounts
from . import polisher_physics as own
from .base import Array
from .campaigns import Setting
from .hybrid_geometry import LIMBS, PASSIVE, Assembled, assembled
from .mechanism_frames import error_motion, fixed
from .motions import applied
from .mount_physics import TWIST
from .ported import Drawn, Physics, PortedMachine, Work

BASE_RADIUS, PLATFORM_RADIUS, PLATFORM_OFFSET = 350.0, 135.0, 345.0
WRIST_OFFSET, HEAD, TOOL, PITCH = 405.0, 120.0, 250.0, 10.0
LIMB_RANGE, WRIST_RANGE, SPREAD = (628.0, 1178.0), 60.0, 150.0
"""mm, deg; limbs differ by no more than ``SPREAD`` in a pose."""
BASE = {"x": -602.5, "y": 0.0, "z": 1878.560612, "rx": 0.0, "ry": 150.0, "rz": 0.0}
BASE_TOLERANCE = (1.0, 0.1)
POINTS = {"P1": (0.0, 200.0, 0.0), "P2": (200.0, 0.0, 0.0), "P3": (-200.0, 0.0, 0.0)}
SIGMA, LENGTH, ANGLE, ENCODER_MM, ENCODER_DEG = 0.005, 0.05, 0.02, 2.0, 0.3
"""mm and deg."""
SCREWS, WRIST = ("q1", "q2", "q3"), ("q4", "q5", "q6")
AXES = joints.Axes(
    (*SCREWS, *WRIST),
    np.array([*[LIMB_RANGE[0]] * 3, *[-np.radians(WRIST_RANGE)] * 3]),
    np.array([*[LIMB_RANGE[1]] * 3, *[np.radians(WRIST_RANGE)] * 3]),
    np.array([*[1.0] * 3, *[np.radians(1.0)] * 3]),
)


class Polisher(PortedMachine):
    """3UPS-UP + 3R with three reflectors on its tool."""

    name: ClassVar[str] = "polisher"
    readings: ClassVar[tuple[str, ...]] = AXES.names
    revolute: ClassVar[tuple[bool, ...]] = (False, False, False, True, True, True)
    columns: ClassVar[tuple[str, ...]] = tuple(f"{p}.{c}" for p in POINTS for c in "xyz")
    column_units: ClassVar[tuple[str, ...]] = ("mm",) * 9

    @cached_property
    def drawing(self) -> Mapping[str, Drawn]:
        nominal: dict[str, tuple[float, ...]] = {"q4": (0.0, 0.0, PLATFORM_OFFSET, 0.0, 0.0, 0.0)}
        for k in LIMBS:
            azimuth = (k - 1) * 2 * np.pi / 3
            ray = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            nominal[f"u{k}a"] = (*BASE_RADIUS * ray, 0.0, 0.0, azimuth)
            nominal[f"mount{k}"] = (*PLATFORM_RADIUS * ray, 0.0, 0.0, 0.0)
        nominal["tool"] = (0.0, 0.0, WRIST_OFFSET + HEAD, 0.0, 0.0, 0.0)
        hinges = (*PASSIVE, *SCREWS, *(f"{e}{k}" for k in LIMBS for e in ("mount", "s")), *WRIST, "tool")
        out = {}
        for name in hinges:
            for axis, value in zip(TWIST, nominal.get(name, (0.0,) * 6), strict=True):
                out[f"{name}.{axis}"] = Drawn(
                    float(value), np.radians(ANGLE) if axis.startswith("r") else LENGTH
                )
        out |= {f"{name}.offset": Drawn(0.0, ENCODER_MM) for name in SCREWS}
        out |= {f"{name}.offset": Drawn(0.0, float(np.radians(ENCODER_DEG))) for name in WRIST}
        for axis, value in BASE.items():
            turns = axis.startswith("r")
            at, tolerance = (
                (np.radians(value), np.radians(BASE_TOLERANCE[1])) if turns else (value, BASE_TOLERANCE[0])
            )
            out[f"base.{axis}"] = Drawn(float(at), float(tolerance))
        return MappingProxyType(out)

    @cached_property
    def physics(self) -> tuple[Physics, ...]:
        limbs = {f"leg{k}": own.growing_limb(AXES.names, k - 1) for k in LIMBS}
        constants = [f"{name}.{axis}" for k in LIMBS for name in (f"u{k}a", f"mount{k}") for axis in "xz"]
        return (
            joints.backlash(AXES, SCREWS, 0.03),
            own.renamed(joints.backlash(AXES, WRIST, 1e-4), "backlash-of-wrist"),
            joints.transmission_error(AXES, WRIST, 20.0, 1e-4),
            joints.encoder_eccentricity(AXES, WRIST, 3e-4),
            joints.screw_periodic(AXES, SCREWS, PITCH, 0.015),
            joints.actuator_scale(AXES, SCREWS, 1e-4),
            joints.zero_shift(AXES, SCREWS, 0.1),
            own.renamed(joints.zero_shift(AXES, WRIST, 3e-4), "zero-shift-of-wrist"),
            joints.axis_coupling(AXES, (("q5", "q4"), ("q6", "q5")), 3e-4),
            *own.elastic(AXES),
            own.runout(),
            mounts.thermal_expansion(limbs, 1.2e-5, "temperature.leg1"),
            mounts.mount_drift(("base",), 0.03, 1000.0),
            mounts.frame_shift(("base", "tool"), 0.05, 500.0),
            mounts.wrong_constant(constants, 0.5),
            mounts.outliers(0.2, np.ones(9)),
            *own.unnamed(AXES),
        )

    @cached_property
    def setting(self) -> Setting:
        return Setting(
            AXES.low,
            AXES.high,
            thermometers=("leg1", "leg2", "leg3", "air"),
            payloads=(0.0, 6.0, 12.0),
            heavier=20.0,
            speed=np.array([*[20.0] * 3, *[0.3] * 3]),
            accept=lambda q: bool(np.ptp(q[:3]) < SPREAD),
        )

    @property
    def sigma(self) -> Array:
        return np.full(9, SIGMA)

    def solve(self, work: Work) -> Assembled:
        """Closed loops in the base frame."""
        return assembled(work, AXES.names, BASE_RADIUS - PLATFORM_RADIUS)

    def see(self, work: Work) -> Array:
        """(n, 9) reflectors in the world, mm."""
        solved: Assembled = work.solved
        pose = fixed(work, "base") @ error_motion(work, "base") @ solved.tool
        return applied(pose[:, None], np.array(list(POINTS.values()))).reshape(len(work), 9)

    def document(self, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
        f = tolerance_factor
        encoders = {f"{name}.offset": f * ENCODER_MM for name in SCREWS}
        encoders |= {f"{name}.offset": f * ENCODER_DEG for name in WRIST}
        xyz, rpy = list(BASE.values())[:3], list(BASE.values())[3:]
        tolerance = {"xyz": f * BASE_TOLERANCE[0], "rpy": f * BASE_TOLERANCE[1]}
        return {
            "schema": "truepose/machine/1",
            "name": self.name,
            "units": {"length": "mm", "angle": "deg"},
            "gravity": [float(g) for g in own.GRAVITY],
            "mechanism": {
                "type": "3ups-up-3r",
                "base_radius": BASE_RADIUS,
                "platform_radius": PLATFORM_RADIUS,
                "platform_offset": PLATFORM_OFFSET,
                "wrist_offset": WRIST_OFFSET,
                "head": HEAD,
                "tool": TOOL,
                "limb_range": list(LIMB_RANGE),
                "wrist_range": [-WRIST_RANGE, WRIST_RANGE],
                "screw_pitch": PITCH,
            },
            "frames": {"base": {"in": "world", "xyz": xyz, "rpy": rpy, "tolerance": tolerance}},
            "sensor": {
                "type": "targets",
                "points": {name: list(point) for name, point in POINTS.items()},
                "sigma": {"xyz": sigma_factor * SIGMA},
            },
            "tolerances": {"length": f * LENGTH, "angle": f * ANGLE, **encoders},
            "masses": {
                "head": {"kg": own.HEAD_KG, "com": list(own.HEAD_COM), "in": "tool"},
                "payload": {"kg": 0.0, "com": list(own.PAYLOAD_COM), "in": "tool"},
            },
            "drivers": ["time", "payload", "approach", *(f"temperature.leg{k}" for k in LIMBS)],
        }


__all__ = ["Polisher"]
