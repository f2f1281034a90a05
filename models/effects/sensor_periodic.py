"""A sensor whose own scale errs periodically: a fringe that is no sine, an encoder off its centre."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import sensor_at, sensors_where, sine_coefficients, sine_pair
from truepose.models.effects.sights import (
    from_home,
    length_names,
    moved_point,
    optical,
    point_names,
    seen_point,
)
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.placed import NOT_NEGATIVE, ORDER, ranges
from truepose.models.machine.sensor import Sensor
from truepose.models.sensors.distance import Distance

FRINGE, ENCODER = 2.5e-5, 2e-5
NOWHERE = 1e-12
AZIMUTH, ELEVATION = 1.0, 2.0


@effects.add("sensor-periodic")
class SensorPeriodic(Effect):
    """An interferometer's error per half wavelength, or a tracker's encoder error per turn.

    Settings: ``order`` 1 or 2, cycles per half wavelength or per turn; of trackers, ``axis`` 1 (azimuth about the
    sensor frame's z) or 2 (elevation above its xy plane). A tracker's frame must have its axes: its origin where
    the beams meet, z up.
    """

    slug = "sensor-periodic"
    setting_ranges = ranges({"order": ORDER, "axis": NOT_NEGATIVE})
    driven_by = "sensor"
    title = "Periodic error of a sensor"
    counted = True
    formula = (
        "a sin(4 pi k L / lambda) + b cos(4 pi k L / lambda), L from home; "
        "trackers: angle + a sin(k angle) + b cos(k angle), k = 1 or 2"
    )
    size = "interferometers: nanometres; angle encoders of trackers: 65 um in a length of 7.75 m seen from 7 m (k = 2)"
    look_alikes = ("screw-periodic", "encoder-eccentricity", "transmission-error", "sensor-scale")
    experiment = "move by eighths of a wavelength; trackers: measure one length from several azimuths"
    source = (
        "Wu and Deslattes 1998, Appl. Opt. (interferometers); "
        "Muralikrishnan et al. 2010, doi:10.6028/jres.115.022 (trackers)"
    )
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        return sensors_where(machine, lambda sensor: bool(_wavelength(sensor)) or _is_tracker(sensor))

    def screened(self, machine: Machine, place: Place) -> bool:
        """Interferometers; trackers where the machine does not stand in the sensor's origin."""
        sensor = sensor_at(machine, place[0])
        origin = [machine.geometry[f"{FRAMES[0]}.{axis}"].nominal for axis in "xyz"]
        return not _is_tracker(sensor) or any(origin)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        wavelength = _wavelength(sensor_at(machine, place[0]))
        if wavelength is None:
            return sine_coefficients("rad", ENCODER)
        # a larger error would make the reading run backwards
        bound = wavelength / (4 * pi * settings.get("order", 1.0))
        return tuple(Coefficient(name, "mm", FRINGE, -bound, bound) for name in "ab")

    def shifts(self, site: Site) -> Shifts:
        sensor, order = sensor_at(site.machine, site.place[0]), site.settings.get("order", 1.0)
        wavelength = _wavelength(sensor)
        if wavelength is not None:
            turn = 4 * pi * order / wavelength
            return {
                f"{column}.reading": sine_pair(site, turn * from_home(site, sensor, column))
                for column in length_names(sensor)
            }
        out: dict[str, ca.SX] = {}
        for name in point_names(sensor):
            out |= moved_point(name, _turned(site, seen_point(site, name), order))
        return out

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        orders = (1.0, 2.0)
        if _wavelength(sensor_at(machine, place[0])) is not None:
            return [{"order": order} for order in orders]
        return [{"axis": axis, "order": order} for axis in (AZIMUTH, ELEVATION) for order in orders]

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if _wavelength(sensor_at(machine, place[0])) is not None:
            return "The interferometer errs periodically: the same error comes back every half wavelength."
        return "An angle encoder of the tracker errs periodically: points shift across the line of sight with its angle."


def _wavelength(sensor: Sensor) -> float | None:
    """Wavelength of an interferometer, mm; None of other sensors and where the machine file does not say it."""
    return sensor.wavelength if isinstance(sensor, Distance) else None


def _is_tracker(sensor: Sensor) -> bool:
    return optical(sensor) and bool(point_names(sensor))


def _turned(site: Site, point: ca.SX, order: float) -> ca.SX:
    """(3,) how a point moves when one encoder reads a + b of its angle too much; smooth on the axis, too."""
    x, y, z = ca.vertsplit(point)
    aside = ca.sqrt(x**2 + y**2 + NOWHERE)
    if site.settings.get("axis", AZIMUTH) == AZIMUTH:
        angle = sine_pair(site, order * ca.atan2(y, x + NOWHERE))
        return angle * ca.vertcat(-y, x, 0.0)
    angle = sine_pair(site, order * ca.atan2(z, aside))
    return angle * ca.vertcat(-x * z / aside, -y * z / aside, aside)
