"""Readings taken before the machine stood: its joints are still on the way that they came, by their shares of the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    actuator_at,
    centre_and_half,
    moves_while_read,
    nominal_gain,
    singly_and_together,
)
from truepose.models.file.driver import STEP, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NOT_NEGATIVE, SWITCH, ranges

LARGEST = {"mm": 0.3, "rad": 3e-3, "1": 3e-3}
"""Of the joint with the longest way, and of the whole step: 25 ms before the end of a stop from 10 rad/s^2, or from 1 m/s^2."""
WHOLE: Settings = {"whole": 1.0}
WRIST, MAIN = 2.0, 3
"""How much harder the light axes of industrial arms brake than their main axes (a round number of data sheets' accelerations,
recalled), and how many main axes an arm has."""
NOTHING = 1e-12


@effects.add("early-reading")
class EarlyReading(Effect):
    """Joints stand off their readings along their last motion, as synchronised joints do shortly before they stop.

    All stop at one time, so that what is left of the way is one share of every joint's step. Where the machine brakes
    evenly, what is left to the joint with the longest way (e) is the same whatever the motion; setting ``whole`` 1: it is
    a share (f) of the whole step, as where a controller settles exponentially. Setting ``wrist``: from the fourth joint on
    ways count so many times less, as where a wrist brakes harder and the longest way is not the slowest.

    e, f > 0: the sensor read, or averaged, before the machine stood, which is short of its readings. e, f < 0: the joints
    were logged on the way, and the sensor read later. Where several joints are the place one factor serves all; ways of
    slides and of turning joints are compared by half ranges (e is such a part, then).
    """

    slug = "early-reading"
    setting_ranges = ranges({"whole": SWITCH, "wrist": NOT_NEGATIVE})
    title = "Readings before the machine stood"
    formula = "dq = -e step / (longest step of all joints), or dq = -f step, step the joint's last motion"
    size = "tens of microradians to a few milliradians: a / 2 t^2 at t before the end of a stop"
    look_alikes = ("backlash", "friction-hysteresis", "latency", "joint-compliance")
    experiment = (
        "read the same visits again after a longer wait; reach the same poses by short and by long motions"
    )
    source = (
        "synchronised point-to-point motion, as in textbooks of robot control: all axes end at one time; found on a UR10 "
        "before a laser tracker"
    )
    unvaried = "joints moved while they were read (velocity columns): what that does is latency"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly_and_together(machine.mechanism.readings)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if _whole(settings):
            return (Coefficient("f", "1", LARGEST["1"]),)
        unit = _unit(machine)
        return (Coefficient("e", unit, LARGEST[unit]),)

    def shifts(self, site: Site) -> Shifts:
        names = zip(site.machine.mechanism.readings, self._steps(site.machine), strict=True)
        steps = {joint: site.driver(step) for joint, step in names}
        out = {}
        for joint in site.place:
            actuator = actuator_at(site.machine, joint)
            gain = site.values[actuator.gain] if actuator.gain else 1
            step = gain * steps[actuator.reading]
            left = site.c["f"] * step if _whole(site.settings) else site.c["e"] * step / _longest(site, steps)
            out[actuator.displacement] = -left
        return out

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return self._steps(machine)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """All laws; none where joints moved while they were read."""
        joints = machine.mechanism.readings
        if any(moves_while_read(recording, joint) for joint in joints):
            return ()
        arm = _unit(machine) == "rad" and len(joints) > MAIN
        return ({}, WHOLE, {"wrist": WRIST}) if arm else ({}, WHOLE)

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        who = "The machine" if len(place) > 1 else f"Joint {place[0]}"
        return f"{who} did not stand yet when it was read: it is off its readings along the last motion."

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        (value,) = values.values()
        if value >= 0:
            return (
                "It was seen short of them, so that the sensor read too early: wait longer before a reading."
            )
        return "It was seen beyond them, so that the joints were logged too early: log them when the sensor reads."

    @staticmethod
    def _steps(machine: Machine) -> tuple[str, ...]:
        return tuple(Driver(STEP, joint).name for joint in machine.mechanism.readings)


def _whole(settings: Settings) -> bool:
    return bool(settings.get("whole"))


def _unit(machine: Machine) -> str:
    """Unit of e: that of all joints, or 1, a part of half the range."""
    units = {actuator.unit for actuator in machine.mechanism.actuators}
    return units.pop() if len(units) == 1 else "1"


def _longest(site: Site, steps: Mapping[str, ca.SX]) -> ca.SX:
    """The longest way of any joint in the unit of e; where nothing moved all steps are 0, and this is not."""
    longest = ca.SX(NOTHING)
    for k, actuator in enumerate(site.machine.mechanism.actuators):
        gain = abs(nominal_gain(site.machine, actuator))
        compared = gain * centre_and_half(actuator)[1] if _unit(site.machine) == "1" else 1.0
        compared *= site.settings.get("wrist", 1.0) if k >= MAIN else 1.0
        longest = ca.fmax(longest, gain / compared * ca.fabs(steps[actuator.reading]))
    return longest
