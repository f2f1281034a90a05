"""Lead screws: nuts that do not advance evenly, screws that give way."""

from __future__ import annotations

from collections.abc import Sequence
from math import tau

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, bundle
from truepose.models.effects.common import actuator_at, nominal_gain, sine_coefficients, sine_pair, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ORDER, SWITCH, ranges


@bundle("screw-periodic")
class ScrewPeriodic(Effect):
    """A lead screw whose nut does not advance evenly within a turn.

    A sine of the travel, once (``harmonic`` 1) or twice (2) per screw pitch.
    """

    setting_ranges = ranges({"harmonic": ORDER})
    driven_by = "position-periodic"
    forms = ({"harmonic": 1.0}, {"harmonic": 2.0})
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(a.reading for a in machine.mechanism.actuators if a.unit == "mm" and a.screw_pitch)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return sine_coefficients("mm", 0.05)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        turns = site.moved(actuator.reading) / (actuator.screw_pitch or 1.0)
        return {actuator.displacement: sine_pair(site, tau * site.settings.get("harmonic", 1.0) * turns)}


LARGEST_MM = 0.02


@bundle("screw-windup")
class ScrewWindup(Effect):
    """A screw that is stretched and wound up by what it carries or by its nut's friction, more the further out its nut
    stands.

    dq = c F s, s the distance of the nut from the lower end of its range, where the fixed bearing is taken to be.

    Setting ``friction`` 1: dq = -(w / 2) approach s / range. The friction of the nut winds the free part of the screw
    up against the way it went: lost motion w with the nut at the far end, none at the bearing.
    What does not grow with the distance (bearing, nut) is ``joint-compliance`` or ``leg-compliance``. Looked for
    where a screw pitch is stated.
    """

    setting_ranges = ranges({"friction": SWITCH})
    forms = ({}, {"friction": 1.0})
    needs_load = True
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        if not machine.loaded:
            return []
        return singly(a.reading for a in machine.mechanism.actuators if a.unit == "mm" and a.range)

    def screened(self, machine: Machine, place: Place) -> bool:
        return bool(actuator_at(machine, place[0]).screw_pitch)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if settings.get("friction"):
            return (Coefficient("w", "mm", scale=LARGEST_MM, lower=0.0),)
        return (Coefficient("c", "1/N", scale=1e-5, lower=0.0),)

    def reads_load(self, settings: Settings) -> bool:
        return not settings.get("friction")

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (f"approach.{actuator_at(machine, place[0]).reading}",) if settings.get("friction") else ()

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        low, high = actuator.range or (0.0, 1.0)
        if site.settings.get("friction"):
            (approach,) = self.drivers(site.machine, site.place, site.settings)
            share = (site.q[actuator.reading] - low) / (high - low)
            return {actuator.displacement: -site.c["w"] / 2 * site.driver(approach) * share}
        free = nominal_gain(site.machine, actuator) * (site.q[actuator.reading] - low)
        return {actuator.displacement: site.c["c"] * site.load(actuator.displacement) * free}
