"""A six-axis nanopositioner seen along one beam: three slides, two goniometers and a rotary stage under a plane mirror.

After Bettahar et al. 2022, with a collimated beam 0.1 m long in place of a bare fibre and the mirror 20 mm in front of
the centre of rotation: warm parts and warm air then show. World axes are the paper's: the light runs along -y.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from . import joint_physics as joints
from . import mount_physics as mounts
from . import nanopositioner_physics as own
from .base import Array, Campaign
from .campaigns import Setting
from .cavity import Constants, cavity, mirror_pose
from .mechanism_frames import error_motion
from .ported import Drawn, Physics, PortedMachine, Work

SIGMA, WAVELENGTH, PITCH = 1e-5, 1.56e-3, 0.1
"""mm."""
POST, BEAM = 20.0, 120.0
"""mm from the centre of rotation to mirror and to the beam's origin."""
LENGTH_TOLERANCE, ANGLE_TOLERANCE = 0.005, np.radians(0.5)
BEAM_TOLERANCE = {"beam.xyz": 0.15, "beam.angle": 0.2, "mirror.z": 0.005, "mirror.angle": 0.2}
"""mm and deg."""
ROW = ("beta", "alpha", "d", "theta", "r")
JOINTS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "q1": {},
        "q2": {"alpha": -90.0, "theta": -90.0},
        "q3": {"alpha": -90.0, "theta": -90.0},
        "q4": {},
        "q5": {"alpha": -90.0, "theta": -90.0},
        "q6": {"alpha": -90.0, "r": POST},
    }
)
"""Table I, mm and deg; what is not named is zero."""
TOLERANCED = (
    *("q2.alpha", "q2.theta", "q3.alpha", "q3.theta", "q4.beta", "q4.alpha", "q4.d", "q4.theta"),
    *("q5.alpha", "q5.d", "q5.theta", "q6.alpha", "q6.theta"),
)
BEAM_NAMES = ("beam.x", "beam.y", "beam.z", "beam.rx", "beam.rz")
MIRROR_NAMES = ("mirror.z", "mirror.rx", "mirror.ry")
SLIDES, TURNS = ("q1", "q2", "q3"), ("q4", "q5", "q6")
SCREWED, PIEZO = ("q2",), ("q1", "q3")
"""Slides on a screw, and those that a piezo moves without one."""
STROKE, SWING, ROTARY = 0.15, np.radians(3.2), (np.radians(-5.0), np.radians(95.0))
AXES = joints.Axes(
    (*SLIDES, *TURNS),
    np.array([*[-STROKE] * 3, -SWING, -SWING, ROTARY[0]]),
    np.array([*[STROKE] * 3, SWING, SWING, ROTARY[1]]),
    np.array([*[0.02] * 3, *[np.radians(0.5)] * 3]),
)


class Nanopositioner(PortedMachine):
    """3P3R with a Fabry-Perot cavity that reads changes of one distance."""

    name: ClassVar[str] = "nanopositioner"
    readings: ClassVar[tuple[str, ...]] = AXES.names
    revolute: ClassVar[tuple[bool, ...]] = (False, False, False, True, True, True)
    columns: ClassVar[tuple[str, ...]] = ("dL",)
    column_units: ClassVar[tuple[str, ...]] = ("mm",)

    @cached_property
    def drawing(self) -> Mapping[str, Drawn]:
        out = {}
        for joint, row in JOINTS.items():
            for key in ROW:
                name, value = f"{joint}.{key}", row.get(key, 0.0)
                is_length = key in "dr"
                tolerance = LENGTH_TOLERANCE if is_length else ANGLE_TOLERANCE
                out[name] = Drawn(
                    value if is_length else np.radians(value), tolerance if name in TOLERANCED else 0.0
                )
        at = {"beam.y": BEAM, "beam.rx": np.pi / 2}
        for name in (*BEAM_NAMES, *MIRROR_NAMES):
            element, key = name.split(".")
            is_angle = key.startswith("r")
            field = f"{element}.angle" if is_angle else {"beam": "beam.xyz", "mirror": "mirror.z"}[element]
            tolerance = BEAM_TOLERANCE[field]
            out[name] = Drawn(at.get(name, 0.0), float(np.radians(tolerance)) if is_angle else tolerance)
        return MappingProxyType(out)

    @cached_property
    def physics(self) -> tuple[Physics, ...]:
        return (
            joints.piezo_hysteresis(AXES, PIEZO, 0.03),
            joints.piezo_creep(AXES, PIEZO, 0.01),
            joints.screw_periodic(AXES, SCREWED, PITCH, 1e-4),
            joints.backlash(AXES, SCREWED, 3e-4),
            joints.actuator_scale(AXES, ("q2",), 3e-3),
            joints.axis_straightness(AXES, SLIDES, 3e-4, own.slide_wanders(AXES)),
            joints.encoder_eccentricity(AXES, ("q6",), 0.02),
            joints.zero_shift(AXES, SLIDES, 1e-3),
            *own.instrument(WAVELENGTH),
            mounts.thermal_expansion({"link6": mounts.stretching("q6.r")}, 2e-5, "temperature.link6"),
            mounts.mount_drift(("base",), 1e-3, 20.0),
            mounts.wrong_constant(TOLERANCED, 0.03),
            mounts.fringe_miscount(WAVELENGTH / 2),
            mounts.outliers(5e-4, np.ones(1)),
            *own.unnamed(AXES),
        )

    @cached_property
    def setting(self) -> Setting:
        return Setting(
            AXES.low,
            AXES.high,
            thermometers=("air", "link6"),
            interval=(20.0, 60.0),
            speed=np.array([*[0.05] * 3, *[0.02] * 3]),
            changes=True,
            lags={"link6": 600.0},
        )

    @property
    def sigma(self) -> Array:
        return np.array([SIGMA])

    def solve(self, work: Work) -> own.Optics:
        """The beam and where the mirror stands in each row."""
        rows = np.stack([work.stacked(tuple(f"{j}.{key}" for key in ROW)) for j in AXES.names], axis=1)
        constants = Constants(rows, work.stacked(BEAM_NAMES), work.stacked(MIRROR_NAMES))
        errors = np.stack([error_motion(work, joint) for joint in AXES.names], axis=1)
        mirror = mirror_pose(constants, work.campaign.q + work.moved, errors)
        return own.Optics(constants, error_motion(work, "base") @ mirror)

    def see(self, work: Work) -> Array:
        """(n, 1) cavity length, mm."""
        optics: own.Optics = work.solved
        return cavity(optics.constants, optics.mirror)[:, None]

    def told(self, seen: Array, campaign: Campaign) -> Array:
        """(n, 1) change since each row's origin, mm."""
        return np.asarray(seen - seen[campaign.origin])

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        """(n, 1) readings with noise; a row that is its own origin reads 0 exactly."""
        noise = super().noisy(exact, campaign, rng, factor=factor) - exact
        noise[campaign.origin == np.arange(len(campaign))] = 0.0
        return np.asarray(exact + noise)

    def document(self, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
        low, high = AXES.low, AXES.high
        table = []
        for k, (joint, row) in enumerate(JOINTS.items()):
            is_slide = joint in SLIDES
            ends = (low[k], high[k]) if is_slide else (np.degrees(low[k]), np.degrees(high[k]))
            entry: dict[str, Any] = {"name": joint, "kind": "prismatic" if is_slide else "revolute", **row}
            entry["range"] = [round(float(v), 6) for v in ends]
            table.append({**entry, "screw_pitch": PITCH} if joint in SCREWED else entry)
        tolerances = {"length": 0.0, "angle": 0.0} | {
            name: tolerance_factor * (LENGTH_TOLERANCE if name.endswith(".d") else 0.5) for name in TOLERANCED
        }
        return {
            "schema": "truepose/machine/1",
            "name": self.name,
            "units": {"length": "mm", "angle": "deg"},
            "mechanism": {"type": "serial", "joints": table},
            "sensor": {
                "type": "distance",
                "beam": {"in": "world", "xyz": [0.0, BEAM, 0.0], "rx": 90.0, "rz": 0.0},
                "mirror": {"in": "flange", "z": 0.0, "rx": 0.0, "ry": 0.0},
                "sigma": {"distance": sigma_factor * SIGMA},
                "tolerance": {k: tolerance_factor * v for k, v in BEAM_TOLERANCE.items()},
                "wavelength": WAVELENGTH,
            },
            "tolerances": tolerances,
            "drivers": ["time", "temperature.air", "temperature.link6"],
        }


__all__ = ["Nanopositioner"]
