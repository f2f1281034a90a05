"""An inclinometer on the tool: how far two of its axes point above the horizon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca
import numpy as np

from truepose.errors import InputError
from truepose.models import lie
from truepose.models.file.fields import Angle, AngleSigma, AngleTolerance, Section
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Parameter
from truepose.models.machine.sensor import Channel, Sensor, sensors

TURNS = ("base.rx", "base.ry", "base.rz")
_LEVEL = 1e-30


class _Sigma(Section):
    angle: AngleSigma
    """1-sigma of each of the two angles."""


class _Tolerance(Section):
    zero: AngleTolerance = 0.0
    """1-sigma of what each of the two reads where it is level."""


class _Zero(Section):
    x: Angle = 0.0
    """Of the x axis."""
    y: Angle = 0.0
    """Of the y axis."""


class _TiltSection(Section):
    type: Literal["tilt"]
    """An inclinometer: columns `tilt.x tilt.y`, how far the tool's x and y axes point above the horizon. Needs `gravity`."""
    name: str = "tilt"
    """Tells several apart: the columns are `NAME.x NAME.y`, the parameters `NAME.zero.x NAME.zero.y`."""
    zero: _Zero = _Zero()
    """What it reads where the axes are level."""
    sigma: _Sigma
    """How noisy a reading is; replicates tell whether it is right."""
    tolerance: _Tolerance = _Tolerance()
    """How well its zeros are known; left out: exactly."""


@sensors.add("tilt")
@dataclass(frozen=True)
class Tilt(Sensor):
    """Angles of the tool's x and y axes above the horizon, rad; ``up`` is a unit vector in the base frame."""

    name: str
    up: tuple[float, float, float]
    parameters: tuple[Parameter, ...] = field()
    sigma: float
    type = "tilt"

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Tilt:
        """From ``sigma: {angle}``, ``tolerance: {zero}`` and an optional ``name``."""
        parsed = context.parse(_TiltSection, section)
        gravity = context.file.gravity
        if gravity is None or not any(gravity):
            raise InputError(
                f"{context.where}: found no `gravity:` in the file, expected it: an inclinometer reads which way is down"
            )
        up = -np.array(gravity) / np.linalg.norm(gravity)
        own = tuple(
            context.parameter(
                f"{parsed.name}.zero.{axis}", "rad", value, ("zero", axis), "sensor", parsed.tolerance.zero
            )
            for axis, value in (("x", parsed.zero.x), ("y", parsed.zero.y))
        )
        return cls(parsed.name, (float(up[0]), float(up[1]), float(up[2])), own, parsed.sigma.angle)

    @property
    def columns(self) -> Mapping[str, str]:
        """tilt.x tilt.y, rad."""
        return {f"{self.name}.{axis}": "rad" for axis in "xy"}

    @property
    def shiftable(self) -> tuple[str, ...]:
        """Both."""
        return tuple(self.columns)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Two angles."""
        return tuple(Channel(column, "rad", self.sigma, "tilt", self.name) for column in self.columns)

    @property
    def reads(self) -> tuple[str, ...]:
        """How the base is turned: gravity is given in its frame."""
        return TURNS

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """Zero plus the angle of each axis above the horizon."""
        base = lie.rpy_transform([ca.SX(0)] * 3, [s[name] for name in TURNS])[:3, :3]
        up = world[:3, :3].T @ (base @ ca.DM(self.up))
        level = ca.vertcat(ca.sumsqr(up[1:]), up[0] ** 2 + up[2] ** 2)
        return ca.vertcat(
            *(
                s[zero.name] + ca.atan2(up[k], ca.sqrt(level[k] + _LEVEL))
                for k, zero in enumerate(self.parameters)
            )
        )
