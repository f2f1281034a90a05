"""A screw that is stretched and wound up by the force it carries, more the further out its nut stands."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, nominal_gain, singly
from truepose.models.machine import Machine


@effects.add("screw-windup")
class ScrewWindup(Effect):
    """dq = c F s, s the distance of the nut from the lower end of its range, where the fixed bearing is taken to be.

    What does not grow with the distance (bearing, nut) is ``joint-compliance`` or ``leg-compliance``. Looked for
    where a screw pitch is stated.
    """

    slug = "screw-windup"
    title = "Screw that gives way"
    formula = (
        "dq = c F s, F the force that gravity exerts along the screw, s the nut's distance from the low end"
    )
    size = "c = 1 / EA: 2.4e-8 1/N for a steel screw of 16 mm core, more with torsion"
    look_alikes = ("joint-compliance", "leg-compliance", "actuator-scale", "screw-periodic")
    experiment = "step the payload with the nut at both ends of its stroke; fix the other bearing and repeat"
    source = "stiffness AE / L of a screw shaft fixed at one end, as in the makers' selection guides (THK)"
    needs_load = True

    def places(self, machine: Machine) -> Sequence[Place]:
        if not machine.loaded:
            return []
        return singly(a.reading for a in machine.mechanism.actuators if a.unit == "mm" and a.range)

    def screened(self, machine: Machine, place: Place) -> bool:
        return bool(actuator_at(machine, place[0]).screw_pitch)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("c", "1/N", scale=1e-5, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        low = actuator.range[0] if actuator.range else 0.0
        free = nominal_gain(site.machine, actuator) * (site.q[actuator.reading] - low)
        return {actuator.displacement: site.c["c"] * site.load(actuator.displacement) * free}

    def explain(self, machine: Machine, place: Place) -> str:
        return (
            f"The screw of {place[0]} gives way to the force it carries, more the further out its nut stands."
        )
