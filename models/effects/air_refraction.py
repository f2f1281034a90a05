"""Light that travels more slowly in dense air, read as a length that grew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import sensor_at, sensors_where
from truepose.models.effects.sights import optical, stretched
from truepose.models.effects.thermometers import borrowed, from_settings, others
from truepose.models.machine import Machine

Array = NDArray[np.float64]
REFRACTIVITY = 2.7e-4
"""n - 1 of dry air at 20 degC and 1013.25 hPa: 2.72e-4 at 633 nm, 2.69e-4 at 1550 nm."""
KELVIN, WARM, PRESSURE = 273.15, 20.0, 1013.25
MOST = 1.5
"""Share with some room above 1: the thermometer is not in the beam."""
MOST_ELSEWHERE = 5.0
"""The same where the thermometer is beside a part of the machine: the air may vary more than that part."""
LARGEST_STRAIN = 1e-4
"""What weather can do to a length: 50 K (46 ppm) and 200 hPa (54 ppm) from 20 degC and 1013.25 hPa."""
NO_WEATHER = 0.2
"""How likely refraction is where nobody logged the weather: it is then the same as a scale of the sensor. Chosen."""
LOGGED = {"temperature": "temperature.air", "pressure": "pressure"}


@effects.add("air-refraction")
class AirRefraction(Effect):
    """A share of the refraction of air that the sensor does not correct: 1 for an instrument that knows no weather.

    Settings ``temperature`` and ``pressure``: 1 where that driver is left uncorrected, 0 where it is not. The path
    is the whole length that is seen, dead path included; of points, their range from the sensor frame's origin. ``from.COLUMN``
    (degC): a thermometer elsewhere stands in for that of the air, and counts from that value. Where nothing of the weather is
    read it stands still, and stretches every path by the same share ``n``.
    """

    slug = "air-refraction"
    driven_by = "sensor"
    title = "Refraction of air that is not corrected"
    formula = "reading + share (n - n0) L, n - 1 = 2.7e-4 p / 1013.25 hPa * 293.15 K / T, n0 at 20 degC and 1013.25 hPa"
    size = "-0.92 ppm/K and +0.27 ppm/hPa of the whole path"
    look_alikes = ("sensor-scale", "thermal-expansion", "mount-drift")
    experiment = "watch a fixed target for a day with thermometer and barometer beside the beam"
    source = "Ciddor 1996, Appl. Opt. 35, 1566 (standard air at 15 degC), with the density of an ideal gas"

    def places(self, machine: Machine) -> Sequence[Place]:
        return sensors_where(machine, optical)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if not any(settings.get(name, 1.0) for name in LOGGED):
            return (Coefficient("n", "1", LARGEST_STRAIN / 3, -LARGEST_STRAIN, LARGEST_STRAIN),)
        return (Coefficient("share", "1", 1.0, 0.0, MOST_ELSEWHERE if self.borrows(settings) else MOST),)

    def shifts(self, site: Site) -> Shifts:
        if "n" in site.c:
            return stretched(site, sensor_at(site.machine, site.place[0]), site.c["n"])
        used = self.drivers(site.machine, site.place, site.settings)
        air = {name: site.driver(name) for name in used}
        column, start = borrowed(site.settings) or (LOGGED["temperature"], WARM)
        density = air.get("pressure", ca.SX(PRESSURE)) / PRESSURE
        density *= (start + KELVIN) / (air.get(column, ca.SX(start)) + KELVIN)
        strain = site.c["share"] * REFRACTIVITY * (density - 1.0)
        return stretched(site, sensor_at(site.machine, site.place[0]), strain)

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        elsewhere = borrowed(settings)
        columns = LOGGED if elsewhere is None else LOGGED | {"temperature": elsewhere[0]}
        return tuple(driver for name, driver in columns.items() if settings.get(name, 1.0))

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """What was logged: all of it uncorrected, or one of the two."""
        logged = [name for name, driver in LOGGED.items() if recording.driver(driver) is not None]
        single = [{name: float(name == one) for name in LOGGED} for one in logged]
        return single if len(logged) == 1 else [dict.fromkeys(LOGGED, 1.0), *single]

    def elsewhere(self, machine: Machine, place: Place, seen: Mapping[str, Array]) -> Sequence[Settings]:
        """Without the air's own temperature: any other, alone or with pressure; and weather that stands still."""
        if LOGGED["temperature"] in seen:
            return []
        still = dict.fromkeys(LOGGED, 0.0)
        proxies = [from_settings(name, seen) for name in others(machine, [], seen)]
        return [
            *({"temperature": 1.0, "pressure": p, **proxy} for proxy in proxies for p in (0.0, 1.0)),
            still,
        ]

    def borrows(self, settings: Settings) -> bool:
        return borrowed(settings) is not None or not any(settings.get(name, 1.0) for name in LOGGED)

    def weight(self, settings: Settings) -> float:
        if not any(settings.get(name, 1.0) for name in LOGGED):
            return NO_WEATHER
        return 1.0 if all(settings.get(name, 1.0) for name in LOGGED) else 0.5

    def explain(self, machine: Machine, place: Place) -> str:
        kind = sensor_at(machine, place[0]).type
        return f"The sensor {kind} looks through air whose refraction changes with the weather and is not corrected."

    def explain_term(self, machine: Machine, place: Place, settings: Settings) -> str:
        elsewhere = borrowed(settings)
        if elsewhere is not None:
            return f"{self.explain(machine, place)} Its temperature is taken from {elsewhere[0]}."
        if self.borrows(settings):
            kind = sensor_at(machine, place[0]).type
            return (
                f"The sensor {kind} reads all paths too long or too short by one share, as air does whose refraction is not "
                "corrected; nobody logged its temperature or pressure, so a wrong scale looks the same."
            )
        return self.explain(machine, place)

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        if "n" in values:
            return f"Lengths read {1e6 * values['n']:.1f} +- {1e6 * std['n']:.1f} ppm too long."
        share, sigma = values["share"], std["share"]
        said = f"{100 * share:.0f} +- {100 * sigma:.0f} % of the air's refraction is left in the readings."
        doubt = (
            " That is more than there is: are thermometer and barometer beside the beam, in the stated units?"
        )
        return said + (doubt if share - 3 * sigma > MOST else "")
