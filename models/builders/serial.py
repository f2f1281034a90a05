"""Serial chains of one-degree-of-freedom joints, Khalil-Kleinfinger convention with Hayati's extra turn.

T(i-1, i) = RotY(beta) RotX(alpha) TransX(d) RotZ(theta) TransZ(r); the reading adds to theta (revolute)
or r (prismatic). Hayati's beta keeps the description continuous where neighbouring axes are parallel;
elsewhere it is redundant and the tolerances decide how it shares with theta and r.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Literal

from pydantic import model_validator

from truepose.errors import InputError
from truepose.models.builders.base import builders
from truepose.models.context import BuildContext
from truepose.models.fields import Angle, Length, Number, Range, Section, bad_value
from truepose.models.mechanism import BASE, Actuator, Joint, Mechanism, Step
from truepose.models.parameters import Parameter
from truepose.models.units import UnitSystem

_STEPS = (
    ("ry", "beta", "rad"),
    ("rx", "alpha", "rad"),
    ("tx", "d", "mm"),
    ("rz", "theta", "rad"),
    ("tz", "r", "mm"),
)


class SerialJoint(Section):
    """One row of the table of constants."""

    name: str
    """What the joint is called: the recording's column of its readings has this name."""
    kind: Literal["revolute", "prismatic"]
    """Whether it turns about its z axis or slides along it."""
    beta: Angle = 0.0
    """Hayati's extra turn about y, first of all; leave it out unless the drawing has one."""
    alpha: Angle = 0.0
    """Twist: turn about x from the axis before to this one."""
    d: Length = 0.0
    """Distance along x from the axis before to this one. It is not the `d` of the standard convention."""
    theta: Angle = 0.0
    """Turn about z at reading 0; a revolute joint's reading adds to it."""
    r: Length = 0.0
    """Shift along z at reading 0; a prismatic joint's reading adds to it."""
    range: Range | None = None
    """Lowest and highest reading. Readings outside by more than 5 % of the width are refused; plans stay within it."""
    gear_ratio: Number | None = None
    """Turns of the motor for one of the joint: errors that repeat with the motor's turn are looked for."""
    screw_pitch: Length | None = None
    """Travel for one turn of the screw: errors that repeat with it are looked for."""

    @model_validator(mode="after")
    def _ordered(self) -> SerialJoint:
        if self.range and self.range[0] >= self.range[1]:
            raise bad_value("range: [low, high] with low < high", self.range)
        return self


class Serial(Section):
    """The section ``mechanism`` of a serial chain."""

    type: Literal["serial"]
    """A chain of joints of one degree of freedom each."""
    joints: tuple[SerialJoint, ...]
    """The rows of the table of constants, from the base to the flange."""


@builders.add("serial")
def serial(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
    """Mechanism of a serial chain; bodies ``link1 ... linkN``, flange ``linkN``."""
    chain = context.parse(Serial, section)
    names = [joint.name for joint in chain.joints]
    if not names or len(set(names)) != len(names):
        raise InputError(
            f"{context.where}.joints: found {names}, expected at least one joint, each with a name of its own"
        )
    parameters: list[Parameter] = []
    joints, actuators = [], []
    for k, row in enumerate(chain.joints, start=1):
        values = row.model_dump()
        parameters += [
            context.parameter(f"{row.name}.{field}", unit, values[field], ("joints", k - 1, field))
            for _, field, unit in _STEPS
        ]
        placement = tuple(Step(kind, f"{row.name}.{field}") for kind, field, _ in _STEPS)
        parent = BASE if k == 1 else f"link{k - 1}"
        joints.append(Joint(row.name, row.kind, parent, f"link{k}", placement))
        actuators.append(_actuator(row, context.file.units))
    return Mechanism(
        tuple(parameters), tuple(joints), tuple(actuators), f"link{len(names)}", lengths=_lengths(names)
    )


def _actuator(row: SerialJoint, units: UnitSystem) -> Actuator:
    unit = "rad" if row.kind == "revolute" else "mm"
    dimension = "angle" if row.kind == "revolute" else "length"
    limits = (
        None
        if row.range is None
        else (units.to_internal(row.range[0], dimension), units.to_internal(row.range[1], dimension))
    )
    return Actuator(
        row.name, row.name, unit, unit, range=limits, gear_ratio=row.gear_ratio, screw_pitch=row.screw_pitch
    )


def _lengths(names: list[str]) -> dict[str, tuple[str, ...]]:
    """What heats up together: r and d of the first joint with the base, then what lies between joints K and
    K+1 (link1: only d of joint 2)."""
    out: dict[str, tuple[str, ...]] = {BASE: (f"{names[0]}.r", f"{names[0]}.d")}
    for k, (here, after) in enumerate(pairwise(names), start=1):
        out[f"link{k}"] = (f"{after}.d",) if k == 1 else (f"{here}.r", f"{after}.d")
    if len(names) > 1:
        out[f"link{len(names)}"] = (f"{names[-1]}.r",)
    return out
