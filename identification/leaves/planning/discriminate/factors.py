"""What an experiment may vary beside the joints: payload, temperatures, sides of approach, time, sessions, speeds.

A factor is a driver of the recording with the levels it may be set to. What explanations read and nobody offered
stays at its nominal value; a usual span of it says what offering it would bring.

Further targets on the tool body: machines that have them, to see what measuring them would bring.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.identifiability.note import Note
from truepose.models.effects.base import PlacedEffect
from truepose.models.file.driver import (
    AIR,
    APPROACH,
    OF_THE_WAY,
    PAYLOAD,
    SESSION,
    STEP,
    TEMPERATURE,
    TIME,
    VELOCITY,
    Driver,
)
from truepose.models.machine.kinematics import driver_default
from truepose.models.machine.machine import Machine
from truepose.models.machine.parameters import Parameter
from truepose.models.sensors.base import Sensor
from truepose.models.sensors.pose import Pose
from truepose.models.sensors.targets import Targets
from truepose.models.units import convert
from truepose.wording import close_matches

SIDES = (1.0, -1.0)
HOURS = (0.0, 0.5, 1.0, 1.5, 2.0)
SESSIONS = (1.0, 2.0)
WARMER, USUAL_PAYLOAD = 5.0, 5.0
USUAL_WEATHER = {"pressure": (983.25, 1013.25, 1043.25), "humidity": (30.0, 50.0, 70.0)}
MOST = 24
"""Settings of the factors that are tried at one pose; of more, some are drawn."""


@dataclass(frozen=True)
class Factor:
    """A driver that may be set. levels: internal units (kg, degC, s, hPa, mm/s or rad/s); session: its number.

    nominal: the level that it has where it is not varied. offered: whether the experiment may vary it.
    """

    driver: str
    levels: tuple[float, ...]
    nominal: float
    offered: bool


@dataclass(frozen=True)
class Offer:
    """What the user can vary: levels by driver, as ``payload``, ``temperature.leg1``, ``velocity.q2``."""

    levels: Mapping[str, tuple[float, ...]]

    @classmethod
    def of(cls, machine: Machine, payload: str = "", named: Sequence[str] = ()) -> Offer:
        """From ``0,2.5,5`` kg and texts such as ``temperature.leg1=15,20,30``. Raises InputError for bad levels."""
        levels = {PAYLOAD: _numbers(payload, "--payload")} if payload else {}
        for text in named:
            driver, equals, values = text.partition("=")
            driver = driver.strip()
            _check_driver(machine, driver, text, bool(equals))
            levels[driver] = _numbers(values, text)
        return cls(levels)


def factors(machine: Machine, parts: Iterable[PlacedEffect], offer: Offer) -> tuple[Factor, ...]:
    """Every driver that the explanations read: offered, automatic (sides, time, sessions) or left at nominal.

    Levels that nobody reads are left out: they could not help.
    """
    out, parts = {}, tuple(parts)
    for driver in _read(machine, parts, offer):
        nominal = driver_default(machine, driver, parts)
        levels = offer.levels.get(Driver.of(driver).served_by(offer.levels))
        automatic = _automatic(driver, nominal)
        if levels is not None:
            # held still, it stays at the level closest to what the machine file means
            nominal = min(levels, key=lambda level: abs(level - nominal))
            out[driver] = Factor(driver, levels, nominal, len(levels) > 1)
        elif automatic:
            out[driver] = Factor(driver, automatic, automatic[0], True)
        elif span := _usual(machine, driver):
            out[driver] = Factor(driver, span, nominal, False)
    return tuple(out.values())


def settings(varied: Sequence[Factor], rng: np.random.Generator) -> Array:
    """(s, f) settings of the factors to try at a pose: all, or the extreme ones and others at random."""
    combined = list(product(*(factor.levels for factor in varied)))
    every = np.array(combined, dtype=float).reshape(len(combined), len(varied))
    if len(every) <= MOST:
        return every
    still = [factor.nominal for factor in varied]
    nominal = np.flatnonzero(np.all(every == still, axis=1))
    ends = np.array([[min(f.levels), max(f.levels)] for f in varied]).T
    extreme = np.flatnonzero(np.all((every == ends[0]) | (every == ends[1]), axis=1))
    first = np.concatenate([nominal, rng.permutation(extreme)])[: MOST // 2]
    others = np.setdiff1d(np.arange(len(every)), first)
    return np.asarray(every[np.concatenate([first, rng.choice(others, MOST - len(first), replace=False)])])


def _read(machine: Machine, parts: Iterable[PlacedEffect], offer: Offer) -> list[str]:
    """Drivers that the explanations read, payload and measured forces where they ask for loads that they can change."""
    names: list[str] = []
    for part in parts:
        names += [_column(name) for name in part.drivers]
        if part.needs_load and machine.loaded:
            names += [PAYLOAD, *machine.force_columns]
    if AIR in offer.levels:  # one thermometer, whatever it stands for
        names = [Driver.of(name).served_by(offer.levels) for name in names]
    return list(dict.fromkeys(names))


def _column(name: str) -> str:
    """What has to be varied for a driver: the side of approach for what a joint's way leaves behind."""
    driver = Driver.of(name)
    if driver.kind in OF_THE_WAY:
        return Driver(APPROACH, driver.place).name
    return SESSION if driver.kind == SESSION else driver.now.name


def unplanned(parts: Iterable[PlacedEffect]) -> list[Note]:
    """What rows of an experiment do not vary although an explanation depends on it."""
    kinds = {part.effect.slug: {Driver.of(name).kind for name in part.drivers} for part in parts}
    short = [slug for slug, read in kinds.items() if read & set(OF_THE_WAY)]
    creeping = [slug for slug, read in kinds.items() if "creep" in read]
    moving = [slug for slug, read in kinds.items() if STEP in read]
    strokes, creep = [Note("strokes", slug) for slug in short], [Note("creep", slug) for slug in creeping]
    return [*strokes, *creep, *(Note("motions", slug) for slug in moving)]


def _automatic(driver: str, nominal: float) -> tuple[float, ...]:
    if Driver.of(driver).kind == APPROACH:
        return SIDES
    if driver == TIME:
        return tuple(nominal + 3600.0 * h for h in HOURS)
    return SESSIONS if driver == SESSION else ()


def _usual(machine: Machine, name: str) -> tuple[float, ...]:
    """A usual span of a driver that was not offered, its nominal level first; empty where nobody can say."""
    driver, nominal = Driver.of(name), driver_default(machine, name)
    if name == PAYLOAD:
        return (0.0, nominal or USUAL_PAYLOAD)
    if driver.thermal:
        return (nominal, nominal + WARMER)
    if driver.kind == VELOCITY:
        low, high = machine.mechanism.actuator(driver.place).range or (0.0, 0.0)
        return (nominal, (high - low) / 10.0) if high > low else ()
    return USUAL_WEATHER.get(name, ())


def _check_driver(machine: Machine, driver: str, text: str, complete: bool) -> None:
    known = [*USUAL_WEATHER, *(Driver(VELOCITY, joint).name for joint in machine.mechanism.readings), AIR]
    known += [Driver(TEMPERATURE, part).name for part in (*machine.mechanism.lengths, "tool")]
    known += machine.force_columns
    if not complete or (driver not in known and not Driver.of(driver).thermal):
        raise InputError(
            f"{text!r}: expected DRIVER=value,value,... such as temperature.leg1=15,20,30; "
            f"{close_matches(driver, known)}"
        )


def _numbers(text: str, where: str) -> tuple[float, ...]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not values or not np.isfinite(values).all():
        raise InputError(f"{where}: found {text!r}, expected numbers with commas between, such as 0,2.5,5")
    if where == "--payload" and min(values) < 0.0:
        raise InputError(f"{where}: found {min(values):g} kg, expected masses that are not negative")
    return tuple(sorted(set(values)))


_AXES = "xyz"


@dataclass(frozen=True)
class Target:
    """A point (x, y, z) of the tool frame, mm."""

    name: str
    point: tuple[float, float, float]

    @classmethod
    def of(cls, text: str, machine: Machine) -> Target:
        """``NAME=x,y,z`` in the length unit of the machine file. Raises InputError for anything else."""
        name, _, rest = (part.strip() for part in text.partition("="))
        units = machine.units
        try:
            x, y, z = (convert(float(part), units.length, "mm") for part in rest.split(","))
        except ValueError:
            raise InputError(f"--target {text}: expected NAME=x,y,z such as T1=150,0,20") from None
        if not name or f"{name}.x" in machine.geometry:
            raise InputError(f"--target {text}: found the name {name!r}, expected one that is not taken")
        return cls(name, (x, y, z))


def with_targets(machine: Machine, targets: Sequence[Target]) -> Machine:
    """The machine with these points read as well: as precisely as its points, or its position, and as well known.

    Raises InputError where the machine's sensors read neither points nor poses.
    """
    for k, sensor in enumerate(machine.sensors):
        if isinstance(sensor, Targets):
            tolerance = sensor.points[0].tolerance
            more = replace(sensor, points=(*sensor.points, *_parameters(targets, tolerance)))
            return replace(machine, sensors=(*machine.sensors[:k], more, *machine.sensors[k + 1 :]))
    for sensor in machine.sensors:
        if isinstance(sensor, Pose):
            sigma = next(c.sigma for c in sensor.channels if c.kind == "position")
            known = machine.file.tolerances.length if machine.file else 0.0
            points: Sensor = Targets(_parameters(targets, known), sigma)
            return replace(machine, sensors=(*machine.sensors, points))
    found = ", ".join(sensor.type for sensor in machine.sensors)
    raise InputError(f"--target: found the sensor {found}, expected `targets` or `pose`")


def _parameters(targets: Sequence[Target], tolerance: float) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{target.name}.{axis}", "mm", target.point[k], tolerance, "target")
        for target in targets
        for k, axis in enumerate(_AXES)
    )
