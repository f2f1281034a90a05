"""What has no name: a joint, a mount or a sensor that errs as some smooth function of something recorded."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

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
from truepose.models.effects.polynomials import (
    DECAY,
    DEGREE,
    FROM,
    SPATIAL,
    TO,
    WIDTH,
    Exponents,
    Source,
    exponents,
    outside,
    products,
    seen_over,
    series,
    total,
)
from truepose.models.effects.sights import (
    AZIMUTH,
    ELEVATION,
    RANGE,
    XYZ,
    length_names,
    moved_point,
    point_names,
    polar,
    seen_point,
)
from truepose.models.file.driver import TIME, Driver
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.machine.placed import COLUMN, COUNT, POSITIVE, SWITCH, ranges
from truepose.wording import joined

NOTHING = 1e-9
"""Of the largest moment: what is added to its size, whose derivative at zero does not exist."""


def yielding(
    source: Source, moment: Mapping[str, ca.SX], coefficients: Mapping[str, Mapping[int, ca.SX]]
) -> dict[str, ca.SX]:
    """What turns about axes with a moment M (N m) by a characteristic of its size: M_a / M_max (c1 + c2 T1(m) + c3 T2(m)).

    ``source``: the sizes that were seen, up to M_max; m runs from -1 to 1 over them. Past M_max it turns no further.
    """
    size = ca.sqrt(sum((m**2 for m in moment.values()), ca.SX((NOTHING * source.high) ** 2)))
    held = ca.fmin(1.0, source.high / size) / source.high
    t = source.within(size)
    return {
        axis: held * m * series({k - 1: c for k, c in coefficients[axis].items()}, t)
        for axis, m in moment.items()
    }


FINE, CURVE, BOW, LINE = 12, 4, 2, 1
"""Degrees of a curve with corners, of a smooth one, of one that bends one way only, and of a line: a law of few constants has
its like among them, and so has a series."""
MOUNT_CURVE, LOAD_CURVE = 3, 3
"""Degrees of a mount's six motions, and of what yields to a load: its slope, and how that bends to
either side."""
TRAVEL = {"mm": 100.0, "rad": float(np.pi), "turn": 1.0}
"""Half of a joint's travel where its file states no range."""
OF_SIGHT = {f"seen.{name}": name for name in (AZIMUTH, ELEVATION, RANGE)}
"""Sources that an instrument reads of a point itself, by what settings call them."""
OF_WEIGHT = LOAD, MOMENT = "load", "moment"
"""Sources that no column holds: gravity's load at the place itself, N along a length, N m about an angle (at a mount, about
each axis its own), and the size of the moment on a mount."""


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
        if not number or not (key in (DEGREE, SPATIAL, WIDTH) or key.startswith((FROM, TO))):
            raise InputError(
                f"{where}: found {key}: {value!r}, expected numbers {FROM}NAME and {TO}NAME for each source, {DEGREE}, "
                f"and {SPATIAL}"
            )
    names = dict.fromkeys(key.partition(".")[2] for key in settings if key not in (DEGREE, SPATIAL, WIDTH))
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
    sensor, others = place[0] in sensor_names(machine), [name for name in names if name not in OF_SIGHT]
    if sensor and (others or len(out) > 1 or not _looks(machine, place, out[0].name)):
        known = joined(list(OF_SIGHT))
        raise InputError(
            f"{where}: found {joined(list(names))}, expected one that this sensor reads, of {known}"
        )
    if not sensor and len(others) < len(out):
        raise InputError(f"{where}: found sources {joined(list(names))}, expected none of a sensor")
    if settings.get(SPATIAL) and (
        sensor or place[0] in FRAMES or machine.motion(place[0], "x") not in machine.ports
    ):
        raise InputError(f"{where}: found {SPATIAL}: 1, expected a joint that moves a body")
    if len(out) > 1 and place[0] in FRAMES and {*OF_WEIGHT} & {*names}:
        raise InputError(f"{where}: found sources {joined(list(names))}, expected the load of a mount alone")
    return tuple(out)


def degree_of(settings: Settings, usual: int) -> int:
    """Of the polynomial. Raises InputError where it is no whole number."""
    degree = settings.get(DEGREE, usual)
    if degree < 1 or degree != round(degree):
        raise InputError(f"effect empirical: found {DEGREE}: {degree}, expected a whole number from 1 on")
    return round(degree)


LARGEST, ARM = 100.0, 100.0
"""Largest size to expect of a length, in the finest sigma that the machine is read with, and how far from its axis it is, mm,
where an angle makes it."""
LINES = 0.5
"""How likely a line is beside a curve."""
REACH = 1000.0
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
    It is a polynomial of its sources, in products of Chebyshev polynomials of a total degree up to ``degree`` (4; 3 for a
    mount); of two sources without a ``degree``, the product of both alone. A joint errs in its own
    displacement, or with ``spatial`` in all six motions of what it drives; a mount errs in six motions, a sensor in
    what it reads of a point (``seen.azimuth``, ``seen.elevation``, ``seen.range``, the largest
    range being ``reach``, mm) by a curve in that alone. A sensor of points without sources bends its volume by squares and
    products of a point's coordinates, in units of ``reach``. A sensor errs by no more than its maker's sigma is expected:
    what is larger, the robot does.
    Outside of what was seen nothing is known: the form stays at its end's value, and predictions say how little that means
    (``truepose.identification.prediction.predict``). No diagnosis takes it for a name.
    """

    slug = "empirical"
    setting_ranges = ranges(
        {"degree": COUNT, "spatial": SWITCH, "reach": POSITIVE, "from.": COLUMN, "to.": COLUMN}
    )
    title = "A smooth error without a name"
    sentence = (
        "Something at {0} errs smoothly with what is recorded; no physics with a name was found for it."
    )
    formula = (
        "sum of c_jk T_j(t) T_k(u) ..., t and u the sources from -1 to 1; points: x.xy x y / reach^2 ..."
    )
    size = "whatever the data ask for; it has no physics that would limit it"
    look_alikes = ("transmission-error", "axis-straightness", "thermal-expansion", "mount-drift")
    experiment = (
        "move its source alone, beyond the range seen, in small steps: the form tells what to think of"
    )
    source = "Chebyshev series of a smooth error, as machine tools are compensated by tables"

    def places(self, machine: Machine) -> Sequence[Place]:
        """Every joint, both mounts, sensors of lengths."""
        lengths = sensors_where(machine, lambda sensor: bool(point_names(sensor) or length_names(sensor)))
        return [*singly((*machine.mechanism.readings, *FRAMES)), *lengths]

    def screened(self, machine: Machine, place: Place) -> bool:
        """Never by its name: which forms a recording supports is asked elsewhere."""
        return False

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Over the joints' whole travel, and what drivers the file names; what recordings saw: ``empirical_forms``."""
        if place[0] in sensor_names(machine):
            points = point_names(sensor_at(machine, place[0]))
            return ({WIDTH: REACH} if points else seen_over({f"seen.{RANGE}": (0.0, REACH)}, BOW),)
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
        """One for each motion and product of polynomials."""
        if _warps(machine, place, settings):
            largest = _largest(machine, place, "mm", settings)
            return tuple(Coefficient(f"{axis}.{pair}", "mm", largest) for axis in XYZ for pair in WARP)
        alone = DEGREE not in settings and len(sources_of(machine, place, settings)) > 1
        out = list[Coefficient]()
        for powers_of in _exponents(machine, place, settings):
            for label, port in self.moved_ports(machine, place, settings).items():
                unit = machine.ports[port].unit if port else _sight_unit(settings)
                name = label if alone else f"{label}{'.'.join(map(str, powers_of))}"
                largest = _largest(machine, place, unit, settings)
                out.append(Coefficient(name, unit, largest / sum(powers_of) ** DECAY))
        return tuple(out)

    def moved_ports(self, machine: Machine, place: Place, settings: Settings) -> dict[str, str]:
        """What errs at a place, by the name of its coefficients: a displacement, six motions, or what is read of a point."""
        name = place[0]
        if name in sensor_names(machine):
            return {"c": ""}
        if name in FRAMES:
            axes = TURNS if self.reads_load(settings) else AXES
            return {axis: f"{name}.motion.{axis}" for axis in axes}
        if settings.get(SPATIAL):
            return {axis: machine.motion(name, axis) for axis in AXES}
        return {"c": machine.mechanism.actuator(name).displacement}

    def weight(self, settings: Settings) -> float:
        """Lines are what effects with a name are, too."""
        return LINES if settings.get(DEGREE) == LINE else 1.0

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        """The sources that are columns and no joints."""
        if _warps(machine, place, settings):
            return ()
        names = [source.name for source in sources_of(machine, place, settings)]
        known = (*machine.mechanism.readings, *OF_WEIGHT, *OF_SIGHT)
        return tuple(name for name in names if name not in known)

    def reads_load(self, settings: Settings) -> bool:
        """Where the place's own load is a source."""
        return any(f"{FROM}{name}" in settings for name in OF_WEIGHT)

    def driver_kind(self, machine: Machine, place: Place, settings: Settings) -> DriverKind:
        """Kind of driver of its first source that is no joint, else the joint's own position, else another joint."""
        return self.driver_kinds(machine, place, settings)[0]

    def driver_kinds(self, machine: Machine, place: Place, settings: Settings) -> tuple[DriverKind, ...]:
        """Kinds of all its sources, each once; the joint's own position goes without saying beside others."""
        if _warps(machine, place, settings):
            return ("sensor",)
        names = [source.name for source in sources_of(machine, place, settings)]
        out: list[DriverKind] = ["load"] if self.reads_load(settings) else []
        others = self.drivers(machine, place, settings)
        out += [kind for kind in map(machine.drives, others) if kind is not None]
        other: DriverKind = "sensor" if place[0] in sensor_names(machine) else "coupling"
        out += [other] if {*names} & {*machine.mechanism.readings, *OF_SIGHT} - {place[0]} else []
        return tuple(dict.fromkeys(out)) or ("position",)

    def shifts(self, site: Site) -> Shifts:
        """Products of Chebyshev polynomials of the sources; squares and products of coordinates."""
        machine, place, settings = site.machine, site.place, site.settings
        if _warps(machine, place, settings):
            return _warp(site)
        sources = sources_of(machine, place, settings)
        if _of_sight(settings):
            return _sighted(site, sources[0])
        ports = self.moved_ports(machine, place, settings)
        (first, *_), wanted = sources, _exponents(machine, place, settings)
        amplitudes = dict(zip(((e, label) for e in wanted for label in ports), site.c.values(), strict=True))
        if first.name == MOMENT:
            moment = {axis: site.load(port) for axis, port in ports.items()}
            curves = {axis: {sum(e): amplitudes[e, axis] for e in wanted} for axis in ports}
            turned = yielding(first, moment, curves)
            return {ports[axis]: turn for axis, turn in turned.items()}
        shifts: dict[str, ca.SX] = {}
        for label, port in ports.items():
            at = [source.within(_value(site, source.name, port)) for source in sources]
            functions = products(at, wanted)
            shifts[port] = total(amplitudes[e, label] * f for e, f in zip(wanted, functions, strict=True))
        return shifts

    def overshoot(
        self, machine: Machine, place: Place, settings: Settings, at: Mapping[str, Array]
    ) -> Array | None:
        """(n,) how far rows lie outside of what was seen: halves of a source's range, or shares of the reach.

        A polynomial of degree k leaves its range k^2 times as steeply as a line. None for curves of a load, which no column
        holds: how far poses and payload lie outside tells it.
        """
        if self.reads_load(settings) or _of_sight(settings):
            return None
        if not _warps(machine, place, settings):
            steep = max(max(e) for e in _exponents(machine, place, settings)) ** 2
            sources = sources_of(machine, place, settings)
            return np.asarray(steep * np.sum([s.overshoot(at[s.name]) for s in sources], axis=0))
        names = [f"{p}{a}" for p in point_names(sensor_at(machine, place[0])) for a in XYZ]
        reach = settings.get(WIDTH, REACH)
        return np.asarray(np.max([outside(at[name] / reach) for name in names], axis=0))

    def told(self, settings: Settings) -> str:
        """The sources, and how far it goes: ranges are long, and terms of one place and sources are one term."""
        names = "".join(f",{key.removeprefix(FROM)}" for key in sorted(settings) if key.startswith(FROM))
        line = ",line" if settings.get(DEGREE) == LINE else ""
        told = names.count(",") > 1 or settings.get(DEGREE) in (BOW, FINE)
        degree = f",{settings[DEGREE]:g}" if told and DEGREE in settings and not line else ""
        return names + line + degree + (",spatial" if settings.get(SPATIAL) else "")

    def describe(self, settings: Settings) -> tuple[str, str]:
        """Driver (``q1 and q2`` for two) and kind of form: curve, product or warp."""
        names = [key.removeprefix(FROM) for key in settings if key.startswith(FROM)]
        if not names:
            return "position", "warp"
        if len(names) > 1:
            return joined(names), "product"
        return joined(names), "line" if settings.get(DEGREE) == LINE else "curve"


def _of_sight(settings: Settings) -> bool:
    """Whether a source is what an instrument reads of a point."""
    return any(f"{FROM}{name}" in settings for name in OF_SIGHT)


def _looks(machine: Machine, place: Place, name: str) -> bool:
    """Whether a sensor reads points, or lengths where a range is meant."""
    sensor = sensor_at(machine, place[0])
    return bool(point_names(sensor) or (OF_SIGHT[name] == RANGE and length_names(sensor)))


def _sight_unit(settings: Settings) -> str:
    return "mm" if f"{FROM}seen.{RANGE}" in settings else "rad"


def _sighted(site: Site, source: Source) -> Shifts:
    """Points and lengths that are off along what the instrument reads of them, by a curve in that."""
    sensor, curve, shifts = sensor_at(site.machine, site.place[0]), _of("c", site), dict[str, ca.SX]()
    for name in point_names(sensor):
        value, moved = polar(seen_point(site, name))[OF_SIGHT[source.name]]
        shifts |= moved_point(name, series(curve, source.within(value)) * moved)
    for column in length_names(sensor) if OF_SIGHT[source.name] == RANGE else ():
        shifts[f"{column}.reading"] = series(curve, source.within(site.seen(column)))
    return shifts


def _of(stem: str, site: Site) -> dict[int, ca.SX]:
    """Coefficients ``stem1``, ``stem2`` ... by their number."""
    return {int(name.removeprefix(stem)): c for name, c in site.c.items()}


def _warps(machine: Machine, place: Place, settings: Settings) -> bool:
    """Whether it is a sensor's volume that bends: one without sources."""
    return place[0] in sensor_names(machine) and not any(key.startswith(FROM) for key in settings)


def _exponents(machine: Machine, place: Place, settings: Settings) -> list[Exponents]:
    """Products of polynomials that the settings mean."""
    count = len(sources_of(machine, place, settings))
    if count > 1 and DEGREE not in settings:
        return [(1,) * count]
    return exponents(count, degree_of(settings, MOUNT_CURVE if place[0] in FRAMES else CURVE))


def largest_sizes(machine: Machine) -> dict[str, float]:
    """Largest size to expect of what has no name, mm and rad: it is known by what the sensors see of it."""
    channels = [c for sensor in machine.sensors for c in sensor.channels]
    lengths = [c.sigma for c in channels if c.unit == "mm"] or [ARM * c.sigma for c in channels] or [0.01]
    return {"mm": LARGEST * min(lengths), "rad": LARGEST * min(lengths) / ARM}


def _largest(machine: Machine, place: Place, unit: str, settings: Settings) -> float:
    """Largest size to expect, mm or rad: of a volume that bends the sensor's sigma."""
    if place[0] not in sensor_names(machine):
        return largest_sizes(machine)[unit]
    channels = sensor_at(machine, place[0]).channels
    sigma = max([c.sigma for c in channels if c.unit == "mm"] or [c.sigma for c in channels])
    if _warps(machine, place, settings):
        return sigma
    return LARGEST * sigma / (settings.get(WIDTH, REACH) if unit == "rad" else 1.0)


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


def _value(site: Site, source: str, port: str) -> ca.SX:
    """A source: a reading, the load at a mount's port or at a joint's own, or a driver."""
    if source == LOAD:
        own = site.place[0] in FRAMES
        return site.load(port if own else site.port(site.place[0]))
    return site.q[source] if source in site.q else site.driver(source)
