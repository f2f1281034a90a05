"""Change of the length of a Fabry-Perot cavity: a beam fixed in the world, a plane mirror on the flange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import casadi as ca
from pydantic import Field

from truepose.models import lie
from truepose.models.file.fields import (
    Angle,
    AngleTolerance,
    Length,
    LengthSigma,
    LengthTolerance,
    LengthToleranceVector,
    LengthVector,
    Section,
)
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Parameter
from truepose.models.machine.sensor import TOOL_POSE, Channel, Sensor, flange_of, sensors


class _Beam(Section):
    in_: Literal["world"] = Field(default="world", alias="in")
    """The beam stands in the sensor's frame."""
    xyz: LengthVector
    """Where the light starts: the fibre's end."""
    rx: Angle = 0.0
    """First turn of the beam, about x; the light travels along its z axis."""
    rz: Angle = 0.0
    """Second turn of the beam, about z: Trans(xyz) RotX(rx) RotZ(rz)."""


class _Mirror(Section):
    in_: Literal["flange", "tool"] = Field(default="flange", alias="in")
    """What carries the mirror."""
    z: Length = 0.0
    """Height of the mirror along z."""
    rx: Angle = 0.0
    """Tilt of the mirror about x; the mirror is its own xy plane."""
    ry: Angle = 0.0
    """Tilt of the mirror about y: Trans(0, 0, z) RotX(rx) RotY(ry)."""


class _Sigma(Section):
    distance: LengthSigma
    """1-sigma of one change of length."""


class _Tolerance(Section):
    beam_xyz: LengthToleranceVector = (0.0, 0.0, 0.0)
    """1-sigma of where the light starts."""
    beam_angle: AngleTolerance = 0.0
    """1-sigma of the beam's two turns."""
    mirror_z: LengthTolerance = 0.0
    """1-sigma of the mirror's height."""
    mirror_angle: AngleTolerance = 0.0
    """1-sigma of the mirror's two tilts."""

    model_config = Section.model_config | {"alias_generator": lambda name: name.replace("_", ".")}


class CavitySection(Section):
    """What every sensor of a cavity's length says of its geometry."""

    beam: _Beam
    """The beam, fixed in the world."""
    mirror: _Mirror
    """The plane mirror that the machine moves."""
    sigma: _Sigma
    """How noisy a reading is; replicates tell whether it is right."""
    tolerance: _Tolerance = _Tolerance()
    """How well beam and mirror are known; left out: exactly."""


class _DistanceSection(CavitySection):
    type: Literal["distance"]
    """Change of one distance along a fixed beam since the row that `from` names: column `dL`."""
    wavelength: Length | None = Field(default=None, gt=0.0)
    """Wavelength of the light: errors that repeat with its fringes are looked for."""


@sensors.add("distance")
@dataclass(frozen=True)
class Distance(Sensor):
    """dL: cavity length now less at the row ``from`` (nanopositioner paper, eqs. 15-26).

    ``wavelength`` of the light in mm, None where the machine file does not say it.
    """

    parameters: tuple[Parameter, ...] = field()
    sigma: float
    on_flange: bool
    wavelength: float | None
    type = "distance"
    differs_from_row: ClassVar[bool] = True

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Distance:
        """From ``beam``, ``mirror``, ``sigma: {distance}``, ``tolerance`` and ``wavelength``."""
        parsed = context.parse(_DistanceSection, section)
        return cls(
            cavity_parameters(parsed, context),
            parsed.sigma.distance,
            parsed.mirror.in_ == "flange",
            parsed.wavelength,
        )

    @property
    def columns(self) -> Mapping[str, str]:
        """dL, mm."""
        return {"dL": "mm"}

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One length."""
        return (Channel("dL", "mm", self.sigma, "distance", "dL"),)

    @property
    def reads(self) -> tuple[str, ...]:
        """The tool frame, where the mirror is fixed to the flange that carries it."""
        return TOOL_POSE if self.on_flange else ()

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """Length along the beam's z axis to the mirror's plane, mm."""
        origin = ca.vertcat(s["beam.x"], s["beam.y"], s["beam.z"])
        light = (lie.rot_x(s["beam.rx"]) @ lie.rot_z(s["beam.rz"]))[:3, 2]
        shift = lie.translation(ca.SX(0), ca.SX(0), s["mirror.z"])
        mirror = ca.mtimes(
            [
                flange_of(world, s) if self.on_flange else world,
                shift,
                lie.rot_x(s["mirror.rx"]),
                lie.rot_y(s["mirror.ry"]),
            ]
        )
        normal = mirror[:3, 2]
        return ca.dot(normal, mirror[:3, 3] - origin) / ca.dot(normal, light)


def cavity_parameters(section: CavitySection, context: BuildContext) -> tuple[Parameter, ...]:
    """beam.x beam.y beam.z beam.rx beam.rz mirror.z mirror.rx mirror.ry, with their tolerances."""
    beam, mirror, tol = section.beam, section.mirror, section.tolerance

    def own(name: str, unit: str, value: float, tolerance: float, *field: str | int) -> Parameter:
        return context.parameter(name, unit, value, field, "sensor", tolerance)

    point = context.vector("beam", beam.xyz, ("beam", "xyz"), "sensor", tol.beam_xyz)
    turns = (("beam", "rx", beam.rx), ("beam", "rz", beam.rz))
    light = [own(f"{at}.{a}", "rad", v, tol.beam_angle, at, a) for at, a, v in turns]
    height = own("mirror.z", "mm", mirror.z, tol.mirror_z, "mirror", "z")
    tilts = (("mirror", "rx", mirror.rx), ("mirror", "ry", mirror.ry))
    plane = [own(f"{at}.{a}", "rad", v, tol.mirror_angle, at, a) for at, a, v in tilts]
    return (*point, *light, height, *plane)
