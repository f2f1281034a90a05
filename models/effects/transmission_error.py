"""Gears that do not turn evenly: a joint error that repeats a whole number of times per turn."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, sine_coefficients, sine_pair, singly
from truepose.models.machine import Machine

HIGHEST_ORDER = 30


@effects.add("transmission-error")
class TransmissionError(Effect):
    """a sin(k q) + b cos(k q), k the order: cycles per turn of the joint."""

    slug = "transmission-error"
    title = "Transmission error of a geared joint"
    formula = "dq = a sin(k q) + b cos(k q), k cycles per turn of the joint"
    size = "strain wave gears 0.5 to 2 arcmin (1.5e-4 to 6e-4 rad)"
    look_alikes = ("encoder-eccentricity", "axis-wobble", "actuator-scale")
    experiment = (
        "sweep this joint alone in fine, unevenly spaced steps over a few periods; repeat with the gear "
        "coupled at another tooth: gear errors stay with the gear, encoder errors with the encoder"
    )
    source = (
        "Judd and Knasinski 1990, A technique to calibrate industrial robots with experimental verification"
    )

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(a.reading for a in machine.mechanism.actuators if a.unit == "rad")

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return sine_coefficients("rad", 3e-3)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        phase = site.settings.get("order", 1.0) * site.moved(actuator.reading)
        return {actuator.displacement: sine_pair(site, phase)}

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Orders that make at least a quarter of a period within the joint's range."""
        actuator = actuator_at(machine, place[0])
        orders = [float(k) for k in range(1, HIGHEST_ORDER + 1)]
        if actuator.gear_ratio:
            orders += [k for k in (abs(actuator.gear_ratio), 2 * abs(actuator.gear_ratio)) if k not in orders]
        span = actuator.range[1] - actuator.range[0] if actuator.range else 2 * pi
        return [{"order": k} for k in orders if k * span >= pi / 2]

    def explain(self, machine: Machine, place: Place) -> str:
        return f"The gear of joint {place[0]} turns unevenly: its error repeats several times per turn."
