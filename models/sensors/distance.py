"""Change of the length of a Fabry-Perot cavity: a beam fixed in the world, a plane mirror on the flange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import casadi as ca

from truepose.models import lie
from truepose.models.context import BuildContext
from truepose.models.parameters import Parameter
from truepose.models.sensors.base import Channel, Sensor, sensors
from truepose.models.units import Angle, AngleTolerance, Length, LengthTolerance, LengthToleranceVector, LengthVector, Section


class _Beam(Section):
    in_: Literal["world"] = "world"
    xyz: LengthVector
    rx: Angle = 0.0
    rz: Angle = 0.0

    model_config = Section.model_config | {"populate_by_name": True, "alias_generator": lambda name: "in" if name == "in_" else name}


class _Mirror(Section):
    in_: Literal["flange", "tool"] = "flange"
    z: Length = 0.0
    rx: Angle = 0.0
    ry: Angle = 0.0

    model_config = Section.model_config | {"populate_by_name": True, "alias_generator": lambda name: "in" if name == "in_" else name}


class _Sigma(Section):
    distance: LengthTolerance


class _Tolerance(Section):
    beam_xyz: LengthToleranceVector = (0.0, 0.0, 0.0)
    beam_angle: AngleTolerance = 0.0
    mirror_z: LengthTolerance = 0.0
    mirror_angle: AngleTolerance = 0.0

    model_config = Section.model_config | {"alias_generator": lambda name: name.replace("_", ".")}


class _DistanceSection(Section):
    type: Literal["distance"]
    beam: _Beam
    mirror: _Mirror
    sigma: _Sigma
    tolerance: _Tolerance = _Tolerance()
    wavelength: Length | None = None


@sensors.add("distance")
@dataclass(frozen=True)
class Distance(Sensor):
    """dL: cavity length now less at the row ``from`` (nanopositioner paper, eqs. 15-26)."""

    own: tuple[Parameter, ...]
    sigma: float
    type = "distance"
    differs_from_row: ClassVar[bool] = True

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Distance:
        """From ``beam``, ``mirror``, ``sigma: {distance}`` and ``tolerance``."""
        parsed = context.parse(_DistanceSection, section)
        beam, mirror, tol = parsed.beam, parsed.mirror, parsed.tolerance
        rows: list[tuple[str, str, float, float, tuple[str | int, ...]]] = [
            *((f"beam.{a}", "mm", beam.xyz[k], tol.beam_xyz[k], ("beam", "xyz", k)) for k, a in enumerate("xyz")),
            *((f"beam.{a}", "rad", v, tol.beam_angle, ("beam", a)) for a, v in (("rx", beam.rx), ("rz", beam.rz))),
            ("mirror.z", "mm", mirror.z, tol.mirror_z, ("mirror", "z")),
            *((f"mirror.{a}", "rad", v, tol.mirror_angle, ("mirror", a)) for a, v in (("rx", mirror.rx), ("ry", mirror.ry))),
        ]
        return cls(tuple(context.parameter(n, u, v, f, "sensor", t) for n, u, v, t, f in rows), parsed.sigma.distance)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """beam.x beam.y beam.z beam.rx beam.rz mirror.z mirror.rx mirror.ry."""
        return self.own

    @property
    def columns(self) -> Mapping[str, str]:
        """dL, mm."""
        return {"dL": "mm"}

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One length."""
        return (Channel("dL", "mm", self.sigma, "distance", "dL"),)

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """Length along the beam's z axis to the mirror's plane, mm."""
        beam = ca.mtimes([lie.translation(s["beam.x"], s["beam.y"], s["beam.z"]), lie.rot_x(s["beam.rx"]), lie.rot_z(s["beam.rz"])])
        zero = ca.SX(0)
        mirror = ca.mtimes(
            [world, lie.translation(zero, zero, s["mirror.z"]), lie.rot_x(s["mirror.rx"]), lie.rot_y(s["mirror.ry"])]
        )
        normal = mirror[:3, 2]
        return ca.dot(normal, mirror[:3, 3] - beam[:3, 3]) / ca.dot(normal, beam[:3, 2])
