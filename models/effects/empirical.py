"""What has no name: a joint, a mount or a sensor that errs as some smooth function of something recorded."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.effects.base import (
    Coefficient,
    DriverKind,
    Effect,
    Observed,
    Place,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.effects.common import SECONDS_PER_HOUR, sensor_at, sensor_names, sensors_where, singly
from truepose.models.effects.sights import XYZ, moved_point, point_names, seen_point
from truepose.models.file.driver import TIME, Driver
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.mechanism import AXES, AXIS_UNITS
from truepose.models.machine.placed import COLUMN, COUNT, POSITIVE, ranges
from truepose.wording import joined


def scaled(values: Array, low: float, high: float) -> Array:
    """(n,) values moved and stretched so that ``low`` is -1 and ``high``, which is above it, is 1."""
    return 2 * (values - low) / (high - low) - 1


def chebyshev(t: Any, degree: int) -> list[Any]:
    """T_0(t) to T_degree(t) of numbers (n,) in -1 ... 1, or of a CasADi expression; T_0 is the number 1."""
    found = [1, t]
    for _ in range(2, degree + 1):
        found.append(2 * t * found[-1] - found[-2])
    return found[: degree + 1]


def powers(t: Array, degree: int) -> list[Array]:
    """(n,) each: t, t^2 to t^degree."""
    return [t**k for k in range(1, degree + 1)]


def waves(t: Array, cycles: int) -> list[Array]:
    """(n,) each: sine and cosine of so many cycles over -1 ... 1."""
    phase = np.pi * cycles * t
    return [np.sin(phase), np.cos(phase)]


def orthonormal(functions: Sequence[Array]) -> Array:
    """(n, k) orthonormal columns that span the k functions (n,) less their means, in their order."""
    basis, _ = np.linalg.qr(np.column_stack([np.ones(len(functions[0])), *functions]))
    return np.asarray(basis[:, 1:])


LINE_END = 2.0
"""Where a line ends, in halves of the range seen: most that is linear goes on, but not for ever."""
NOTHING = 1e-9
"""Of the largest moment: what is added to its size, whose derivative at zero does not exist."""


@dataclass(frozen=True)
class Source:
    """A reading, a driver or the place's load that a form is a function of, and the range in which it was seen."""

    name: str
    low: float
    high: float

    def within(self, value: ca.SX, end: float = 1.0) -> ca.SX:
        """The value scaled to -1 ... 1 over the range (an operation less than ``scaled``, for the controller), and held at
        -``end`` and ``end`` outside of it.
        """
        return ca.fmax(-end, ca.fmin(end, (2 * value - (self.low + self.high)) / (self.high - self.low)))

    def overshoot(self, values: Array) -> Array:
        """(n,) how far values lie outside of the range, in halves of it."""
        return outside((2 * values - (self.low + self.high)) / (self.high - self.low))


def series(coefficients: Mapping[int, ca.SX], t: ca.SX) -> ca.SX:
    """Sum of c_k T_k(t), T_k the Chebyshev polynomials."""
    polynomials = chebyshev(t, max(coefficients))
    return total(c * polynomials[k] for k, c in coefficients.items())


def yielding(
    source: Source, moment: Mapping[str, ca.SX], coefficients: Mapping[str, Mapping[int, ca.SX]], end: float
) -> dict[str, ca.SX]:
    """What turns about axes with a moment M (N m) by a characteristic of its size: M_a / M_max (c1 + c2 T1(m) + c3 T2(m)).

    ``source``: the sizes that were seen, up to M_max; m runs from -1 to 1 over them. Past ``end`` M_max it turns no further.
    """
    size = ca.sqrt(sum((m**2 for m in moment.values()), ca.SX((NOTHING * source.high) ** 2)))
    held = ca.fmin(1.0, end * source.high / size) / source.high
    t = source.within(size)
    return {
        axis: held * m * series({k - 1: c for k, c in coefficients[axis].items()}, t)
        for axis, m in moment.items()
    }


def total(terms: Iterable[ca.SX]) -> ca.SX:
    return sum(terms, ca.SX(0))


def outside(scaled: Array) -> Array:
    """How far values that should lie in -1 ... 1 lie outside."""
    return np.maximum(np.abs(scaled) - 1.0, 0.0)


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


LARGEST = {"mm": 1.0, "rad": 0.01}
LINES = 0.5
"""How likely a line is beside a curve."""
REACH = 1000.0
WIDTH = "reach"
WARP = ("xx", "yy", "zz", "xy", "yz", "zx")
"""Squares and products of a point's coordinates: how a measuring volume bends; its linear part is scale and frame."""
TURNS = ("rx", "ry", "rz")
"""Motions of a mount under load: it turns with gravity's moment."""


@effects.add("empirical")
class Empirical(Effect):
    """What has no name: a joint, a mount or a sensor that errs as some smooth function of something recorded.

    A smooth form that no physics was found for; its sources run from -1 to 1 over what was seen, and stop there.

    Settings ``from.NAME`` and ``to.NAME`` say what it is a function of, and over which range (mm, rad, turn, or the
    driver's own unit): a joint's reading, any driver, or ``load``, what gravity exerts at the place (N along a length, N m
    about an angle, at a mount about each axis). ``moment``: a mount turns with its moment, by a curve of how large that is.
    With one source it is a curve, Chebyshev polynomials up to ``degree`` (4; 2 for the six motions of a mount), in the
    joint's own reading from the square on. With two it is their product. A sensor's volume bends by squares and products of
    a point's coordinates, in units of ``reach`` (mm), and by no more than its maker's sigma is expected: what is larger, the
    robot does. Outside of what was seen nothing is known: the form stays at its end's value, a line goes on for half the
    range seen, and predictions say how little that means (``truepose.identification.prediction.predict``). No diagnosis
    takes it for a name.
    """

    slug = "empirical"
    setting_ranges = ranges({"degree": COUNT, "reach": POSITIVE, "from.": COLUMN, "to.": COLUMN})
    title = "A smooth error without a name"
    sentence = (
        "Something at {0} errs smoothly with what is recorded; no physics with a name was found for it."
    )
    formula = (
        "c1 T1(t) + c2 T2(t) + ..., t the source from -1 to 1; c t u of two; points: x.xy x y / reach^2 ..."
    )
    size = "whatever the data ask for; it has no physics that would limit it"
    look_alikes = ("transmission-error", "axis-straightness", "thermal-expansion", "mount-drift")
    experiment = (
        "move its source alone, beyond the range seen, in small steps: the form tells what to think of"
    )
    source = "Chebyshev series of a smooth error, as machine tools are compensated by tables"

    def places(self, machine: Machine) -> Sequence[Place]:
        """Every joint, both mounts, sensors of points."""
        warped = sensors_where(machine, lambda sensor: bool(point_names(sensor)))
        return [*singly((*machine.mechanism.readings, *FRAMES)), *warped]

    def screened(self, machine: Machine, place: Place) -> bool:
        """Never by its name: which forms a recording supports is asked elsewhere."""
        return False

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Over the joints' whole travel, and what drivers the file names; what recordings saw: ``empirical_forms``."""
        if place[0] in sensor_names(machine):
            return ({WIDTH: REACH},)
        of_load = OF_WEIGHT if place[0] in FRAMES else (LOAD,)
        weighs = of_load if machine.loaded else ()
        drivers = {name: usual_range(name) for name in dict.fromkeys((TIME, *machine.drivers, *weighs))}
        if place[0] in FRAMES:
            return [seen_over({name: usual}, MOUNT_CURVE) for name, usual in drivers.items()]
        travel = {name: travel_of(machine, name) for name in machine.mechanism.readings}
        own = {place[0]: travel[place[0]]}
        curves = [seen_over({name: usual}, CURVE) for name, usual in (own | travel | drivers).items()]
        pairs = itertools.combinations(travel, 2)
        return [*curves, *(seen_over({a: travel[a], b: travel[b]}) for a, b in pairs)]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        """One for a product; one a polynomial for a curve, from the square on in the joint's own reading."""
        if place[0] in sensor_names(machine):
            channels = sensor_at(machine, place[0]).channels
            largest = max(c.sigma for c in channels if c.kind == "position")
            return tuple(Coefficient(f"{axis}.{pair}", "mm", largest) for axis in XYZ for pair in WARP)
        sources = sources_of(machine, place, settings)
        if place[0] in FRAMES:
            return tuple(
                Coefficient(f"{axis}{k}", unit, LARGEST[unit] / k)
                for k in range(1, degree_of(settings, MOUNT_CURVE) + 1)
                for axis, unit in AXIS_UNITS.items()
                if axis in TURNS or not self.reads_load(settings)
            )
        unit = machine.mechanism.actuator(place[0]).unit
        if len(sources) == 2:
            return (Coefficient("c", unit, LARGEST[unit]),)
        first = 2 if sources[0].name == place[0] else 1
        degrees = range(first, max(degree_of(settings, CURVE), first) + 1)
        return tuple(Coefficient(f"c{k}", unit, LARGEST[unit] / k) for k in degrees)

    def weight(self, settings: Settings) -> float:
        """Lines are what effects with a name are, too."""
        return LINES if settings.get(DEGREE) == LINE else 1.0

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        """The sources that are columns and no joints."""
        if place[0] in sensor_names(machine):
            return ()
        names = [source.name for source in sources_of(machine, place, settings)]
        return tuple(name for name in names if name not in (*machine.mechanism.readings, *OF_WEIGHT))

    def reads_load(self, settings: Settings) -> bool:
        """Where the place's own load is a source."""
        return any(f"{FROM}{name}" in settings for name in OF_WEIGHT)

    def driver_kind(self, machine: Machine, place: Place, settings: Settings) -> DriverKind:
        """The joint's own position, another joint, or what kind of driver its source is."""
        if place[0] in sensor_names(machine):
            return "sensor"
        names = [source.name for source in sources_of(machine, place, settings)]
        if self.reads_load(settings):
            return "load"
        kinds = (machine.drives(name) for name in names if name not in machine.mechanism.readings)
        own: DriverKind = "position" if names == [place[0]] else "coupling"
        return next((kind for kind in kinds if kind is not None), own)

    def shifts(self, site: Site) -> Shifts:
        """Chebyshev polynomials of one source, or a product of two; squares and products of coordinates."""
        place = site.place[0]
        if place in sensor_names(site.machine):
            return _warp(site)
        sources = sources_of(site.machine, site.place, site.settings)
        end = LINE_END if len(sources) == 1 and site.settings.get(DEGREE) == LINE else 1.0
        if len(sources) == 2:
            t, u = (source.within(_value(site, source.name)) for source in sources)
            return {site.port(place): site.c["c"] * t * u}
        (source,) = sources
        if place not in FRAMES:
            return {site.port(place): series(_of("c", site), source.within(_value(site, source.name), end))}
        ports = {axis: f"{place}.motion.{axis}" for axis in AXES}
        if source.name == LOAD:
            own = {axis: source.within(site.load(ports[axis]), end) for axis in TURNS}
            return {ports[axis]: series(_of(axis, site), t) for axis, t in own.items()}
        if source.name == MOMENT:
            moment = {axis: site.load(ports[axis]) for axis in TURNS}
            turned = yielding(source, moment, {axis: _of(axis, site) for axis in TURNS}, end)
            return {ports[axis]: turn for axis, turn in turned.items()}
        t = source.within(_value(site, source.name), end)
        return {port: series(_of(axis, site), t) for axis, port in ports.items()}

    def overshoot(
        self, machine: Machine, place: Place, settings: Settings, at: Mapping[str, Array]
    ) -> Array | None:
        """(n,) how far rows lie outside of what was seen: halves of a source's range, or shares of the reach.

        A polynomial of degree k leaves its range k^2 times as steeply as a line. None for curves of a load, which no column
        holds: how far poses and payload lie outside tells it.
        """
        if self.reads_load(settings):
            return None
        if place[0] not in sensor_names(machine):
            sources = sources_of(machine, place, settings)
            usual = MOUNT_CURVE if place[0] in FRAMES else CURVE
            steep = degree_of(settings, usual) ** 2 if len(sources) == 1 else 1
            return np.asarray(steep * np.sum([s.overshoot(at[s.name]) for s in sources], axis=0))
        names = [f"{p}{a}" for p in point_names(sensor_at(machine, place[0])) for a in XYZ]
        reach = settings.get(WIDTH, REACH)
        return np.asarray(np.max([outside(at[name] / reach) for name in names], axis=0))

    def told(self, settings: Settings) -> str:
        """The sources, and whether it is a line in them: ranges are long, and terms of one place and source are one term."""
        line = ",line" if settings.get(DEGREE) == LINE else ""
        return (
            "".join(f",{key.removeprefix(FROM)}" for key in sorted(settings) if key.startswith(FROM)) + line
        )

    def describe(self, settings: Settings) -> tuple[str, str]:
        """Driver (``q1 and q2`` for two) and kind of form: curve, product or warp."""
        names = [key.removeprefix(FROM) for key in settings if key.startswith(FROM)]
        if not names:
            return "position", "warp"
        if len(names) == 2:
            return joined(names), "product"
        return joined(names), "line" if settings.get(DEGREE) == LINE else "curve"


def _warp(site: Site) -> Shifts:
    """Each coordinate of each point by squares and products of them, of about 1 at the points' distance."""
    shifts: dict[str, ca.SX] = {}
    reach = site.settings.get(WIDTH, REACH)
    for name in point_names(sensor_at(site.machine, site.place[0])):
        inside = ca.fmax(-1.0, ca.fmin(1.0, seen_point(site, name) / reach))
        at = dict(zip(XYZ, ca.vertsplit(inside), strict=True))
        moved = [total(site.c[f"{a}.{b}"] * at[b[0]] * at[b[1]] for b in WARP) for a in XYZ]
        shifts |= moved_point(name, ca.vertcat(*moved))
    return shifts


def _value(site: Site, source: str) -> ca.SX:
    """A source at a joint: a reading, the load at it, or a driver."""
    if source == LOAD:
        return site.load(site.port(site.place[0]))
    return site.q[source] if source in site.q else site.driver(source)


def _of(stem: str, site: Site) -> dict[int, ca.SX]:
    """Coefficients ``stem1``, ``stem2`` ... by their number."""
    return {int(n.removeprefix(stem)): c for n, c in site.c.items() if n.rstrip("0123456789") == stem}
