"""Lead screws: nuts that do not advance evenly, screws that give way."""

from __future__ import annotations

from collections.abc import Sequence
from math import tau

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, nominal_gain, sine_coefficients, sine_pair, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ORDER, SWITCH, ranges


@effects.add("screw-periodic")
class ScrewPeriodic(Effect):
    """A lead screw whose nut does not advance evenly within a turn.

    A sine of the travel, once (``harmonic`` 1) or twice (2) per screw pitch.
    """

    slug = "screw-periodic"
    setting_ranges = ranges({"harmonic": ORDER})
    driven_by = "position-periodic"
    title = "Periodic error of a lead screw"
    counted = True
    sentence = "The screw of {0} advances unevenly within a turn: its error repeats with the pitch."
    forms = ({"harmonic": 1.0}, {"harmonic": 2.0})
    formula = "drho = a sin(2 pi h rho / p) + b cos(2 pi h rho / p), p the pitch, h = 1 or 2"
    size = "1 to 5 um"
    look_alikes = ("axis-straightness", "transmission-error", "sensor-periodic")
    experiment = "sweep this actuator in steps well below its pitch over two or three pitches"
    source = "periodic positioning error of ISO 230-2"
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


@effects.add("screw-windup")
class ScrewWindup(Effect):
    """A screw that is stretched and wound up by what it carries or by its nut's friction, more the further out its nut
    stands.

    dq = c F s, s the distance of the nut from the lower end of its range, where the fixed bearing is taken to be.

    Setting ``friction`` 1: dq = -(w / 2) approach s / range. The friction of the nut winds the free part of the screw
    up against the way it went: lost motion w with the nut at the far end, none at the bearing.
    What does not grow with the distance (bearing, nut) is ``joint-compliance`` or ``leg-compliance``. Looked for
    where a screw pitch is stated.
    """

    slug = "screw-windup"
    setting_ranges = ranges({"friction": SWITCH})
    title = "Screw that gives way"
    counted = True
    sentence = (
        "The screw of {0} gives way to what it carries or to its nut's friction, more the further out the nut "
        "stands."
    )
    forms = ({}, {"friction": 1.0})
    formula = (
        "dq = c F s, F the force that gravity exerts along the screw, s the nut's distance from the low end; "
        "by its nut's friction dq = -(w / 2) approach s / range"
    )
    size = "c = 1 / EA: 2.4e-8 1/N for a steel screw of 16 mm core, more with torsion; 1 to 20 um in all"
    look_alikes = ("backlash", "joint-compliance", "leg-compliance", "actuator-scale", "screw-periodic")
    experiment = "step the payload with the nut at both ends of its stroke; fix the other bearing and repeat"
    source = (
        "stiffness AE / L of a screw shaft fixed at one end, as in the makers' selection guides (THK); wind-up T L / GJ "
        "of a shaft, T the torque of friction"
    )
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
