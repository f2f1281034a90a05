"""An encoder disc that sits off its axis."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, sine_coefficients, sine_pair, singly
from truepose.models.machine import Machine


@effects.add("encoder-eccentricity")
class EncoderEccentricity(Effect):
    """Once per turn with one read head, twice per turn with an oval disc or two opposite heads."""

    slug = "encoder-eccentricity"
    driven_by = "position-periodic"
    title = "Eccentric encoder disc"
    counted = True
    formula = "dq = a sin(k q) + b cos(k q), k = 1 (disc off its axis) or 2 (oval disc, two read heads)"
    size = "amplitude e / R: 10 um at R = 50 mm gives 2e-4 rad (41 arcsec)"
    look_alikes = ("transmission-error", "axis-wobble", "actuator-scale")
    experiment = "read a second head opposite the first, or turn the disc by half a turn and repeat"
    source = "geometry of a disc of radius R mounted off its axis by e"
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(a.reading for a in machine.mechanism.actuators if a.unit == "rad")

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return sine_coefficients("rad", 3e-3)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        phase = site.settings.get("order", 1.0) * site.moved(actuator.reading)
        return {actuator.displacement: sine_pair(site, phase)}

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return ({"order": 1.0}, {"order": 2.0})

    def explain(self, machine: Machine, place: Place) -> str:
        return f"The encoder disc of joint {place[0]} is off its axis: it errs by a sine of the angle."
