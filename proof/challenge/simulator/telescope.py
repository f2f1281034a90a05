"""The telescope: six rails, six legs with flexures, a platform on an elastic ring; seen as a pose or as targets.

The drawing's model (ball joints, rigid platform) is exact when nothing is missing. What bends is solved by the finite
elements of ``telescope_ring``. Travel and flexures are longer than in RR-8096, so that bent flexures can be seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from . import joint_physics as joints
from . import mount_physics as mounts
from . import telescope_instrument as camera
from . import telescope_physics as own
from . import telescope_unnamed
from .base import Array, Campaign
from .campaigns import Setting
from .mechanism_frames import error_motion, fixed
from .motions import applied
from .ported import Drawn, Physics, PortedMachine, Work
from .telescope_geometry import AXES, FLEXURE, LEGS, MASSES, PITCH, TRAVEL, Assembled, assembled
from .telescope_ring.machine import TARGETS, nominal_machine, tolerance

SIGMA_XYZ, SIGMA_ROT, SIGMA_TARGET = 0.0025, 1.2e-5, 0.004
"""mm, rad, mm."""
LENGTH, ANGLE, FRAMES = 0.1, 0.1, {"base": (5.0, 1.0), "tool": (1.0, 0.5)}
"""1-sigma tolerances, mm and deg."""
GRAVITY = [0.0, 0.0, -9.80665]


class Telescope(PortedMachine):
    """6-PUS whose tool's pose is measured."""

    name: ClassVar[str] = "telescope"
    readings: ClassVar[tuple[str, ...]] = AXES.names
    revolute: ClassVar[tuple[bool, ...]] = (False,) * 6
    columns: ClassVar[tuple[str, ...]] = ("x", "y", "z", "rx", "ry", "rz")
    column_units: ClassVar[tuple[str, ...]] = ("mm", "mm", "mm", "rad", "rad", "rad")

    @cached_property
    def drawing(self) -> Mapping[str, Drawn]:
        nominal = nominal_machine().parameters
        return MappingProxyType({name: Drawn(value, tolerance(name)) for name, value in nominal.items()})

    @cached_property
    def physics(self) -> tuple[Physics, ...]:
        names = AXES.names
        grown = {leg: mounts.stretching(f"{leg}.length") for leg in LEGS}
        grown |= {
            part: mounts.stretching(*(f"{leg}.{end}.{axis}" for leg in LEGS for axis in "xyz"))
            for part, end in (("base", "a"), ("platform", "b"))
        }
        constants = [f"{leg}.{key}" for leg in LEGS for key in ("length", *own.POINTS)]
        return (
            *own.platform(),
            joints.actuator_scale(AXES, names, 3e-3),
            joints.screw_periodic(AXES, names, PITCH, 0.012),
            joints.backlash(AXES, names, 0.015),
            joints.screw_windup(AXES, names, 0.03),
            joints.zero_shift(AXES, names, 0.02),
            joints.axis_straightness(AXES, names, 0.03, own.rail_wanders(AXES)),
            own.leg_compliance(),
            own.flexure_shift(),
            mounts.thermal_expansion(grown, 2.0e-5, "temperature.leg1"),
            mounts.mount_drift(("base", "tool"), 0.02, 400.0),
            mounts.frame_shift(("base", "tool"), 0.05, 400.0),
            mounts.wrong_constant(constants, 0.6),
            own.tilted_rail(),
            self._outliers(),
            *telescope_unnamed.unnamed(),
        )

    @cached_property
    def setting(self) -> Setting:
        return Setting(
            AXES.low,
            AXES.high,
            thermometers=("air", "base", "platform", *LEGS),
            payloads=(0.0, 4.0, 8.0),
            heavier=14.0,
            interval=(60.0, 180.0),
            speed=1.0,
        )

    @property
    def sigma(self) -> Array:
        return np.array([*[SIGMA_XYZ] * 3, *[SIGMA_ROT] * 3])

    def solve(self, work: Work) -> Assembled:
        """Ball joints and rigid bodies, with whatever has been added to lengths and points."""
        return assembled(work)

    def world(self, work: Work) -> Array:
        """(n, 4, 4) tool in the world."""
        solved: Assembled = work.solved
        base = fixed(work, "base") @ error_motion(work, "base")
        return np.asarray(base @ solved.platform @ error_motion(work, "tool") @ fixed(work, "tool"))

    def see(self, work: Work) -> Array:
        """(n, 6) position, mm, and rotation vector, rad, of the tool."""
        pose = self.world(work)
        return np.hstack([pose[:, :3, 3], Rotation.from_matrix(pose[:, :3, :3]).as_rotvec()])

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        """R becomes R Exp(w), w ~ N(0, sigma)."""
        noise = factor * self.sigma * rng.standard_normal(exact.shape)
        turned = Rotation.from_rotvec(exact[:, 3:]) * Rotation.from_rotvec(noise[:, 3:])
        return np.hstack([exact[:, :3] + noise[:, :3], turned.as_rotvec()])

    def sensor(self, sigma_factor: float) -> dict[str, Any]:
        """The file's section ``sensor``."""
        rot = float(np.degrees(SIGMA_ROT))
        return {"type": "pose", "sigma": {"xyz": sigma_factor * SIGMA_XYZ, "rot": sigma_factor * rot}}

    def document(self, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
        f = tolerance_factor
        height = round(own.home_height(self.drawing), 4)
        return {
            "schema": "truepose/machine/1",
            "name": self.name.replace("-", "_"),
            "units": {"length": "mm", "angle": "deg"},
            "gravity": GRAVITY,
            "mechanism": {
                "type": "6-pus",
                "legs": [self._leg(leg, joint) for leg, joint in zip(LEGS, AXES.names, strict=True)],
                "flexure": {"length": FLEXURE},
                "home": [0.0, 0.0, height, 0.0, 0.0, 0.0],
            },
            "frames": {"base": self._frame("base", "world", f), "tool": self._frame("tool", "flange", f)},
            "sensor": self.sensor(sigma_factor),
            "tolerances": {"length": f * LENGTH, "angle": f * ANGLE},
            "masses": {
                name: {"kg": kg, "com": list(com), "in": body} for name, (kg, com, body) in MASSES.items()
            },
            "drivers": ["time", "payload", "approach", *(f"temperature.{leg}" for leg in LEGS)],
        }

    def _leg(self, leg: str, joint: str) -> dict[str, Any]:
        """The entry of a leg, as drawn."""
        return {
            "name": leg,
            "joint": joint,
            "a": self._point(f"{leg}.a"),
            "u": [0.0, 0.0, 1.0],
            "b": self._point(f"{leg}.b"),
            "length": self.drawing[f"{leg}.length"].nominal,
            "range": [-TRAVEL, TRAVEL],
            "screw_pitch": PITCH,
        }

    def _frame(self, name: str, place: str, factor: float) -> dict[str, Any]:
        """The entry of a frame, as drawn, with ``factor`` times its tolerance."""
        return {
            "in": place,
            "xyz": self._point(name),
            "rpy": [0.0, 0.0, 0.0],
            "tolerance": {"xyz": factor * FRAMES[name][0], "rpy": factor * FRAMES[name][1]},
        }

    def _point(self, name: str) -> list[float]:
        """Coordinates of a point in the drawing, mm."""
        return [self.drawing[f"{name}.{c}"].nominal for c in "xyz"]

    def _outliers(self) -> Physics:
        return mounts.outliers(0.08, np.array([1.0, 1.0, 1.0, *[1 / 200.0] * 3]))


class TelescopeTargets(Telescope):
    """The same telescope seen by cameras: twelve targets on its hub."""

    name: ClassVar[str] = "telescope-targets"
    columns: ClassVar[tuple[str, ...]] = tuple(f"{name}.{axis}" for name in TARGETS for axis in "xyz")
    column_units: ClassVar[tuple[str, ...]] = ("mm",) * 36

    @cached_property
    def drawing(self) -> Mapping[str, Drawn]:
        points = {
            f"{name}.{axis}": Drawn(v)
            for name, xyz in TARGETS.items()
            for axis, v in zip("xyz", xyz, strict=True)
        }
        return MappingProxyType({**super().drawing, **points})

    @cached_property
    def physics(self) -> tuple[Physics, ...]:
        return (*super().physics, *camera.instrument(tuple(TARGETS)))

    @property
    def sigma(self) -> Array:
        return np.full(36, SIGMA_TARGET)

    def see(self, work: Work) -> Array:
        """(n, 36) targets in the world, mm."""
        points = np.stack([work.stacked(tuple(f"{p}.{c}" for c in "xyz")) for p in TARGETS], axis=1)
        return applied(self.world(work)[:, None], points).reshape(len(work), -1)

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        """N(0, sigma) on every coordinate."""
        return np.asarray(exact + factor * self.sigma * rng.standard_normal(exact.shape))

    def sensor(self, sigma_factor: float) -> dict[str, Any]:
        """The file's section ``sensor``."""
        points = {name: list(xyz) for name, xyz in TARGETS.items()}
        return {
            "type": "targets",
            "points": points,
            "sigma": {"xyz": sigma_factor * SIGMA_TARGET},
            "tolerance": {"points": 0.0},
        }

    def _outliers(self) -> Physics:
        return mounts.outliers(0.15, np.ones(36))


__all__ = ["Telescope", "TelescopeTargets"]
