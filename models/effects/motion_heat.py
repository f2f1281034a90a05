"""What warms by a machine's own motion: brakes and motors, screws and their nuts."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, clock, nominal_gain, singly
from truepose.models.file.driver import HEAT, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import POSITIVE, ranges

LAGS = (300.0, 900.0, 2700.0)
"""s after which a third of the heat is left; what is found is refined between them."""
ZERO, STRAIN = 1e-5, 1e-6
"""Largest share of the way, whose heat is still there, by which a zero is off; the same of a screw's length, per mm. The rows
show a part of the way alone: what a machine does between them warms it, too."""


class _OfMotion(Effect):
    """What follows the way that a joint went, most of all that of late: ``lag`` (s) is the time constant of its cooling."""

    setting_ranges = ranges({"lag": POSITIVE})
    continuous = ("lag",)
    unvaried = "no time column, or the joint hardly moved"
    experiment = "let the machine run its joint to and fro for a quarter of an hour, then watch one pose while it cools"

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        span = clock(recording)
        return [{"lag": lag} for lag in LAGS if span is not None and lag < 2.0 * (span[1] - span[0])]

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (Driver(HEAT, actuator_at(machine, place[0]).reading, (settings.get("lag", LAGS[1]),)).name,)

    def heat(self, site: Site) -> ca.SX:
        """What is left of the way, mm or rad."""
        (name,) = self.drivers(site.machine, site.place, site.settings)
        return nominal_gain(site.machine, actuator_at(site.machine, site.place[0])) * site.driver(name)


@effects.add("motor-heat")
class MotorHeat(_OfMotion):
    """A motor or brake that warms as it works and shifts the zero of its joint.

    The heat of every move decays with the time constant ``lag``; the joint's zero follows what is left of it.
    """

    slug = "motor-heat"
    title = "Zero that moves with its motor's heat"
    sentence = "The zero of {0} moves as its motor or brake warms with the joint's own motion."
    formula = "dq = c h, h the sum over past moves of |step| exp(-age / lag)"
    size = "microradians to tens of them for hours of fast motion (recalled)"
    look_alikes = ("mount-drift", "thermal-expansion", "zero-shift")
    source = "lumped heat capacity that friction and copper losses warm: ISO 230-3, tests of heating by moving axes"
    commonness = 0.5

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.mechanism.readings)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("c", "1", ZERO),)

    def shifts(self, site: Site) -> Shifts:
        return {site.port(actuator_at(site.machine, site.place[0]).reading): site.c["c"] * self.heat(site)}


@effects.add("screw-growth")
class ScrewGrowth(_OfMotion):
    """A ball screw that warms by its nut's friction and grows as it travels.

    Every length of the screw grows by c times the heat h that its motion left; the error grows from its fixed end on.
    """

    slug = "screw-growth"
    title = "Screw that grows with travel"
    sentence = "The screw of {0} warms by its own travel and grows: the farther from its fixed end, the larger the error."
    formula = (
        "dq = c h s, h the sum over past moves of |step| exp(-age / lag), s the distance from the low end"
    )
    size = "10 to 100 um on a metre after an hour of fast feed"
    look_alikes = ("thermal-expansion", "actuator-scale", "mount-drift")
    source = "ball-screw heating of ISO 230-3; friction of the nut as the source of heat"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(a.reading for a in machine.mechanism.actuators if a.unit == "mm" and a.range)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("c", "1/mm", STRAIN, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        low = (actuator.range or (0.0, 1.0))[0]
        free = nominal_gain(site.machine, actuator) * (site.q[actuator.reading] - low)
        return {actuator.displacement: site.c["c"] * self.heat(site) * free}
