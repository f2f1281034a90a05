"""What bends under its own weight and that of what it carries: mounts, tubes, forks and axes of telescopes."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.effects.base import (
    NO_SETTINGS,
    Coefficient,
    Effect,
    Place,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.effects.common import carried, down, points_only, singly
from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.assembly import placed_frame
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE, Direction, Joint
from truepose.models.machine.placed import SWITCH, ranges

SOFTEST = {"base": 1e-5, "tool": 1e-4}
"""rad/(N m): a base on a stand or a table; a flange that carries a newton metre and turns by a tenth of a milliradian."""
TUBES = 10.0
"""How likely a telescope's tube droops, in terms of other mounts: all do by some arcsec, while few axes have an encoder or
a scale that errs as much, which from one side of an alt-az mount is the same."""


@effects.add("gravity-sag")
class GravitySag(Effect):
    """A base or a tool mount that yields to the moment of the weight it carries.

    The mount turns by c times the moment of gravity (and measured forces) about its origin, equally about every axis.
    """

    slug = "gravity-sag"
    setting_ranges = NO_SETTINGS
    title = "Mount that sags"
    counted = True
    formula = "rotation of the mount = c M, M the moment of gravity about it"
    size = (
        "1e-9 to 1e-6 rad/(N*m) for a base on the floor, ten times more on a stand; a tool's mount carries less and may "
        "give way a hundred times more"
    )
    look_alikes = ("joint-compliance", "link-bending", "mount-drift")
    experiment = "put a level on the mount, reach out and in, and step the payload"
    source = "an elastic foundation in series with the arm"
    needs_load = True
    commonness = 0.3  # mounts are bolted down; joints turn in gears

    def places(self, machine: Machine) -> Sequence[Place]:
        if not machine.loaded:
            return []
        heavy = {"tool" if m.name == PAYLOAD else m.body for m in machine.masses}
        loaded = heavy | {force.body for force in machine.forces}
        return singly(name for name in machine.standing if name == "base" or name in loaded)

    def likely(self, machine: Machine, place: Place) -> float:
        """Tubes of telescopes droop."""
        return TUBES if place == ("tool",) and points_only(machine) else 1.0

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("c", "rad/(N*m)", scale=SOFTEST.get(place[0], SOFTEST["tool"]), lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        ports = [f"{site.place[0]}.motion.{axis}" for axis in ("rx", "ry", "rz")]
        return {port: site.c["c"] * site.load(port) for port in ports}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return f"The mount of the {place[0]} yields: it turns with the moment of {carried(machine)}."


LARGEST = 5e-3
"""rad: 1000 arcsec, a light mount of an amateur; observatories have a hundredth of it."""
FORK, SHAFT = "fork", "shaft"
LEVEL = 1e-3
"""Sine of the angle between an axis and the vertical below which nothing it carries bends to and fro."""


@effects.add("axis-flexure")
class AxisFlexure(Effect):
    """Forks and cantilevered axes of telescopes that bend under their own weight: gravity's direction is all that
    counts.

    What a leaning axis turns bends under its own weight: by c where it lies level, in proportion to the pull across it.

    Settings: ``shaft``, the next axis droops like a cantilever that the first one carries; ``fork``, the
    tines nod about the next axis. Weights need not be known: gravity's direction in the turning body is all that the form asks.
    """

    slug = "axis-flexure"
    setting_ranges = ranges({"fork": SWITCH, "shaft": SWITCH})
    title = "Fork or axis that bends under its own weight"
    counted = True
    sentence = "What {0} turns, a fork or the other axis, bends under its own weight as it turns."
    forms = ({SHAFT: 1.0}, {FORK: 1.0})
    formula = (
        "turn of what joint J carries; shaft: c n x g, fork: c n (n . (g x a)); a the axis of J, n that of the next joint, "
        "g the direction of gravity, unit vectors"
    )
    size = "1 to 30 arcsec at observatories, some arcmin of light German mounts and forks"
    look_alikes = ("gravity-sag", "wrong-constant", "encoder-eccentricity")
    experiment = "point at stars east and west of the meridian, from both sides of the pier"
    source = "terms FO and DAF of pointing models (P. T. Wallace, TPOINT)"
    needs_load = True
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        """The first of two axes that point something, where it leans."""
        if not points_only(machine):
            return []
        return singly(joint.name for joint, _ in _pairs(machine) if _leans(machine, joint))

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("c", "rad", LARGEST),)

    def shifts(self, site: Site) -> Shifts:
        joint, following = _pair(site.machine, site.place[0])
        pull = down(site, joint.name)
        axis, carried = ca.DM(_axis(joint)), ca.DM(_carried(site.machine, following))
        if site.settings.get(FORK):
            turn = carried * ca.dot(carried, ca.cross(pull, axis))
        else:
            turn = ca.cross(carried, pull)
        return {f"{joint.name}.motion.r{axis}": site.c["c"] * turn[k] for k, axis in enumerate("xyz")}


def _pairs(machine: Machine) -> list[tuple[Joint, Joint]]:
    """Revolute joints that actuators drive, each with the one that its child carries."""
    driven = {actuator.drives for actuator in machine.mechanism.actuators}
    turning = [j for j in machine.mechanism.tree if j.kind == "revolute" and j.name in driven]
    return [(a, b) for a in turning for b in turning if b.parent == a.child and a.parent == BASE]


def _pair(machine: Machine, name: str) -> tuple[Joint, Joint]:
    found = next((pair for pair in _pairs(machine) if pair[0].name == name), None)
    if found is None:
        raise InputError(
            f"{AxisFlexure.slug}: found {name!r} on {machine.name}, expected the first of two turning axes"
        )
    return found


def _axis(joint: Joint) -> Array:
    assert not isinstance(joint.axis, Direction)
    return np.array(joint.axis, dtype=float)


def _carried(machine: Machine, joint: Joint) -> Array:
    """(3,) axis of a joint in the frame of the body that carries it, as drawn."""
    nominal = {name: ca.SX(value) for name, value in machine.nominal_values.items()}
    frame = ca.DM(ca.evalf(placed_frame(joint, {joint.parent: ca.SX.eye(4)}, nominal))).full()
    return np.asarray(frame[:3, :3] @ _axis(joint))


def _leans(machine: Machine, joint: Joint) -> bool:
    """Whether an axis that the base carries stands aslant."""
    down = np.array(machine.gravity) / np.linalg.norm(machine.gravity or (1.0,))
    return bool(np.linalg.norm(np.cross(_carried(machine, joint), down)) > LEVEL)
