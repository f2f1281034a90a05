"""A joint whose zero is another one after a break between sessions."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, after_session, boundaries, joint_unit, singly
from truepose.models.machine import Machine

LARGEST = {"mm": 2.0, "rad": 0.05}


@effects.add("zero-shift")
class ZeroShift(Effect):
    """A constant added to one joint's displacement after session ``session``."""

    slug = "zero-shift"
    title = "Zero of a joint moved between sessions"
    formula = "dq = zero after session k, nothing before"
    size = "anything: the repeatability of the home switch, or a tooth of a slipped coupling"
    look_alikes = ("frame-shift", "mount-drift", "backlash", "thermal-expansion")
    experiment = "home the joint again and repeat one reference pose"
    source = "re-homing and slipped couplings; no physics"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.mechanism.readings)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        unit = joint_unit(machine, place)
        return (Coefficient("zero", unit, LARGEST[unit]),)

    def shifts(self, site: Site) -> Shifts:
        port = actuator_at(site.machine, site.place[0]).displacement
        return {port: site.c["zero"] * site.driver(after_session(site.settings))}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (after_session(settings),)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return boundaries(recording)

    def explain(self, machine: Machine, place: Place) -> str:
        return f"The zero of {place[0]} moved between two sessions: homed anew, or a slipped coupling."
