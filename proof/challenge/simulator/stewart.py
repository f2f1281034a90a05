"""A Gough-Stewart platform on six screws, whose poses a photogrammetric system reads."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from . import joint_physics as joints
from . import mount_physics as mounts
from . import rigid
from . import stewart_physics as own
from .arm_physics import sensor_scale
from .base import Array, Campaign
from .campaigns import Setting
from .ported import Drawn, Physics, PortedMachine, Work
from .stewart_closure import StewartPose, closed, pose
from .stewart_drawing import (
    AXES,
    HEAVIEST,
    LEGS,
    OFFSET,
    PAYLOADS,
    PITCH,
    READINGS,
    SIGMA,
    STROKE,
    THERMOMETERS,
    TURN_SIGMA,
    A,
    B,
    document,
    drawing,
)

OVERSHOOT, LEVER, STEEPEST = 0.5, 500.0, np.radians(22.0)
LINEAR = joints.Axes(READINGS, np.full(6, -STROKE), np.full(6, STROKE), np.full(6, OVERSHOOT))
LENGTHS = tuple(f"{leg}.{field}" for leg in LEGS for field in ("offset", "a.x", "a.y", "b.x", "b.y"))


class Stewart(PortedMachine):
    """6-UPS with a ``pose`` sensor."""

    name: ClassVar[str] = "stewart"
    readings: ClassVar[tuple[str, ...]] = READINGS
    revolute: ClassVar[tuple[bool, ...]] = (False,) * 6
    columns: ClassVar[tuple[str, ...]] = AXES
    column_units: ClassVar[tuple[str, ...]] = ("mm",) * 3 + ("rad",) * 3

    @cached_property
    def drawing(self) -> Mapping[str, Drawn]:
        return drawing()

    @cached_property
    def setting(self) -> Setting:
        return Setting(
            LINEAR.low,
            LINEAR.high,
            THERMOMETERS,
            PAYLOADS,
            HEAVIEST,
            interval=(30.0, 90.0),
            speed=8.0,
            step=1e-3,
            accept=reachable,
        )

    @property
    def sigma(self) -> Array:
        return np.array([SIGMA] * 3 + [np.radians(TURN_SIGMA)] * 3)

    @cached_property
    def physics(self) -> tuple[Physics, ...]:
        return (*_of_legs(), *_of_parts(), *_of_instrument(), *_outside())

    def document(self, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
        return document(self.name, sigma_factor, tolerance_factor)

    def solve(self, work: Work) -> StewartPose:
        return pose(work)

    def see(self, work: Work) -> Array:
        tool = work.solved.tool
        return np.hstack([tool[:, :3, 3], rigid.rotation_vector(tool[:, :3, :3])])

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        """(n, 6) readings with noise on the position, and a small turn R Exp(w) of the orientation."""
        noise = factor * self.sigma * rng.standard_normal(exact.shape)
        turned = rigid.moved(exact)[:, :3, :3] @ rigid.moved(noise)[:, :3, :3]
        return np.hstack([exact[:, :3] + noise[:, :3], rigid.rotation_vector(turned)])


def reachable(q: Array) -> bool:
    """Whether the drawing's platform can be assembled at readings (6,) and does not tilt too far."""
    try:
        R, _ = closed(A[None], B[None], OFFSET + q[None])
    except (ValueError, np.linalg.LinAlgError):
        return False
    return bool(np.linalg.norm(rigid.rotation_vector(R)) < STEEPEST)


def _of_legs() -> tuple[Physics, ...]:
    return (
        joints.actuator_scale(LINEAR, READINGS, 5e-4),
        joints.screw_periodic(LINEAR, READINGS, PITCH, 0.015),
        joints.backlash(LINEAR, READINGS, 0.02),
        own.leg_compliance(2e-4),
        own.screw_windup(LINEAR, 2e-4),
        joints.zero_shift(LINEAR, READINGS, 0.03),
    )


def _of_parts() -> tuple[Physics, ...]:
    parts = {leg: own.leg_growth(k) for k, leg in enumerate(LEGS)}
    for part, end in (("base", "a"), ("platform", "b")):
        parts[part] = mounts.stretching(*(f"{leg}.{end}.{x}" for leg in LEGS for x in "xyz"))
    return (
        own.platform_deformation(),
        mounts.thermal_expansion(parts, 1.5e-5, "temperature.leg1"),
        mounts.mount_drift(("base", "tool"), 0.04, LEVER),
        mounts.frame_shift(("base", "tool"), 0.06, LEVER),
        mounts.wrong_constant(LENGTHS, 1.2),
    )


def _of_instrument() -> tuple[Physics, ...]:
    return (
        sensor_scale(3e-4, 3),
        mounts.outliers(0.2, np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])),
    )


def _outside() -> tuple[Physics, ...]:
    return (
        own.opening_preload(LINEAR, 4e-4),
        own.unwinding_screw(LINEAR, 0.3),
        own.dragged_hose(),
        own.heated_zero(0.01),
        own.swaying_floor(0.03, AXES, LEVER),
    )
