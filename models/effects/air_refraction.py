"""Light that travels more slowly in dense air, read as a length that grew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi

import casadi as ca

from truepose.arrays import Array
from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import sensor_at, sensors_where
from truepose.models.effects.sights import (
    bent_up,
    borrowed,
    from_settings,
    of_stars,
    optical,
    others,
    stretched,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ANY, SWITCH, ranges

REFRACTIVITY = 2.7e-4
"""n - 1 of dry air at 20 degC and 1013.25 hPa: 2.72e-4 at 633 nm, 2.69e-4 at 1550 nm."""
KELVIN, WARM, PRESSURE = 273.15, 20.0, 1013.25
DEGREES = 180.0 / pi
MOST = 1.5
"""Share with some room above 1: the thermometer is not in the beam."""
MOST_ELSEWHERE = 5.0
"""The same where the thermometer is beside a part of the machine: the air may vary more than that part."""
LARGEST_STRAIN = 1e-4
"""What weather can do to a length: 50 K (46 ppm) and 200 hPa (54 ppm) from 20 degC and 1013.25 hPa."""
NO_WEATHER = 0.2
"""How likely refraction is where nobody logged the weather: it is then the same as a scale of the sensor. Chosen."""
STILL = "still"
LOGGED = {"temperature": "temperature.air", "pressure": "pressure"}


@effects.add("air-refraction")
class AirRefraction(Effect):
    """Light that travels more slowly in dense air, read as a length that grew.

    A share of the refraction of air that the sensor does not correct: 1 for an instrument that knows no weather.

    Lengths: the change of the air since 20 degC and 1013.25 hPa. Directions of stars: the whole of it, from the elevation
    alone, with the weather where it is logged; the light of a star comes in steeper than the star stands, so that a tool
    points higher than where the recording has the star. A share below 0: the recording has it corrected once too often.

    Settings ``temperature`` and ``pressure``: 1 where that driver is left uncorrected, 0 where it is not. The path
    is the whole length that is seen, dead path included; of points, their range from the sensor frame's origin. ``from.COLUMN``
    (degC): a thermometer elsewhere stands in for that of the air, and counts from that value. Where nothing of the weather is
    read (``still``) it stands still, and stretches every path by the same share ``n``.
    """

    slug = "air-refraction"
    borrowing = ("from.", STILL)
    setting_ranges = ranges({"still": SWITCH, "temperature": SWITCH, "pressure": SWITCH, "from.": ANY})
    driven_by = "sensor"
    title = "Refraction of air that is not corrected"
    formula = (
        "reading + share (n - n0) L, n - 1 = 2.7e-4 p / 1013.25 hPa * 293.15 K / T, n0 at 20 degC and 1013.25 hPa; "
        "of stars: elevation - share R, R = 58 arcsec cot(elevation) p / 1013 hPa * 293 K / T; Bennett's near the horizon"
    )
    size = "-0.92 ppm/K and +0.27 ppm/hPa of the whole path"
    look_alikes = ("sensor-scale", "thermal-expansion", "mount-drift")
    experiment = "watch a fixed target for a day with thermometer and barometer beside the beam"
    source = (
        "Ciddor 1996, Appl. Opt. 35, 1566 (standard air at 15 degC), with the density of an ideal gas; Bennett 1982, The "
        "calculation of astronomical refraction in marine navigation"
    )

    def places(self, machine: Machine) -> Sequence[Place]:
        stars = sensors_where(machine, of_stars) if machine.gravity is not None else []
        return [*sensors_where(machine, optical), *stars]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if settings.get(STILL):
            return (Coefficient("n", "1", LARGEST_STRAIN / 3, -LARGEST_STRAIN, LARGEST_STRAIN),)
        lowest = -MOST if of_stars(sensor_at(machine, place[0])) else 0.0
        return (
            Coefficient("share", "1", 1.0, lowest, MOST if borrowed(settings) is None else MOST_ELSEWHERE),
        )

    def shifts(self, site: Site) -> Shifts:
        sensor = sensor_at(site.machine, site.place[0])
        if of_stars(sensor):
            used = self.drivers(site.machine, site.place, site.settings)
            return bent_up(site, sensor, lambda up: -site.c["share"] * _raised(up, site, used))
        if "n" in site.c:
            return stretched(site, sensor, site.c["n"])
        used = self.drivers(site.machine, site.place, site.settings)
        air = {name: site.driver(name) for name in used}
        column, start = borrowed(site.settings) or (LOGGED["temperature"], WARM)
        density = air.get("pressure", ca.SX(PRESSURE)) / PRESSURE
        density *= (start + KELVIN) / (air.get(column, ca.SX(start)) + KELVIN)
        strain = site.c["share"] * REFRACTIVITY * (density - 1.0)
        return stretched(site, sensor, strain)

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        if settings.get(STILL):
            return ()
        elsewhere = borrowed(settings)
        columns = LOGGED if elsewhere is None else LOGGED | {"temperature": elsewhere[0]}
        return tuple(driver for name, driver in columns.items() if settings.get(name, 1.0))

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """What was logged: all of it uncorrected, or one of the two; of stars all that was logged."""
        logged = [name for name, driver in LOGGED.items() if recording.driver(driver) is not None]
        if of_stars(sensor_at(machine, place[0])):
            return ({name: float(name in logged) for name in LOGGED},)
        single = [{name: float(name == one) for name in LOGGED} for one in logged]
        return single if len(logged) == 1 else [dict.fromkeys(LOGGED, 1.0), *single]

    def elsewhere(self, machine: Machine, place: Place, seen: Mapping[str, Array]) -> Sequence[Settings]:
        """Of lengths, without the air's own temperature: any other, alone or with pressure; and weather that stands still."""
        if LOGGED["temperature"] in seen or of_stars(sensor_at(machine, place[0])):
            return []
        proxies = [from_settings(name, seen) for name in others(machine, [], seen)]
        return [
            *({"temperature": 1.0, "pressure": p, **proxy} for proxy in proxies for p in (0.0, 1.0)),
            {STILL: 1.0},
        ]

    def weight(self, settings: Settings) -> float:
        if settings.get(STILL):
            return NO_WEATHER
        return 1.0 if all(settings.get(name, 1.0) for name in LOGGED) else 0.5

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        sensor, elsewhere = sensor_at(machine, place[0]), borrowed(settings)
        if settings.get(STILL) and elsewhere is None:
            return (
                f"The sensor {sensor.type} reads all paths too long or too short by one share, as air does whose refraction is "
                "not corrected; nobody logged its temperature or pressure, so a wrong scale looks the same."
            )
        if of_stars(sensor):
            said = "The air lifts what is seen above where the recording has it, more the lower it stands."
        else:
            said = f"The sensor {sensor.type} looks through air whose refraction changes with the weather and is not corrected."
        return said if elsewhere is None else f"{said} Its temperature is taken from {elsewhere[0]}."

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        if "n" in values:
            return f"Lengths read {1e6 * values['n']:.1f} +- {1e6 * std['n']:.1f} ppm too long."
        share, sigma = values["share"], std["share"]
        said = f"{100 * share:.0f} +- {100 * sigma:.0f} % of the air's refraction is left in the readings."
        doubt = (
            " That is more than there is: are thermometer and barometer beside the beam, in the stated units?"
        )
        return said + (doubt if share - 3 * sigma > MOST else "")


def _raised(up: ca.SX, site: Site, used: Sequence[str]) -> ca.SX:
    """By how much air lifts what is seen ``up`` (rad) over the horizon, rad; below it as much as there."""
    degrees = ca.fmax(up, 0.0) * DEGREES
    arc = (degrees + 7.31 / (degrees + 4.4)) / DEGREES
    pressure = site.driver("pressure") if "pressure" in used else ca.SX(PRESSURE)
    warm = site.driver("temperature.air") if "temperature.air" in used else ca.SX(WARM)
    return (pressure / 1010.0) * (283.0 / (KELVIN + warm)) / ca.tan(arc) / (60.0 * DEGREES)
