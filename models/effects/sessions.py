"""What is another after a break between sessions, or creeps away in the course of a campaign: mounts and zeros."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import casadi as ca
import numpy as np

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    SECONDS_PER_HOUR,
    actuator_at,
    clock,
    joint_unit,
    singly,
)
from truepose.models.file.driver import ROW, TIME
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES, Parameter
from truepose.models.machine.placed import ANY, COLUMN, DURATION, SWITCH, ranges

ANEW = "anew"
"""Setting of a mount that the machine file says is set up anew for each session."""
STATED = 100.0
"""Prior 1-sigma of what a machine file states, in scales (``PlacedEffect.spread``)."""


@effects.add("frame-shift")
class FrameShift(Effect):
    """A base or a tool that stands elsewhere after a break between sessions.

    A rigid motion of the mount at the boundary after session ``session``, kept from then on.

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


LARGEST = {"mm": 2.0, "rad": 0.05}


@effects.add("zero-shift")
class ZeroShift(Effect):
    """A joint whose zero is another one after a break between sessions.

    A constant added to one joint's displacement, or to two, after session ``session``.
    """

    slug = "zero-shift"
    setting_ranges = ranges({"session": ANY})
    title = "Zero of a joint moved between sessions"
    counted = True
    formula = "dq = zero after session k, nothing before"
    size = "anything: the repeatability of the home switch, or a tooth of a slipped coupling"
    look_alikes = ("frame-shift", "mount-drift", "backlash", "thermal-expansion")
    experiment = "home the joint again and repeat one reference pose"
    source = "re-homing and slipped couplings; no physics"
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        readings = machine.mechanism.readings
        return [*singly(readings), *combinations(readings, 2)]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        names = ["zero"] if len(place) == 1 else [f"zero.{joint}" for joint in place]
        units = [joint_unit(machine, (joint,)) for joint in place]
        return tuple(Coefficient(name, unit, LARGEST[unit]) for name, unit in zip(names, units, strict=True))

    def shifts(self, site: Site) -> Shifts:
        after = site.driver(after_session(site.settings))
        ports = [actuator_at(site.machine, joint).displacement for joint in site.place]
        return {port: c * after for port, c in zip(ports, site.c.values(), strict=True)}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (after_session(settings),)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return boundaries(recording)

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        zero = "The zero" if len(place) == 1 else "The zeros"
        return (
            f"{zero} of {' and '.join(place)} moved between two sessions: homed anew, or a slipped coupling."
        )


ROWS = "rows"
"""Setting of a drift in the order of rows: how many follow the first of the longest session."""
FRACTIONS = (0.08, 0.15, 0.3, 0.6, 1.2)
"""Time constants to try, in spans of the campaign: neighbours differ by a factor of two, which data hardly tell apart."""


@effects.add("mount-drift")
class MountDrift(Effect):
    """A base or a tool that creeps away in the course of the campaign.

    A small motion of the mount that grows with time since ``start`` (s on the recording's clock).

    ``tau`` 0: at a constant rate, per hour. ``tau`` > 0 (s): settling, 1 - exp(-t / tau) of its end, and still before. Without
    a clock it grows with the order of rows in each session, setting ``rows``: how many follow the first of the longest. The
    motion is then that up to its last row, and ``tau`` counts in rows.
    """

    slug = "mount-drift"
    setting_ranges = ranges({"rows": DURATION, "tau": DURATION, "start": COLUMN})
    title = "Drifting mount"
    counted = True
    formula = "twist (t - start) / 1 h, or twist (1 - exp(-(t - start) / tau)), t in rows where no clock was recorded"
    size = "0.1 to 10 um/h in a quiet laboratory; more while a machine warms up"
    look_alikes = ("thermal-expansion", "frame-shift", "zero-shift", "piezo-creep")
    experiment = "repeat one reference pose throughout the campaign, in a shuffled order of the others"
    source = "repeated reference poses, the usual drift check of laser tracker and photogrammetry campaigns"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.standing)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        whole = ROWS in settings or settings.get("tau", 0.0)
        return twist_coefficients(mm=1.0, rad=5e-3, per="" if whole else "/h")

    def shifts(self, site: Site) -> Shifts:
        rows, tau = site.settings.get(ROWS, 0.0), site.settings.get("tau", 0.0)
        elapsed = site.driver(ROW) + rows if rows else site.driver(TIME) - site.settings.get("start", 0.0)
        steady = elapsed / (rows or SECONDS_PER_HOUR)
        growth = 1 - ca.exp(-ca.fmax(0, elapsed) / tau) if tau else steady
        return {f"{site.place[0]}.motion.{axis}": site.c[axis] * growth for axis in AXES}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (ROW if ROWS in settings else TIME,)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """A constant rate, and time constants inside the campaign, from its start; in rows where there is no clock."""
        span, order = clock(recording), recording.driver(ROW)
        if span is None and order is not None:
            rows = -float(np.min(np.asarray(order, dtype=float)))
            return [{"tau": tau, ROWS: rows} for tau in _taus(rows)] if rows > 0.0 else []
        if span is None or span[1] <= span[0]:
            return ({"tau": 0.0, "start": 0.0},)
        return [{"tau": tau, "start": span[0]} for tau in _taus(span[1] - span[0])]

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        said = {"base": "The base creeps under the robot", "tool": "The tool creeps in its mount"}
        what = said.get(place[0], f"The frame {place[0]} creeps on what carries it")
        return f"{what} in the course of the campaign."


def _taus(length: float) -> list[float]:
    """No settling, and time constants of a campaign of this length (s, or rows)."""
    return [0.0, *(float(f"{fraction * length:.2g}") for fraction in FRACTIONS)]


def twist_coefficients(mm: float, rad: float, per: str = "") -> tuple[Coefficient, ...]:
    """Six small motions x y z rx ry rz with their scales; ``per`` ends the unit (``/h``)."""
    moves = [Coefficient(axis, "mm" + per, mm) for axis in AXES[:3]]
    return (*moves, *(Coefficient(axis, "rad" + per, rad) for axis in AXES[3:]))


def boundaries(recording: Observed) -> Sequence[Settings]:
    """One candidate a boundary between sessions; none in a single session."""
    return [{"session": float(k)} for k in range(1, recording.n_sessions)]


def after_session(settings: Settings) -> str:
    """Driver that is 0 up to a boundary between sessions and 1 after it."""
    return f"session.after.{settings.get('session', 1.0):g}"
