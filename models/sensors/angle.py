"""Encoders on the load side of joints, and scales along slides: what a joint truly does after gear, play and compliance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import casadi as ca
from pydantic import Field

from truepose.errors import InputError
from truepose.models.file.fields import (
    AngleSigma,
    AngleTolerance,
    In,
    LengthSigma,
    LengthTolerance,
    Number,
    Section,
)
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Actuator, Mechanism, Parameter
from truepose.models.machine.sensor import Channel, Sensor, sensors
from truepose.wording import close_matches, joined

PART: Mapping[str, Literal["angle", "length"]] = {"rad": "angle", "mm": "length"}
"""The key of ``sigma`` and of ``tolerance`` by the unit of a joint's way."""


class _Sigma(Section):
    angle: AngleSigma | None = None
    """1-sigma of one reading of a joint that turns."""
    length: LengthSigma | None = None
    """1-sigma of one reading of a joint that slides."""


class _Tolerance(Section):
    angle: AngleTolerance = 0.0
    """1-sigma of the zeros of joints that turn; .inf where they are unknown."""
    length: LengthTolerance = 0.0
    """1-sigma of the zeros of joints that slide; .inf where they are unknown."""


class _AngleSection(Section):
    type: Literal["angle"]
    """Encoders on the load side of joints: columns `angle.q1` ..., how far each joint truly is from where its reading is 0."""
    joints: tuple[str, ...] | None = None
    """Joints that have one; left out: all."""
    name: str = "angle"
    """Opens the columns and the parameters: `NAME.q1`, `NAME.zero.q1`. Tells several apart."""
    zero: dict[str, Annotated[Number, In("reading")]] = Field(default_factory=dict)
    """By joint: what it reads where the joint's own reading is 0; left out: 0."""
    sigma: _Sigma
    """How noisy a reading is: of joints that turn, of joints that slide, or of both."""
    tolerance: _Tolerance = _Tolerance()
    """How well the zeros are known; left out: exactly."""


@sensors.add("angle")
@dataclass(frozen=True)
class Angle(Sensor):
    """NAME.J: zero plus the way of joint J from where its reading is 0, mm or rad, with all that effects do to it.

    The joint's own offset (``J.theta``, ``J.offset``) is no part of it: where a link stands is not seen from an encoder.
    """

    name: str
    actuators: tuple[Actuator, ...]
    parameters: tuple[Parameter, ...] = field()
    sigma: Mapping[str, float]
    type = "angle"
    touches = True

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Angle:
        """From ``joints``, ``zero``, ``sigma: {angle, length}``, ``tolerance: {angle, length}`` and an optional ``name``."""
        parsed = context.parse(_AngleSection, section)
        if context.mechanism is None:
            raise InputError(f"{context.where}: found no mechanism, expected one: encoders are on its joints")
        chosen = _chosen(parsed, context.mechanism, context.where)
        stated = {"rad": parsed.sigma.angle, "mm": parsed.sigma.length}
        for actuator in chosen:
            if stated[actuator.unit] is None:
                part = PART[actuator.unit]
                raise InputError(
                    f"{context.where}.sigma: found no `{part}`, expected it: {actuator.reading} "
                    f"{'turns' if part == 'angle' else 'slides'}"
                )
        sigma = {unit: value for unit, value in stated.items() if value is not None}
        return cls(parsed.name, chosen, tuple(_zero(parsed, a, context) for a in chosen), sigma)

    @property
    def joints(self) -> Mapping[str, str]:
        """Every column reads its joint."""
        return {f"{self.name}.{actuator.reading}": actuator.reading for actuator in self.actuators}

    @property
    def columns(self) -> Mapping[str, str]:
        """NAME.J, mm or rad."""
        return {f"{self.name}.{actuator.reading}": actuator.unit for actuator in self.actuators}

    @property
    def shiftable(self) -> tuple[str, ...]:
        """All."""
        return tuple(self.columns)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One for each joint, of kind ``angle`` or ``length``."""
        return tuple(Channel(n, unit, self.sigma[unit], PART[unit], n) for n, unit in self.columns.items())

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """The zeros; the model adds the joints' ways (see ``joints``)."""
        return ca.vertcat(*(s[zero.name] for zero in self.parameters))

    def residual(self, world: ca.SX, s: Mapping[str, ca.SX], reading: ca.SX) -> ca.SX:
        """Prediction less reading; of angles without whole turns, which one disc does not tell apart."""
        off = self.predict(world, s) - reading
        turns = [actuator.unit == "rad" for actuator in self.actuators]
        return ca.vertcat(
            *(ca.atan2(ca.sin(off[k]), ca.cos(off[k])) if t else off[k] for k, t in enumerate(turns))
        )


def _chosen(parsed: _AngleSection, mechanism: Mechanism, where: str) -> tuple[Actuator, ...]:
    """Actuators with an encoder. Raises InputError for a joint that the machine has not, or that is named twice."""
    known = mechanism.readings
    names = known if parsed.joints is None else parsed.joints
    if not names or len(set(names)) < len(names):
        raise InputError(
            f"{where}.joints: found {joined(names) or 'none'}, expected some joints, each of them once"
        )
    for key, mentioned, among in (("joints", names, known), ("zero", parsed.zero, names)):
        strange = next((name for name in mentioned if name not in among), None)
        if strange is not None:
            raise InputError(
                f"{where}.{key}: found {strange!r}, expected among {', '.join(among)}; {close_matches(strange, among)}"
            )
    return tuple(mechanism.actuator(name) for name in names)


def _zero(parsed: _AngleSection, actuator: Actuator, context: BuildContext) -> Parameter:
    joint, unit = actuator.reading, actuator.unit
    part = PART[unit]
    value = context.file.units.to_internal(parsed.zero.get(joint, 0.0), part)
    tolerance = parsed.tolerance.angle if part == "angle" else parsed.tolerance.length
    return context.parameter(f"{parsed.name}.zero.{joint}", unit, value, ("zero", joint), "sensor", tolerance)
