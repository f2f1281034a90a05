"""What a smooth form without a name is a function of, and over which range: the settings of ``empirical``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truepose.errors import InputError
from truepose.models.effects.base import Place, Settings
from truepose.models.effects.common import SECONDS_PER_HOUR
from truepose.models.effects.curves import Source
from truepose.models.file.driver import TIME, Driver
from truepose.models.machine.machine import FRAMES, Machine
from truepose.wording import joined

CURVE, LINE = 4, 1
MOUNT_CURVE, LOAD_CURVE = 2, 3
"""Degrees of a mount's six motions, and of what yields to a load: its slope, and how that bends to either side."""
TRAVEL = {"mm": 100.0, "rad": float(np.pi), "turn": 1.0}
"""Half of a joint's travel where its file states no range."""
FROM, TO, DEGREE = "from.", "to.", "degree"
OF_WEIGHT = LOAD, MOMENT = "load", "moment"
"""Sources that no column holds: gravity's load at the place itself, N along a length, N m about an angle (at a mount, about
each axis its own), and the size of the moment on a mount."""


def seen_over(ranges: Mapping[str, tuple[float, float]], degree: int | None = None) -> dict[str, float]:
    """Settings of a form in the sources of ``ranges``, lowest and highest value seen (mm, rad, or the driver's unit)."""
    own = {} if degree is None else {DEGREE: float(degree)}
    lows = {f"{FROM}{name}": float(low) for name, (low, _) in ranges.items()}
    return own | lows | {f"{TO}{name}": float(high) for name, (_, high) in ranges.items()}


def _usual(machine: Machine, place: Place) -> dict[str, float]:
    """What a place without settings means: a joint in its own reading, a mount in the course of time."""
    if place[0] in FRAMES:
        return seen_over({TIME: usual_range(TIME)}, MOUNT_CURVE)
    return seen_over({place[0]: travel_of(machine, place[0])}, CURVE)


def usual_range(driver: str) -> tuple[float, float]:
    """An hour, or ten units of a driver from its default on."""
    low = Driver.of(driver).default
    return low, low + (SECONDS_PER_HOUR if driver == TIME else 10.0)


def travel_of(machine: Machine, reading: str) -> tuple[float, float]:
    """Lowest and highest value of a joint's reading."""
    actuator = machine.mechanism.actuator(reading)
    half = TRAVEL.get(actuator.reading_unit, 1.0)
    return actuator.range or (-half, half)


def sources_of(machine: Machine, place: Place, settings: Settings) -> tuple[Source, ...]:
    """What the settings say it is a function of. Raises InputError where they do not say it well."""
    where = f"{machine.name}: effect empirical at {place[0]}"
    if not any(key.startswith((FROM, TO)) for key in settings):
        settings = {**_usual(machine, place), **settings}
    for key, value in settings.items():
        number = isinstance(value, (int, float)) and not isinstance(value, bool) and np.isfinite(value)
        if not number or not (key == DEGREE or key.startswith((FROM, TO))):
            raise InputError(
                f"{where}: found {key}: {value!r}, expected numbers {FROM}NAME and {TO}NAME for each source, and {DEGREE}"
            )
    names = dict.fromkeys(key.partition(".")[2] for key in settings if key != DEGREE)
    out = []
    for name in names:
        low, high = (settings.get(f"{end}{name}") for end in (FROM, TO))
        if low is None or high is None or not low < high:
            raise InputError(
                f"{where}: found {FROM}{name}: {low} and {TO}{name}: {high}, expected two numbers, the first smaller"
            )
        out.append(Source(name, low, high))
    if MOMENT in names and place[0] not in FRAMES:
        raise InputError(f"{where}: found source {MOMENT}, expected {LOAD}: only a mount has a moment")
    most = 1 if place[0] in FRAMES else 2
    if len(out) > most:
        raise InputError(
            f"{where}: found sources {joined(list(names))}, expected {'one' if most == 1 else 'one or two'}"
        )
    return tuple(out)


def degree_of(settings: Settings, usual: int) -> int:
    """Of the polynomial. Raises InputError where it is no whole number."""
    degree = settings.get(DEGREE, usual)
    if degree < 1 or degree != round(degree):
        raise InputError(f"effect empirical: found {DEGREE}: {degree}, expected a whole number from 1 on")
    return round(degree)


__all__ = [
    "CURVE", "DEGREE", "FROM", "LINE", "LOAD", "LOAD_CURVE", "MOMENT", "MOUNT_CURVE", "OF_WEIGHT", "degree_of", "seen_over",
    "sources_of", "travel_of", "usual_range",
]  # fmt: skip
