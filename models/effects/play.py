"""Where a joint stands by the way it came: play, and friction that lets it give before it slips."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import casadi as ca
import numpy as np

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    LOADS,
    actuator_at,
    approaches,
    down,
    drives_joint,
    joint_unit,
    nominal_gain,
    overshoot_of,
    points_only,
    singly,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Actuator, Direction
from truepose.models.machine.placed import ANY, NOT_NEGATIVE, SWITCH, ranges
from truepose.models.machine.states import across

LARGEST = {"mm": 0.1, "rad": 3e-3}
LEAN, LEANS = "lean", 36
"""Setting: where the centre of what the joint carries lies about its axis, rad; and how many are tried, evenly over a turn."""
FRICTION = "friction"
"""Setting: the load, N*m or N, up to which friction holds the joint on the flank that it came to."""
EVEN, NOTHING = 0.05, 1e-6
"""rad from the balance, within which friction may hold the joint anywhere in its play; N*m of a load that is none."""


@effects.add("backlash")
class Backlash(Effect):
    """Play: a joint that stands elsewhere when it is approached from the other side.

    The joint stands at reading - (b/2) * approach, b >= 0 its whole play.

    Setting ``lean``: the weight that it carries decides on which side of the play it rests, not the way that it came (a
    telescope's axis that is not quite in balance); the load's centre lies at that angle about the joint's axis. Setting
    ``friction`` (N*m, N): the load pushes the joint to its flank where it is larger than that; where it is smaller, friction
    holds the joint on the side that it came from.
    """

    slug = "backlash"
    setting_ranges = ranges({"lean": ANY, "friction": NOT_NEGATIVE})
    title = "Backlash"
    sentence = (
        "Joint {0} has play: where it stands depends on the side from which it arrived, or to which its weight "
        "pushes it."
    )
    formula = (
        "dq = -(b / 2) approach, approach +1 when it arrived moving towards larger readings; with lean: dq = (b / 2) sign "
        "of the torque that gravity exerts; with friction F: dq = (b / 2) sign(load - F approach)"
    )
    size = "0.5 to 2 arcmin (1.5e-4 to 6e-4 rad); 1 to 20 um"
    look_alikes = ("friction-hysteresis", "piezo-hysteresis", "joint-compliance")
    experiment = "approach the same poses from both sides"
    source = "reversal error of ISO 230-2"
    settings_add = False
    continuous = (LEAN, FRICTION)

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.mechanism.readings)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        unit = joint_unit(machine, place)
        return (Coefficient("b", unit, LARGEST[unit], lower=0.0),)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """The way that it came; on machines that point, also every side that its weight may lie on."""
        actuator = actuator_at(machine, place[0])
        if machine.loaded and drives_joint(machine, actuator) and not points_only(machine):
            return ({}, *({FRICTION: friction} for friction in LOADS))
        if actuator.unit != "rad" or not points_only(machine) or not drives_joint(machine, actuator):
            return ({},)
        return ({}, *({LEAN: 2 * pi * k / LEANS} for k in range(LEANS)))

    def weight(self, settings: Settings) -> float:
        return {LEAN: 1.0 / LEANS, FRICTION: 1.0 / len(LOADS)}.get(next(iter(settings), ""), 1.0)

    def reads_load(self, settings: Settings) -> bool:
        return bool({LEAN, FRICTION} & {*settings})

    def shifts(self, site: Site) -> Shifts:
        port = actuator_at(site.machine, site.place[0]).displacement
        if LEAN in site.settings:
            return {port: site.c["b"] / 2 * _side(site)}
        (name,) = self.drivers(site.machine, site.place, site.settings)
        approach = site.driver(name)
        if FRICTION in site.settings:
            pushed, even = (
                site.load(port) - site.settings[FRICTION] * approach,
                EVEN * site.settings[FRICTION],
            )
            return {port: site.c["b"] / 2 * pushed / ca.sqrt(pushed**2 + even**2 + NOTHING**2)}
        return {port: -site.c["b"] / 2 * approach}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return () if LEAN in settings else (f"approach.{actuator_at(machine, place[0]).reading}",)


def _side(site: Site) -> ca.SX:
    """Sign of gravity's torque about the joint's axis; it changes over where the load is in balance."""
    name = actuator_at(site.machine, site.place[0]).drives
    axis = site.machine.mechanism.joint(name).axis
    assert not isinstance(axis, Direction)
    u, v = across(axis)
    centre = ca.DM(ca.cos(site.settings[LEAN]) * u + ca.sin(site.settings[LEAN]) * v)
    torque = ca.dot(ca.DM(axis), ca.cross(centre, down(site, name)))
    return torque / ca.sqrt(torque**2 + EVEN**2)


WIDTHS = (0.003, 0.01, 0.03, 0.1)
AT_ONCE: Settings = {"width": 0.0}
COARSE = 3.0
"""Weight of friction that slips at once, among some nine other settings of one each."""
SHOWN = 0.05
"""Share of rows that must stand between the two limits; where all stand at one, backlash is the same function."""


@effects.add("friction-hysteresis")
class FrictionHysteresis(Effect):
    """Friction that lets a joint give before it slips: it trails its reading, and the trail depends on the way.

    The joint trails the way it went by up to h; it goes from one limit to the other within twice the half width r.

    Setting ``width`` is r as a part of the joint's range. Rows that arrive from further away than 2 r stand at a
    limit, as with backlash b = 2 h: only widths within which some reversal of the recording ends are looked for.
    Width 0 slips at once: then it is the same function as backlash, and only their prior odds tell them apart.

    Setting ``elements`` 1: elements of all these widths side by side, each with its own h, for friction that does
    not slip everywhere at once; ``overshoot``: the part of the range by which a joint starts behind its goal to
    arrive from a stated side, without it far enough.
    """

    commonness = 0.4  # rarer than play, with the way to slip seen and without
    slug = "friction-hysteresis"
    setting_ranges = ranges({"width": SWITCH, "elements": SWITCH, "overshoot": NOT_NEGATIVE})
    title = "Hysteresis of friction before slip"
    sentence = "Joint {0} gives before it slips: it trails its reading, by more the further it came."
    formula = (
        "dq = -h s / r, s the stop operator of half width r on the way of the reading: s follows every move and "
        "stays between -r and r; 0 <= h <= r; or a sum of such elements of several r"
    )
    size = "micrometres, microradians (recalled)"
    look_alikes = ("backlash", "piezo-hysteresis", "piezo-creep", "joint-compliance")
    experiment = (
        "move this joint to and fro in steps, with strokes that shrink from ten widths to a tenth: backlash keeps "
        "its whole width until the stroke is smaller, friction gives way by degrees"
    )
    source = (
        "rate-independent hysteresis of pre-sliding friction (Ruderman, arXiv 2212.05799); stop operator of Prandtl; "
        "elements in parallel: Iwan, Maxwell slip (recalled)"
    )

    unvaried = "no reversal short enough to tell it from backlash"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(a.reading for a in machine.mechanism.actuators if a.range)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        unit, actuator = joint_unit(machine, place), actuator_at(machine, place[0])
        if _at_once(settings):
            return (Coefficient("h", unit, LARGEST[unit], lower=0.0),)
        widest = [r * nominal_gain(machine, actuator) for r in _half_widths(actuator, settings)]
        names = [f"h{k}" for k in range(1, len(widest) + 1)] if len(widest) > 1 else ["h"]
        return tuple(
            Coefficient(name, unit, min(LARGEST[unit], w), lower=0.0, upper=w)
            for name, w in zip(names, widest, strict=True)
        )

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        leads = self.drivers(site.machine, site.place, site.settings)
        widths = _half_widths(actuator, site.settings)
        if _at_once(site.settings):
            return {actuator.displacement: -site.c["h"] * site.driver(leads[0])}
        behind = ca.SX(0)
        for h, lead, width in zip(site.c.values(), leads, widths, strict=True):
            behind += h * site.driver(lead) / width
        return {actuator.displacement: -behind}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        actuator = actuator_at(machine, place[0])
        if _at_once(settings):
            return (f"approach.{actuator.reading}",)
        tail = overshoot_of(actuator, settings)
        return tuple(f"stop.{actuator.reading}~{r:.6g}{tail}" for r in _half_widths(actuator, settings))

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Widths within which some reversals of the recording end, and none where the sides of arrival are told."""
        several = [{"elements": 1.0, **known} for known in approaches(machine, place, recording)]
        variants: list[Settings] = [*({"width": width} for width in WIDTHS), *several]
        seen = [s for s in variants if self._shows(machine, place, s, recording)]
        return [AT_ONCE, *seen] if _sides(machine, place, recording) else seen

    def weight(self, settings: Settings) -> float:
        return COARSE if _at_once(settings) else 1.0

    def _shows(self, machine: Machine, place: Place, settings: Settings, recording: Observed) -> bool:
        leads = [recording.driver(name) for name in self.drivers(machine, place, settings)]
        widths = _half_widths(actuator_at(machine, place[0]), settings)
        return any(
            lead is None or float(np.mean(np.abs(np.asarray(lead, dtype=float)) < 0.999 * width)) >= SHOWN
            for lead, width in zip(leads, widths, strict=True)
        )


def _at_once(settings: Settings) -> bool:
    return settings.get("width") == 0.0


def _sides(machine: Machine, place: Place, recording: Observed) -> bool:
    """Whether rows tell from which side this joint came, and it came from both."""
    came = recording.driver(f"approach.{actuator_at(machine, place[0]).reading}")
    return came is not None and len(np.unique(np.sign(np.asarray(came, dtype=float)))) > 1


def _half_widths(actuator: Actuator, settings: Settings) -> tuple[float, ...]:
    """Half widths of the hysteresis in the reading's unit."""
    low, high = actuator.range or (0.0, 1.0)
    parts = WIDTHS if settings.get("elements") else (settings.get("width", WIDTHS[-1]),)
    return tuple(part * (high - low) for part in parts)
