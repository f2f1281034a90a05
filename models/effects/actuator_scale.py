"""A scale factor that is off: every reading means a little more or less than it says."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, joint_unit, singly, singly_and_together
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS


@effects.add("actuator-scale")
class ActuatorScale(Effect):
    """The reading q becomes (1 + s) q before the offset is added; one joint, or all of a kind alike."""

    slug = "actuator-scale"
    setting_ranges = NO_SETTINGS
    title = "Scale error of an actuator or its encoder"
    counted = True
    formula = "q -> (1 + s) q, before the offset is added"
    size = "10 to 100 ppm for a good scale or screw; a wrong gain reaches percents"
    look_alikes = ("wrong-constant", "platform-deformation", "axis-coupling", "thermal-expansion")
    experiment = "step this joint alone through its travel against an interferometer or a length gauge"
    source = "positioning tests of linear and rotary axes, ISO 230-2"

    def places(self, machine: Machine) -> Sequence[Place]:
        places = singly(machine.mechanism.readings)
        for unit in ("mm", "rad"):
            alike = [a.reading for a in machine.mechanism.actuators if a.unit == unit]
            places += singly_and_together(alike)[len(alike) :]
        return places

    def screened(self, machine: Machine, place: Place) -> bool:
        # where the drawing leaves the gain open it is a constant of the machine: see wrong-constant
        open_gain = {p.name for p in machine.mechanism.parameters if p.part == "gain" and p.free}
        return not any(actuator_at(machine, name).gain in open_gain for name in place)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("s", "1", scale=0.1, lower=-0.1, upper=0.1),)

    def shifts(self, site: Site) -> Shifts:
        actuators = [actuator_at(site.machine, name) for name in site.place]
        return {a.displacement: site.c["s"] * site.moved(a.reading) for a in actuators}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if len(place) > 1:
            return f"The readings of {', '.join(place)} share one scale error: all err in proportion."
        what = "turns" if joint_unit(machine, place) == "rad" else "travels"
        return f"Joint {place[0]} {what} in proportion more (s > 0) or less (s < 0) than its reading says."
