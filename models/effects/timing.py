"""Readings that are not of the instant of the joints': of a machine on its way, of a sensor that lags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    actuator_at,
    centre_and_half,
    nominal_gain,
    sensor_names,
    singly_and_together,
)
from truepose.models.file.driver import STEP, VELOCITY, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import own_motions
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
    """Readings taken before the machine stood: its joints are still on the way that they came, by their shares of the
    motion.

    Joints stand off their readings along their last motion, as synchronised joints do shortly before they stop.

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


LONGEST = 0.5


@effects.add("latency")
class Latency(Effect):
    """A sensor and a controller that do not mean the same instant.

    What is seen at a row is where the joints stood tau earlier, for all sensors of the machine alike.

    Encoders on the load side are read with the joints, by their controller, and do not lag.
    tau < 0 where the controller logs its joints late. Setting ``still.J``: joint J never moves, or its velocity
    is not logged; it is left out.
    """

    slug = "latency"
    setting_ranges = ranges({"still.": SWITCH})
    driven_by = "sensor"
    title = "Latency between joints and sensor"
    sentence = "The sensor reads where the machine stood a time tau before its joints were logged."
    formula = "q - tau velocity"
    size = "milliseconds; the error is tau times the velocity: 10 um for 1 ms at 10 mm/s"
    look_alikes = ("backlash", "friction-hysteresis", "mount-drift")
    experiment = "pass the same poses at two speeds, and at rest"
    source = (
        "time offsets in the range of milliseconds between a laser tracker and other sensors: "
        "doi:10.1515/jag-2023-0084"
    )

    def places(self, machine: Machine) -> Sequence[Place]:
        names = sensor_names(machine)
        apart = any(not sensor.joints for sensor in machine.sensors)
        return [names] if apart and machine.mechanism.readings else []

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("tau", "s", 0.01, -LONGEST, LONGEST),)

    def shifts(self, site: Site) -> Shifts:
        out = {}
        with_joints = [each for sensor in site.machine.sensors for each in sensor.joints.items()]
        drivers = self.drivers(site.machine, site.place, site.settings)
        rates = dict.fromkeys(site.machine.mechanism.readings, ca.SX(0))
        rates |= {Driver.of(driver).place: site.driver(driver) for driver in drivers}
        for actuator in site.machine.mechanism.actuators:
            rate = own_motions(site.machine.mechanism, rates)[actuator.reading]
            if rate.is_zero():
                continue
            gain = site.values[actuator.gain] if actuator.gain else 1
            own = site.c["tau"] * gain * rate
            out[actuator.displacement] = -own
            out |= {f"{column}.reading": own for column, joint in with_joints if joint == actuator.reading}
        return out

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        joints = machine.mechanism.readings
        return tuple(Driver(VELOCITY, joint).name for joint in joints if not settings.get(f"still.{joint}"))

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """All joints that move while they are read; all of them where no velocity is recorded."""
        still = [joint for joint in machine.mechanism.readings if not moves_while_read(recording, joint)]
        some = len(still) < len(machine.mechanism.readings)
        return ({f"still.{joint}": 1.0 for joint in still} if some else {},)

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        tau, sigma = 1e3 * values["tau"], 1e3 * std["tau"]
        who = "The sensor lags the joints" if tau >= 0 else "The joints are logged late,"
        return f"{who} by {abs(tau):.3g} +- {sigma:.1g} ms."


def moves_while_read(recording: Observed, joint: str) -> bool:
    """Whether a joint's velocity is recorded, and not always zero."""
    velocity = recording.driver(Driver(VELOCITY, joint).name)
    return velocity is not None and bool(np.any(np.asarray(velocity, dtype=float)))
