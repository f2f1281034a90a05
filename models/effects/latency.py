"""A sensor and a controller that do not mean the same instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import moves_while_read, sensor_names
from truepose.models.file.driver import VELOCITY, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import own_motions
from truepose.models.machine.placed import SWITCH, ranges

LONGEST = 0.5


@effects.add("latency")
class Latency(Effect):
    """What is seen at a row is where the joints stood tau earlier, for all sensors of the machine alike.

    Encoders on the load side are read with the joints, by their controller, and do not lag.
    tau < 0 where the controller logs its joints late. Setting ``still.J``: joint J never moves, or its velocity
    is not logged; it is left out.
    """

    slug = "latency"
    setting_ranges = ranges({"still.": SWITCH})
    driven_by = "sensor"
    title = "Latency between joints and sensor"
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

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return "The sensor reads where the machine stood a time tau before its joints were logged."

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        tau, sigma = 1e3 * values["tau"], 1e3 * std["tau"]
        who = "The sensor lags the joints" if tau >= 0 else "The joints are logged late,"
        return f"{who} by {abs(tau):.3g} +- {sigma:.1g} ms."
