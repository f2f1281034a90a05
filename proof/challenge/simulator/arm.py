"""A six-axis arm on a laser tracker: one reflector at the tool (``arm``) or three (``arm-targets``)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from . import arm_outside as outside
from . import arm_physics as own
from . import joint_physics as joints
from . import mount_physics as mounts
from .arm_chain import ArmPose, pose, seen_points
from .arm_drawing import (
    HEAVIEST,
    JOINTS,
    PAYLOADS,
    RATIOS,
    SIGMA,
    TARGETS,
    THERMOMETERS,
    document,
    drawing,
    ranges,
)
from .base import Array
from .campaigns import Setting
from .ported import Drawn, Physics, PortedMachine, Work

OVERSHOOT = np.radians(2.0)
LEVER = 900.0
"""mm: a mount that shifts by 1 mm turns by 1 / LEVER."""
MOTORS = {"q2": "link1", "q3": "link2", "q4": "link3"}
PARTS = {
    "base": mounts.stretching("q1.r", "q1.d"),
    "link2": mounts.stretching("q2.r", "q3.d"),
    "link4": mounts.stretching("q4.r", "q5.d"),
}
"""Parts long enough for their growth to show."""
LENGTHS = ("q2.d", "q3.d", "q4.d", "q4.r")


class Arm(PortedMachine):
    """One reflector, read where the tool frame stands."""

    name: ClassVar[str] = "arm"
    readings: ClassVar[tuple[str, ...]] = JOINTS
    revolute: ClassVar[tuple[bool, ...]] = (True,) * 6
    targets: ClassVar[tuple[str, ...]] = ()
    columns: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    column_units: ClassVar[tuple[str, ...]] = ("mm",) * 3

    @cached_property
    def drawing(self) -> Mapping[str, Drawn]:
        return drawing(bool(self.targets))

    @cached_property
    def setting(self) -> Setting:
        low, high = ranges()
        return Setting(
            low,
            high,
            THERMOMETERS,
            PAYLOADS,
            HEAVIEST,
            interval=(25.0, 80.0),
            speed=0.6,
            step=float(np.radians(1e-4)),
        )

    @property
    def sigma(self) -> Array:
        return np.full(len(self.columns), SIGMA)

    @cached_property
    def physics(self) -> tuple[Physics, ...]:
        low, high = ranges()
        axes = joints.Axes(JOINTS, low, high, np.full(6, OVERSHOOT))
        return (*_of_joints(axes), *_of_parts(axes), *self._of_instrument(), *_outside(axes))

    def _of_instrument(self) -> tuple[Physics, ...]:
        reflectors = (own.target_offset(self.targets, 0.1),) if self.targets else ()
        columns = len(self.columns)
        blunders = mounts.outliers(0.4, np.ones(columns))
        return (own.sensor_scale(2e-4, columns), own.latency(JOINTS, 3e-4), blunders, *reflectors)

    def document(self, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
        return document(self.name, bool(self.targets), sigma_factor, tolerance_factor)

    def solve(self, work: Work) -> ArmPose:
        return pose(work)

    def see(self, work: Work) -> Array:
        return seen_points(work, self.targets)


class ArmTargets(Arm):
    """Three reflectors on the tool."""

    name: ClassVar[str] = "arm-targets"
    targets: ClassVar[tuple[str, ...]] = tuple(TARGETS)
    columns: ClassVar[tuple[str, ...]] = tuple(f"{target}.{a}" for target in TARGETS for a in "xyz")
    column_units: ClassVar[tuple[str, ...]] = ("mm",) * 9


def _of_joints(axes: joints.Axes) -> tuple[Physics, ...]:
    return (
        own.joint_compliance(axes),
        joints.backlash(axes, JOINTS, 2e-4),
        own.friction_hysteresis(axes, 1.2e-4),
        joints.encoder_eccentricity(axes, JOINTS, 1.5e-4),
        own.transmission_error(axes, RATIOS, 1.5e-4),
        joints.axis_coupling(axes, (("q5", "q4"), ("q6", "q4"), ("q6", "q5")), 1e-3),
        own.axis_wobble(axes, 1e-4),
        joints.zero_shift(axes, JOINTS, 2e-4),
    )


def _of_parts(axes: joints.Axes) -> tuple[Physics, ...]:
    return (
        own.link_bending(),
        own.gravity_sag(),
        mounts.thermal_expansion(PARTS, 1.7e-5, "temperature.base"),
        mounts.mount_drift(("base", "tool"), 0.06, LEVER),
        mounts.frame_shift(("base", "tool"), 0.1, LEVER),
        mounts.wrong_constant(LENGTHS, 3.0),
    )


def _outside(axes: joints.Axes) -> tuple[Physics, ...]:
    return (
        outside.stiffening_gear(axes),
        outside.dragged_hose(axes),
        outside.heated_zero(axes, 3e-5, MOTORS),
        outside.rocking_base(1.5e-4),
        outside.mirror_error(2e-4),
        outside.slipping_clamp(5e-5),
        outside.creeping_belt(axes, 1e-4),
    )
