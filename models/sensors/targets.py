"""Several points on the tool body (photogrammetry, a tracker with several reflectors)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca

from truepose.errors import InputError
from truepose.models.file.fields import LengthSigma, LengthTolerance, LengthVector, Section
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Parameter, vector_of
from truepose.models.machine.sensor import TOOL_IN_WORLD, Channel, Sensor, View, ViewSection, sensors


class _Sigma(Section):
    xyz: LengthSigma
    """1-sigma of x, y and z of each point."""


class _Tolerance(Section):
    points: LengthTolerance = 0.0
    """1-sigma of every coordinate of the points in the tool frame."""


class _TargetsSection(ViewSection):
    type: Literal["targets"]
    """Several points on the tool: columns `P1.x P1.y P1.z P2.x ...` in the sensor's frame."""
    points: dict[str, LengthVector]
    """The points by name, in the tool frame."""
    sigma: _Sigma
    """How noisy a reading is; replicates tell whether it is right."""
    tolerance: _Tolerance = _Tolerance()
    """How well the points are known on the tool; left out: exactly."""


@sensors.add("targets")
@dataclass(frozen=True)
class Targets(Sensor):
    """Points P1, P2 ... in the tool frame, read as P1.x P1.y P1.z ... in the sensor frame."""

    parameters: tuple[Parameter, ...] = field()
    sigma_xyz: float
    view: View = TOOL_IN_WORLD
    type = "targets"
    takes_pictures = True

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Targets:
        """From ``points``, ``sigma: {xyz}``, ``tolerance: {points}``, ``tip`` and ``in``."""
        parsed = context.parse(_TargetsSection, section)
        if not parsed.points:
            raise InputError(f"{context.where}.points: found no point, expected at least one")
        known = 3 * (parsed.tolerance.points,)
        points = tuple(
            parameter
            for name, point in parsed.points.items()
            for parameter in context.vector(name, point, ("points", name), "target", known)
        )
        return cls(points, parsed.sigma.xyz, parsed.view(context))

    @property
    def columns(self) -> Mapping[str, str]:
        """P1.x P1.y P1.z ..., mm."""
        return {p.name: "mm" for p in self.parameters}

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Three lengths a point."""
        return tuple(
            Channel(p.name, "mm", self.sigma_xyz, "position", vector_of(p.name)) for p in self.parameters
        )

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """world * point for every point, mm."""
        names = [p.name for p in self.parameters]
        triples = [names[k : k + 3] for k in range(0, len(names), 3)]
        return ca.vertcat(
            *(world[:3, :3] @ ca.vertcat(*(s[n] for n in triple)) + world[:3, 3] for triple in triples)
        )
