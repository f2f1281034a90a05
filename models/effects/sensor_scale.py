"""A sensor whose unit of length is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import sensor_at, sensors_where
from truepose.models.effects.sights import measures_lengths, stretched
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS

LARGEST = 0.1


@effects.add("sensor-scale")
class SensorScale(Effect):
    """Lengths, and points away from the sensor frame's origin, read s of themselves too long.

    Where the origin stands does not matter as long as the base frame is free: another one moves all points alike.
    """

    slug = "sensor-scale"
    setting_ranges = NO_SETTINGS
    driven_by = "sensor"
    title = "Scale error of a sensor"
    counted = True
    formula = "reading + s * length; points: s * (x, y, z), from the sensor frame's origin"
    size = "a few um per metre of a laser tracker, 10 to 100 ppm of a scale bar or a wavelength"
    look_alikes = ("air-refraction", "actuator-scale", "thermal-expansion", "wrong-constant")
    experiment = "measure a calibrated length (scale bar) with this sensor, without the machine"
    source = "scale bars and ranging tests of ASME B89.4.19; sizes recalled"

    def places(self, machine: Machine) -> Sequence[Place]:
        return sensors_where(machine, measures_lengths)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("s", "1", 1e-4, -LARGEST, LARGEST),)

    def shifts(self, site: Site) -> Shifts:
        return stretched(site, sensor_at(site.machine, site.place[0]), site.c["s"])

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        kind = sensor_at(machine, place[0]).type
        return f"All lengths that the sensor {kind} reads are too long (s > 0) or too short by the same fraction."

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        return f"Its scale is off by {1e6 * values['s']:.1f} +- {1e6 * std['s']:.1f} ppm."
