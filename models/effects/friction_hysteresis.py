"""Friction that lets a joint give before it slips: it trails its reading, and the trail depends on the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, joint_unit, nominal_gain, singly
from truepose.models.machine import Machine
from truepose.models.mechanism import Actuator

LARGEST = {"mm": 0.1, "rad": 3e-3}
WIDTHS = (0.003, 0.01, 0.03, 0.1)
SHOWN = 0.05
"""Share of rows that must stand between the two limits; where all stand at one, backlash is the same function."""


@effects.add("friction-hysteresis")
class FrictionHysteresis(Effect):
    """The joint trails the way it went by up to h; it goes from one limit to the other within twice the half width r.

    Setting ``width`` is r as a part of the joint's range. Rows that arrive from further away than 2 r stand at a
    limit, as with backlash b = 2 h: widths that no reversal of the recording falls short of are not looked for.
    """

    slug = "friction-hysteresis"
    title = "Hysteresis of friction before slip"
    formula = (
        "dq = -h s / r, s the stop operator of half width r on the way of the reading: s follows every move and "
        "stays between -r and r; 0 <= h <= r"
    )
    size = "micrometres, microradians (recalled)"
    look_alikes = ("backlash", "piezo-hysteresis", "piezo-creep", "joint-compliance")
    experiment = (
        "move this joint to and fro in steps, with strokes that shrink from ten widths to a tenth: backlash keeps "
        "its whole width until the stroke is smaller, friction gives way by degrees"
    )
    source = "rate-independent hysteresis of pre-sliding friction (Ruderman, arXiv 2212.05799); stop operator of Prandtl"

    unvaried = "no reversal short enough to tell it from backlash"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(a.reading for a in machine.mechanism.actuators if a.range)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        unit, actuator = joint_unit(machine, place), actuator_at(machine, place[0])
        widest = _half_width(actuator, settings) * nominal_gain(machine, actuator)
        return (Coefficient("h", unit, min(LARGEST[unit], widest), lower=0.0, upper=widest),)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        (driver,) = self.drivers(site.machine, site.place, site.settings)
        lead = site.driver(driver) / _half_width(actuator, site.settings)
        return {actuator.displacement: -site.c["h"] * lead}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        actuator = actuator_at(machine, place[0])
        return (f"stop.{actuator.reading}~{_half_width(actuator, settings):.6g}",)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Widths within which some reversals of the recording end."""
        variants = [{"width": width} for width in WIDTHS]
        return [s for s in variants if self._shows(machine, place, s, recording)]

    def explain(self, machine: Machine, place: Place) -> str:
        return f"Joint {place[0]} gives before it slips: it trails its reading, by more the further it came."

    def _shows(self, machine: Machine, place: Place, settings: Settings, recording: Observed) -> bool:
        (driver,) = self.drivers(machine, place, settings)
        lead = recording.driver(driver)
        if lead is None:
            return True
        limit = 0.999 * _half_width(actuator_at(machine, place[0]), settings)
        return bool(np.mean(np.abs(np.asarray(lead, dtype=float)) < limit) >= SHOWN)


def _half_width(actuator: Actuator, settings: Settings) -> float:
    """Half width of the hysteresis in the reading's unit."""
    low, high = actuator.range or (0.0, 1.0)
    return settings.get("width", WIDTHS[-1]) * (high - low)
