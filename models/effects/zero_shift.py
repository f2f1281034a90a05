"""A joint whose zero is another one after a break between sessions."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, after_session, boundaries, joint_unit, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ANY, ranges

LARGEST = {"mm": 2.0, "rad": 0.05}


@effects.add("zero-shift")
class ZeroShift(Effect):
    """A constant added to one joint's displacement, or to two, after session ``session``."""

    slug = "zero-shift"
    setting_ranges = ranges({"session": ANY})
    title = "Zero of a joint moved between sessions"
    counted = True
    formula = "dq = zero after session k, nothing before"
    size = "anything: the repeatability of the home switch, or a tooth of a slipped coupling"
    look_alikes = ("frame-shift", "mount-drift", "backlash", "thermal-expansion")
    experiment = "home the joint again and repeat one reference pose"
    source = "re-homing and slipped couplings; no physics"
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        readings = machine.mechanism.readings
        return [*singly(readings), *combinations(readings, 2)]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        names = ["zero"] if len(place) == 1 else [f"zero.{joint}" for joint in place]
        units = [joint_unit(machine, (joint,)) for joint in place]
        return tuple(Coefficient(name, unit, LARGEST[unit]) for name, unit in zip(names, units, strict=True))

    def shifts(self, site: Site) -> Shifts:
        after = site.driver(after_session(site.settings))
        ports = [actuator_at(site.machine, joint).displacement for joint in site.place]
        return {port: c * after for port, c in zip(ports, site.c.values(), strict=True)}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (after_session(settings),)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return boundaries(recording)

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        zero = "The zero" if len(place) == 1 else "The zeros"
        return (
            f"{zero} of {' and '.join(place)} moved between two sessions: homed anew, or a slipped coupling."
        )
