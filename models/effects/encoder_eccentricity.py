"""An encoder disc that sits off its axis."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, sine_coefficients, sine_pair, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ORDER, ranges


@effects.add("encoder-eccentricity")
class EncoderEccentricity(Effect):
    """Once per turn with one read head, twice per turn with an oval disc or two opposite heads.

    The disc is that of the joint's reading, or that of an encoder on its load side: the place is then its column,
    ``angle.q1``, and the error is that of the column.
    """

    slug = "encoder-eccentricity"
    setting_ranges = ranges({"order": ORDER})
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
        turning = [a.reading for a in machine.mechanism.actuators if a.unit == "rad"]
        return singly([*turning, *(c for c, joint in _on_load_side(machine).items() if joint in turning)])

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return sine_coefficients("rad", 3e-3)

    def shifts(self, site: Site) -> Shifts:
        (place,) = site.place
        joint = _on_load_side(site.machine).get(place)
        actuator = actuator_at(site.machine, joint or place)
        angle = site.moved(joint) if joint else site.read(actuator.reading)
        phase = site.settings.get("order", 1.0) * angle
        return {f"{place}.reading" if joint else actuator.displacement: sine_pair(site, phase)}

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return ({"order": 1.0}, {"order": 2.0})

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        whose = (
            f"on the load side, {place[0]}," if place[0] in _on_load_side(machine) else f"of joint {place[0]}"
        )
        return f"The encoder disc {whose} is off its axis: it errs by a sine of the angle."


def _on_load_side(machine: Machine) -> dict[str, str]:
    """The joint of each column that an encoder on a load side has."""
    return {column: joint for sensor in machine.sensors for column, joint in sensor.joints.items()}
