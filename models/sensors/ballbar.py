"""A ball bar: the distance between a ball on the base and a ball on the tool (ISO 230-4 and like it, any pose)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca

from truepose.models.file.fields import LengthSigma, LengthToleranceVector, LengthVector, Section
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Parameter
from truepose.models.machine.sensor import TOOL_IN_WORLD, Channel, Sensor, View, ViewSection, sensors
from truepose.models.machine.sensor import prefix as opening

_NOWHERE = (0.0, 0.0, 0.0)


class _Sigma(Section):
    distance: LengthSigma
    """1-sigma of one length."""


class _Tolerance(Section):
    centre: LengthToleranceVector = _NOWHERE
    """1-sigma of the base ball's place."""
    ball: LengthToleranceVector = _NOWHERE
    """1-sigma of the tool ball's place."""


class _BallBarSection(ViewSection):
    type: Literal["ballbar"]
    """Distance between a ball on the base and a ball on the tool: column `length`."""
    name: str | None = None
    """Tells several bars apart: the column is then `NAME.length`, the parameters `NAME.centre.x` ..."""
    centre: LengthVector
    """Centre of the base ball, in the sensor's frame."""
    ball: LengthVector = _NOWHERE
    """Centre of the tool ball, in the tool frame."""
    sigma: _Sigma
    """How noisy a reading is; replicates tell whether it is right."""
    tolerance: _Tolerance = _Tolerance()
    """How well the balls' places are known; left out: exactly."""


@sensors.add("ballbar")
@dataclass(frozen=True)
class BallBar(Sensor):
    """length: from the ball ``centre`` (sensor frame) to the ball ``ball`` (tool frame).

    ``prefix`` tells several bars apart: it opens the names of the column and of the parameters.
    """

    parameters: tuple[Parameter, ...] = field()
    sigma: float
    prefix: str = ""
    view: View = TOOL_IN_WORLD
    type = "ballbar"
    touches = True
    opens_columns = True

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> BallBar:
        """From ``centre``, ``ball``, ``sigma: {distance}``, ``tolerance: {centre, ball}``, ``tip``, ``in`` and ``name``."""
        parsed = context.parse(_BallBarSection, section)
        prefix = opening(parsed.name)
        known = parsed.tolerance
        own = (
            *context.vector(f"{prefix}centre", parsed.centre, ("centre",), "sensor", known.centre),
            *context.vector(f"{prefix}ball", parsed.ball, ("ball",), "sensor", known.ball),
        )
        return cls(own, parsed.sigma.distance, prefix, parsed.view(context))

    @property
    def columns(self) -> Mapping[str, str]:
        """length, mm."""
        return {f"{self.prefix}length": "mm"}

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One length."""
        name = f"{self.prefix}length"
        return (Channel(name, "mm", self.sigma, "distance", name),)

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """|world * ball - centre|, mm."""
        centre, ball = (
            ca.vertcat(*(s[p.name] for p in part)) for part in (self.parameters[:3], self.parameters[3:])
        )
        return ca.norm_2(world[:3, :3] @ ball + world[:3, 3] - centre)
