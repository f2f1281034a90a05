"""Play: a joint that stands elsewhere when it is approached from the other side."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, down, drives_joint, joint_unit, points_only, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Direction
from truepose.models.machine.placed import ANY, ranges
from truepose.models.machine.states import across

LARGEST = {"mm": 0.1, "rad": 3e-3}
LEAN, LEANS = "lean", 36
"""Setting: where the centre of what the joint carries lies about its axis, rad; and how many are tried, evenly over a turn."""
EVEN = 0.05
"""rad from the balance, within which friction may hold the joint anywhere in its play."""


@effects.add("backlash")
class Backlash(Effect):
    """The joint stands at reading - (b/2) * approach, b >= 0 its whole play.

    Setting ``lean``: the weight that it carries decides on which side of the play it rests, not the way that it came (a
    telescope's axis that is not quite in balance); the load's centre lies at that angle about the joint's axis.
    """

    slug = "backlash"
    setting_ranges = ranges({"lean": ANY})
    title = "Backlash"
    formula = (
        "dq = -(b / 2) approach, approach +1 when it arrived moving towards larger readings; with lean: dq = (b / 2) sign "
        "of the torque that gravity exerts"
    )
    size = "0.5 to 2 arcmin (1.5e-4 to 6e-4 rad); 1 to 20 um"
    look_alikes = ("friction-hysteresis", "piezo-hysteresis", "joint-compliance")
    experiment = "approach the same poses from both sides"
    source = "reversal error of ISO 230-2"
    settings_add = False
    continuous = (LEAN,)

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.mechanism.readings)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        unit = joint_unit(machine, place)
        return (Coefficient("b", unit, LARGEST[unit], lower=0.0),)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """The way that it came; on machines that point, also every side that its weight may lie on."""
        actuator = actuator_at(machine, place[0])
        if actuator.unit != "rad" or not points_only(machine) or not drives_joint(machine, actuator):
            return ({},)
        return ({}, *({LEAN: 2 * pi * k / LEANS} for k in range(LEANS)))

    def weight(self, settings: Settings) -> float:
        return 1.0 / LEANS if LEAN in settings else 1.0

    def reads_load(self, settings: Settings) -> bool:
        return LEAN in settings

    def shifts(self, site: Site) -> Shifts:
        port = actuator_at(site.machine, site.place[0]).displacement
        if LEAN in site.settings:
            return {port: site.c["b"] / 2 * _side(site)}
        (approach,) = self.drivers(site.machine, site.place, site.settings)
        return {port: -site.c["b"] / 2 * site.driver(approach)}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return () if LEAN in settings else (f"approach.{actuator_at(machine, place[0]).reading}",)

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return (
            f"Joint {place[0]} has play: where it stands depends on the side from which it arrived, or to which its weight "
            "pushes it."
        )


def _side(site: Site) -> ca.SX:
    """Sign of gravity's torque about the joint's axis; it changes over where the load is in balance."""
    name = actuator_at(site.machine, site.place[0]).drives
    axis = next(joint.axis for joint in site.machine.mechanism.joints if joint.name == name)
    assert not isinstance(axis, Direction)
    u, v = across(axis)
    centre = ca.DM(ca.cos(site.settings[LEAN]) * u + ca.sin(site.settings[LEAN]) * v)
    torque = ca.dot(ca.DM(axis), ca.cross(centre, down(site, name)))
    return torque / ca.sqrt(torque**2 + EVEN**2)
