"""Piezoelectric actuators without a position loop go on moving after a step, ever more slowly."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, nominal_gain, piezo_like, singly
from truepose.models.machine import Machine


@effects.add("piezo-creep")
class PiezoCreep(Effect):
    """Every past move goes on by g times itself for each decade of time since ``t0`` after it.

    A move counts as ended at the time of the row it leads to. Looked for where ``piezo-hysteresis`` is.
    """

    slug = "piezo-creep"
    title = "Creep of a piezo actuator"
    formula = "dq = g sum over past moves of step log10(1 + age / t0), t0 = 0.1 s"
    size = "g = 0.01 to 0.02: 1 to 2 % of a move for each decade of time"
    look_alikes = ("piezo-hysteresis", "friction-hysteresis", "mount-drift", "actuator-scale")
    experiment = "one large step, then read the same pose after 1, 10, 100 and 1000 s"
    source = (
        "Physik Instrumente's piezo tutorial: dL(t) = dL (1 + g lg(t / 0.1 s)), of the order of 1 % to 2 %"
    )

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.mechanism.readings)

    def screened(self, machine: Machine, place: Place) -> bool:
        return piezo_like(actuator_at(machine, place[0]))

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("g", "1", 0.05, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        (driver,) = self.drivers(site.machine, site.place, site.settings)
        past = nominal_gain(site.machine, actuator) * site.driver(driver)
        return {actuator.displacement: site.c["g"] * past}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (f"creep.{actuator_at(machine, place[0]).reading}~{settings.get('t0', 0.1):g}",)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return ({"t0": 0.1},)

    def explain(self, machine: Machine, place: Place) -> str:
        return f"The piezo of {place[0]} creeps: after every move it goes on with the logarithm of time."
