"""Mounts of telescopes: two axes that point a tube, alt-az or equatorial, told by angles alone.

The base frame of an equatorial mount has x where the meridian cuts the equator, y to the east, z at the north pole; that of an
alt-az mount x to the north, y to the west, z up. The first joint turns clockwise about z (hour angle, or azimuth from
the north by the east), the second lifts the tube towards z (declination, or altitude). Readings beyond 90 deg of the second
are the other side of the pier. The tube points along x of the flange.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

from truepose.errors import InputError
from truepose.models.builders.driven import Driven
from truepose.models.file.fields import Angle, Section
from truepose.models.machine.builder import BuildContext, builders
from truepose.models.machine.mechanism import BASE, Inertial, Joint, Mechanism, Parameter, Step

STANDARD_GRAVITY = 9.80665
UNWEIGHED = (Inertial("tool", 10.0, (500.0, 0.0, 0.0)), Inertial("tube", 10.0, (-500.0, 0.0, 0.0)))
"""A tube that nobody weighed, in balance about both axes: 10 kg half a metre out, 49 N m where it lies level, as small
telescopes have. A compliance is known up to that moment; what the tube droops by it is not touched."""
NAMES: Mapping[str, tuple[str, str]] = {"equatorial": ("ha", "dec"), "alt-az": ("az", "alt")}
"""What the two axes of each kind are called where the file does not say."""
SHAFT = "shaft"
"""The body between the two axes: fork, or what the declination axis is fixed to."""


class FirstAxis(Driven):
    """The polar or the vertical axis."""

    name: str | None = None
    """Its column of readings: `ha` or `az` where it is left out."""
    offset: Angle = 0.0
    """Added to the reading: the index error (IH; IA counts the other way)."""


class SecondAxis(FirstAxis):
    """The declination or the altitude axis."""

    name: str | None = None
    """Its column of readings: `dec` or `alt` where it is left out."""
    offset: Angle = 0.0
    """Added to the reading: the index error (ID or IE)."""
    tilt: Angle = 0.0
    """How far it is from being square to the first axis (NP or NPAE)."""


class Mount(Section):
    """The section ``mechanism`` of a telescope's mount."""

    type: Literal["mount"]
    """A telescope's mount: two axes that point a tube, told by angles alone."""
    kind: Literal["equatorial", "alt-az"]
    """Which way the first axis stands: at the pole, or at the zenith."""
    latitude: Angle | None = None
    """Of the place, north counts positive: it says which way gravity pulls on an equatorial mount."""
    first: FirstAxis = FirstAxis()
    """The axis that is fixed to the ground: polar, or vertical."""
    second: SecondAxis = SecondAxis()
    """The axis that carries the tube: declination, or altitude."""


@builders.add("mount")
def mount(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
    """Mechanism of a mount; bodies ``shaft`` between the axes and ``tube``, the flange."""
    parsed = context.parse(Mount, section)
    first, second = _names(parsed, context)

    def own(name: str, value: float, *field: str) -> Parameter:
        return context.parameter(name, "rad", value, field)

    parameters = (
        own(f"{first}.offset", parsed.first.offset, "first", "offset"),
        own(f"{second}.offset", parsed.second.offset, "second", "offset"),
        own(f"{second}.tilt", parsed.second.tilt, "second", "tilt"),
    )
    joints = (
        Joint(first, "revolute", BASE, SHAFT, axis=(0.0, 0.0, -1.0)),
        Joint(second, "revolute", SHAFT, "tube", (Step("rx", f"{second}.tilt"),), axis=(0.0, -1.0, 0.0)),
    )
    actuators = tuple(
        axis.actuator(name, name, "angle", context, offset=f"{name}.offset")
        for name, axis in ((first, parsed.first), (second, parsed.second))
    )
    gravity = _gravity(parsed)
    return Mechanism(
        parameters,
        joints,
        actuators,
        "tube",
        inertials=UNWEIGHED if gravity else (),
        gravity=gravity,
        notes=(_UNWEIGHED_NOTE,) if gravity else (),
    )


_UNWEIGHED_NOTE = (
    "the tube counts as 10 kg half a metre out, in balance: by how much it droops does not depend on that; state `masses:` "
    "where compliances are to be those of the real tube"
)


def _names(parsed: Mount, context: BuildContext) -> tuple[str, str]:
    usual = NAMES[parsed.kind]
    first, second = parsed.first.name or usual[0], parsed.second.name or usual[1]
    if first == second:
        raise InputError(f"{context.where}: found both axes called {first!r}, expected two names that differ")
    return first, second


def _gravity(parsed: Mount) -> tuple[float, float, float] | None:
    """m/s^2 in the base frame; None of an equatorial mount whose place is not known."""
    if parsed.kind == "alt-az":
        return (0.0, 0.0, -STANDARD_GRAVITY)
    if parsed.latitude is None:
        return None
    along, up = math.cos(parsed.latitude), math.sin(parsed.latitude)
    return (-STANDARD_GRAVITY * along, 0.0, -STANDARD_GRAVITY * up)
