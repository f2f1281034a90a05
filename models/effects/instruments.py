"""Sensors that err themselves: scale, periodic errors, lenses, and targets off their place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi

import casadi as ca

from truepose.models.effects.base import (
    NO_SETTINGS,
    Coefficient,
    Effect,
    Observed,
    Place,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.effects.common import sensor_at, sensors_where, sine_coefficients, sine_pair, singly
from truepose.models.effects.sights import (
    AZIMUTH,
    ELEVATION,
    NOWHERE,
    XYZ,
    from_home,
    length_names,
    looks_from_afar,
    measures_lengths,
    moved_point,
    optical,
    point_names,
    polar,
    seen_point,
    stretched,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import COUNT, NOT_NEGATIVE, ORDER, SWITCH, ranges
from truepose.models.machine.sensor import Sensor
from truepose.models.sensors.distance import Distance

LARGEST_SCALE = 0.1


@effects.add("sensor-scale")
class SensorScale(Effect):
    """A sensor whose unit of length is wrong.

    Lengths, and points away from the sensor frame's origin, read s of themselves too long.

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
        return (Coefficient("s", "1", 1e-4, -LARGEST_SCALE, LARGEST_SCALE),)

    def shifts(self, site: Site) -> Shifts:
        return stretched(site, sensor_at(site.machine, site.place[0]), site.c["s"])

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        kind = sensor_at(machine, place[0]).type
        return f"All lengths that the sensor {kind} reads are too long (s > 0) or too short by the same fraction."

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        return f"Its scale is off by {1e6 * values['s']:.1f} +- {1e6 * std['s']:.1f} ppm."


FRINGE, ENCODER = 2.5e-5, 2e-5
ENCODERS = {1.0: AZIMUTH, 2.0: ELEVATION}


@effects.add("sensor-periodic")
class SensorPeriodic(Effect):
    """A sensor whose own scale errs periodically: a fringe that is no sine, an encoder off its centre.

    An interferometer's error per half wavelength, or a tracker's encoder error per turn.

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
        return not _is_tracker(sensor) or looks_from_afar(machine, sensor)

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
        return [{"axis": axis, "order": order} for axis in ENCODERS for order in orders]

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
    angle, across = polar(point)[ENCODERS.get(site.settings.get("axis", 1.0), ELEVATION)]
    return sine_pair(site, order * angle) * across


@effects.add("lens-distortion")
class LensDistortion(Effect):
    """A camera's lens that draws points away from the axis, or towards it.

    What is left of radial distortion: points move across the sensor frame's z axis, the optical axis.

    r is the tangent of a point's angle off the axis. Beyond 45 degrees, and behind the origin, no camera looks; r
    stays 1 there. Setting ``terms``: k1 alone, or k1 and k2; ``decentred`` 1: p1 and p2 too, of lenses that do not stand
    on one axis, or whose axis is not quite the sensor's z axis. One view stands for the whole network of pictures. A
    part of k1 r^2 that is alike for all points is a scale across the axis: only its change over the picture, by
    targets far apart or moves across the field, tells a lens from ``sensor-scale``; k1 and k2 need a wide field.
    """

    slug = "lens-distortion"
    setting_ranges = ranges({"terms": COUNT, "decentred": SWITCH})
    driven_by = "sensor"
    title = "Distortion of a lens"
    sentence = (
        "The lens moves points away from the sensor's z axis (k1 > 0) or towards it, more the farther off they "
        "are."
    )
    forms = ({"terms": 1.0}, {"terms": 2.0}, {"terms": 2.0, "decentred": 1.0})
    formula = (
        "X, Y + (k1 r^2 + k2 r^4) (X, Y), r^2 = x^2 + y^2, x = X / Z, y = Y / Z in the sensor's frame; decentred "
        "X + Z (p1 (r^2 + 2 x^2) + 2 p2 x y), Y + Z (2 p1 x y + p2 (r^2 + 2 y^2))"
    )
    size = "1 : 1e5 of the size of the object in a good network of pictures"
    look_alikes = ("sensor-scale", "target-offset", "platform-deformation")
    experiment = "turn the camera about its axis, or move the same targets through the corners of the picture"
    source = "radial and decentring terms of Brown 1971, Close-range camera calibration; size recalled"

    def places(self, machine: Machine) -> Sequence[Place]:
        return sensors_where(machine, lambda sensor: sensor.takes_pictures)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        terms = range(1, round(settings.get("terms", 1.0)) + 1)
        radial = [Coefficient(f"k{k}", "1", 1e-3, -0.1, 0.1) for k in terms]
        if not settings.get("decentred"):
            return tuple(radial)
        return (*radial, *(Coefficient(f"p{k}", "1", 1e-4, -0.01, 0.01) for k in (1, 2)))

    def shifts(self, site: Site) -> Shifts:
        out: dict[str, ca.SX] = {}
        for name in point_names(sensor_at(site.machine, site.place[0])):
            x, y, z = ca.vertsplit(seen_point(site, name))
            aside = x**2 + y**2
            depth = ca.fmax(ca.fmax(z, 0.0) ** 2, aside) + NOWHERE
            square = aside / depth
            factor = sum((c * square ** int(k[1:]) for k, c in site.c.items() if k[0] == "k"), ca.SX(0))
            moved = ca.vertcat(factor * x, factor * y, 0.0)
            if "p1" in site.c:
                p1, p2 = site.c["p1"], site.c["p2"]
                turned = ca.vertcat(
                    p1 * (aside + 2 * x**2) + 2 * p2 * x * y, 2 * p1 * x * y + p2 * (aside + 2 * y**2), 0.0
                )
                moved += turned / ca.sqrt(depth)
            out |= moved_point(name, moved)
        return out


LARGEST_OFFSET = 0.1


@effects.add("target-offset")
class TargetOffset(Effect):
    """A target that does not sit where it is said to sit.

    A constant in the tool's frame added to one target's point; of a single target, the tool frame's own error.
    """

    slug = "target-offset"
    setting_ranges = NO_SETTINGS
    driven_by = "constant"
    title = "A target off its place"
    sentence = (
        "The target {0} sits off its stated point, by the same vector of the tool's frame in every row."
    )
    formula = "point + (x, y, z), constant in the tool's frame"
    size = (
        "2 to 15 um for the centre of a reflector in its ball, tenths of a mm for a nest that is not seated"
    )
    look_alikes = ("platform-deformation", "lens-distortion", "sensor-scale", "frame-shift")
    experiment = "turn the reflector in its nest, or swap two reflectors: the offset goes with the reflector"
    source = "sizes recalled from data sheets of reflectors; not checked against one"

    def places(self, machine: Machine) -> Sequence[Place]:
        """Points that are constants of the machine; the reflector of a ``position`` sensor is the tool frame."""
        known = machine.geometry
        points = [name for sensor in machine.sensors for name in point_names(sensor)]
        return singly(name[:-1] for name in points if all(f"{name}{axis}" in known for axis in XYZ))

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(axis, "mm", LARGEST_OFFSET) for axis in XYZ)

    def shifts(self, site: Site) -> Shifts:
        return {f"{site.place[0]}.{axis}": site.c[axis] for axis in XYZ}
