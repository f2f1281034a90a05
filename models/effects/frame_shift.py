"""A base or a tool that stands elsewhere after a break between sessions."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import after_session, boundaries, singly, twist_coefficients
from truepose.models.machine import Machine
from truepose.models.mechanism import AXES


@effects.add("frame-shift")
class FrameShift(Effect):
    """A small rigid motion of the mount at the boundary after session ``session``, kept from then on."""

    slug = "frame-shift"
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
        return twist_coefficients(mm=10.0, rad=0.05)

    def shifts(self, site: Site) -> Shifts:
        after = site.driver(after_session(site.settings))
        return {f"{site.place[0]}.motion.{axis}": site.c[axis] * after for axis in AXES}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (after_session(settings),)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return boundaries(recording)

    def explain(self, machine: Machine, place: Place) -> str:
        said = {"base": "The robot's base, or the instrument that looks at it,", "tool": "The tool"}
        what = said.get(place[0], f"The frame {place[0]}")
        return f"{what} was moved between two sessions."
