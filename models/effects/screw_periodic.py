"""A lead screw whose nut does not advance evenly within a turn."""

from __future__ import annotations

from collections.abc import Sequence
from math import tau

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, sine_coefficients, sine_pair, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ORDER, ranges


@effects.add("screw-periodic")
class ScrewPeriodic(Effect):
    """A sine of the travel, once (``harmonic`` 1) or twice (2) per screw pitch."""

    slug = "screw-periodic"
    setting_ranges = ranges({"harmonic": ORDER})
    driven_by = "position-periodic"
    title = "Periodic error of a lead screw"
    counted = True
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

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return ({"harmonic": 1.0}, {"harmonic": 2.0})

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return f"The screw of {place[0]} advances unevenly within a turn: its error repeats with the pitch."
