"""Position and full pose of the tool frame (laser tracker with a 6-D probe, motion capture)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models import lie
from truepose.models.file.fields import AngleSigma, LengthSigma, Section
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import AXES, AXIS_UNITS
from truepose.models.machine.sensor import TOOL_IN_WORLD, Channel, Sensor, View, ViewSection, prefix, sensors

_XYZ, _ROT = AXES[:3], AXES[3:]


class _Sigma(Section):
    xyz: LengthSigma
    """1-sigma of x, y and z each."""
    rot: AngleSigma
    """1-sigma of each component of the small rotation between the reading and the truth."""


class _PoseSection(ViewSection):
    type: Literal["pose"]
    """Position and orientation of the tool frame: columns `x y z rx ry rz`, the last three a rotation vector."""
    name: str | None = None
    """Tells several sensors apart: the columns are then `NAME.x` ..."""
    sigma: _Sigma
    """How noisy a reading is; replicates tell whether it is right."""


class _PositionSigma(Section):
    xyz: LengthSigma
    """1-sigma of x, y and z each."""


class _PositionSection(ViewSection):
    type: Literal["position"]
    """Position of the tool frame's origin: columns `x y z`."""
    name: str | None = None
    """Tells several sensors apart: the columns are then `NAME.x` ..."""
    sigma: _PositionSigma
    """How noisy a reading is; replicates tell whether it is right."""


@sensors.add("pose")
@dataclass(frozen=True)
class Pose(Sensor):
    """x y z and a rotation vector; the rotation residual is Log(R_measured' R), rad."""

    sigma_xyz: float
    sigma_rot: float
    view: View = TOOL_IN_WORLD
    prefix: str = ""
    type = "pose"
    takes_pictures = True
    opens_columns = True

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Pose:
        """From ``sigma: {xyz, rot}``, ``tip``, ``in`` and an optional ``name``."""
        parsed = context.parse(_PoseSection, section)
        return cls(parsed.sigma.xyz, parsed.sigma.rot, parsed.view(context), prefix(parsed.name))

    @property
    def columns(self) -> Mapping[str, str]:
        """x y z mm, rx ry rz rad."""
        return {f"{self.prefix}{axis}": unit for axis, unit in AXIS_UNITS.items()}

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Three lengths, three small angles."""
        own, tip = self.prefix, f"{self.prefix}{self.view.tip}"
        return (
            *(Channel(f"{own}{name}", "mm", self.sigma_xyz, "position", tip) for name in _XYZ),
            *(Channel(f"{own}{name}", "rad", self.sigma_rot, "rotation", tip) for name in _ROT),
        )

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """Position and rotation vector (turns below 180 deg; ``values`` has no such limit)."""
        return ca.vertcat(world[:3, 3], lie.log_so3_sx(world[:3, :3]))

    def residual(self, world: ca.SX, s: Mapping[str, ca.SX], reading: ca.SX) -> ca.SX:
        """p - p_measured, Log(R_measured' R)."""
        angle = ca.sqrt(ca.sumsqr(reading[3:]) + 1e-30)
        measured = lie.axis_rotation(reading[3:] / angle, angle)
        return ca.vertcat(world[:3, 3] - reading[:3], lie.log_so3_sx(measured.T @ world[:3, :3]))

    def values(self, world: Array, predicted: Array) -> Array:
        """(n, 6) positions, mm, and rotation vectors, rad, with angle in [0, pi] whatever the pose."""
        return np.hstack([world[:, :3, 3], lie.log_so3(world[:, :3, :3])])

    def noisy(self, values: Array, rng: np.random.Generator) -> Array:
        """(n, 6) readings; noise turns a rotation R into R Exp(noise)."""
        noise = rng.standard_normal((len(values), 6))
        turned = lie.exp_so3(values[:, 3:]) @ lie.exp_so3(self.sigma_rot * noise[:, 3:])
        return np.hstack([values[:, :3] + self.sigma_xyz * noise[:, :3], lie.log_so3(turned)])


@sensors.add("position")
@dataclass(frozen=True)
class Position(Sensor):
    """x y z of the tool frame's origin."""

    sigma_xyz: float
    view: View = TOOL_IN_WORLD
    prefix: str = ""
    type = "position"
    opens_columns = True

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Position:
        """From ``sigma: {xyz}``, ``tip``, ``in`` and an optional ``name``."""
        parsed = context.parse(_PositionSection, section)
        return cls(parsed.sigma.xyz, parsed.view(context), prefix(parsed.name))

    @property
    def columns(self) -> Mapping[str, str]:
        """x y z, mm."""
        return {f"{self.prefix}{axis}": "mm" for axis in _XYZ}

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Three lengths of one point."""
        tip = f"{self.prefix}{self.view.tip}"
        return tuple(Channel(f"{self.prefix}{n}", "mm", self.sigma_xyz, "position", tip) for n in _XYZ)

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """The tool frame's origin, mm."""
        return world[:3, 3]
