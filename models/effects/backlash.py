"""Play: a joint that stands elsewhere when it is approached from the other side."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, joint_unit, singly
from truepose.models.machine import Machine

LARGEST = {"mm": 0.1, "rad": 3e-3}


@effects.add("backlash")
class Backlash(Effect):
    """The joint stands at reading - (b/2) * approach, b >= 0 its whole play."""

    slug = "backlash"
    title = "Backlash"
    formula = "dq = -(b / 2) approach, approach +1 when it arrived moving towards larger readings"
    size = "0.5 to 2 arcmin (1.5e-4 to 6e-4 rad); 1 to 20 um"
    look_alikes = ("friction-hysteresis", "piezo-hysteresis", "joint-compliance")
    experiment = "approach the same poses from both sides"
    source = "reversal error of ISO 230-2"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.mechanism.readings)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        unit = joint_unit(machine, place)
        return (Coefficient("b", unit, LARGEST[unit], lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        (approach,) = self.drivers(site.machine, site.place, site.settings)
        port = actuator_at(site.machine, site.place[0]).displacement
        return {port: -site.c["b"] / 2 * site.driver(approach)}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (f"approach.{actuator_at(machine, place[0]).reading}",)

    def explain(self, machine: Machine, place: Place) -> str:
        return f"Joint {place[0]} has play: where it stands depends on the side from which it arrived."
