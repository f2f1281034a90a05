"""A base or a tool that stands elsewhere after a break between sessions."""

from __future__ import annotations

import math
from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import after_session, boundaries, singly, twist_coefficients
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES, Parameter
from truepose.models.machine.placed import ANY, SWITCH, ranges

ANEW = "anew"
"""Setting of a mount that the machine file says is set up anew for each session."""
STATED = 100.0
"""Prior 1-sigma of what a machine file states, in scales (``PlacedEffect.spread``)."""


@effects.add("frame-shift")
class FrameShift(Effect):
    """A rigid motion of the mount at the boundary after session ``session``, kept from then on.

    Setting ``anew`` 1: the machine file says that the mount is set up anew (``per: session``). Then the six parameters of
    the frame change, by as much as two set-ups within its tolerance differ.
    """

    slug = "frame-shift"
    setting_ranges = ranges({"session": ANY, "anew": SWITCH})
    title = "Mount moved between sessions"
    counted = True
    formula = "twist after session k, nothing before"
    size = "anything: a bumped tripod, a tool taken off and put back"
    look_alikes = ("mount-drift", "zero-shift", "thermal-expansion")
    experiment = "measure fiducials on the base and on the tool's flange when every session starts and ends"
    source = "re-mounting of tools, instruments and bases; no physics"
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.standing)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if ANEW not in settings:
            return twist_coefficients(mm=10.0, rad=0.05)
        own = [(axis, machine.geometry[f"{place[0]}.{axis}"]) for axis in AXES]
        return tuple(Coefficient(axis, p.unit, _scale(p)) for axis, p in own if p.free)

    def shifts(self, site: Site) -> Shifts:
        after = site.driver(after_session(site.settings))
        if ANEW in site.settings:
            return {f"{site.place[0]}.{axis}": c * after for axis, c in site.c.items()}
        return {f"{site.place[0]}.motion.{axis}": site.c[axis] * after for axis in AXES}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (after_session(settings),)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        anew = {ANEW: 1.0} if place[0] in machine.set_up else {}
        return [{**boundary, **anew} for boundary in boundaries(recording)]

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        said = {"base": "The robot's base, or the instrument that looks at it,", "tool": "The tool"}
        what = said.get(place[0], f"The frame {place[0]}")
        return f"{what} was moved between two sessions."


def _scale(parameter: Parameter) -> float:
    """Of the difference between two set-ups, so that its prior is that of two draws within the tolerance."""
    if not math.isfinite(parameter.tolerance):
        return parameter.scale
    return math.sqrt(2.0) * parameter.tolerance / STATED
