"""A base or a tool that creeps away in the course of the campaign."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import SECONDS_PER_HOUR, clock, singly, twist_coefficients
from truepose.models.machine import Machine
from truepose.models.mechanism import AXES

FRACTIONS = (0.08, 0.15, 0.3, 0.6, 1.2)
"""Time constants to try, in spans of the campaign: neighbours differ by a factor of two, which data hardly tell apart."""


@effects.add("mount-drift")
class MountDrift(Effect):
    """A small motion of the mount that grows with time since ``start`` (s on the recording's clock).

    ``tau`` 0: at a constant rate, per hour. ``tau`` > 0 (s): settling, 1 - exp(-t / tau) of its end.
    """

    slug = "mount-drift"
    title = "Drifting mount"
    counted = True
    formula = "twist (t - start) / 1 h, or twist (1 - exp(-(t - start) / tau))"
    size = "0.1 to 10 um/h in a quiet laboratory; more while a machine warms up"
    look_alikes = ("thermal-expansion", "frame-shift", "zero-shift", "piezo-creep")
    experiment = "repeat one reference pose throughout the campaign, in a shuffled order of the others"
    source = "repeated reference poses, the usual drift check of laser tracker and photogrammetry campaigns"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.standing)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return twist_coefficients(mm=1.0, rad=5e-3, per="" if settings.get("tau", 0.0) else "/h")

    def shifts(self, site: Site) -> Shifts:
        elapsed = site.driver("time") - site.settings.get("start", 0.0)
        tau = site.settings.get("tau", 0.0)
        growth = 1 - ca.exp(-elapsed / tau) if tau else elapsed / SECONDS_PER_HOUR
        return {f"{site.place[0]}.motion.{axis}": site.c[axis] * growth for axis in AXES}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return ("time",)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """A constant rate, and time constants inside the campaign, from its start."""
        span = clock(recording)
        if span is None or span[1] <= span[0]:
            return ({"tau": 0.0, "start": 0.0},)
        start, length = span[0], span[1] - span[0]
        taus = [0.0, *(float(f"{fraction * length:.2g}") for fraction in FRACTIONS)]
        return [{"tau": tau, "start": start} for tau in taus]

    def explain(self, machine: Machine, place: Place) -> str:
        said = {"base": "The base creeps under the robot", "tool": "The tool creeps in its mount"}
        what = said.get(place[0], f"The frame {place[0]} creeps on what carries it")
        return f"{what} in the course of the campaign."
