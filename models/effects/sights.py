"""What sensors see, for effects of the sensors themselves: points and lengths, and what stretches them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models import lie
from truepose.models.effects.base import Settings, Site
from truepose.models.file.driver import AIR, TEMPERATURE, TIME
from truepose.models.machine.assembly import assemble, frame_of
from truepose.models.machine.closure import home_readings
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.machine.sensor import Sensor
from truepose.models.sensors.direction import ORIGIN, Direction
from truepose.models.units import compatible

FROM = "from."
"""Setting ``from.COLUMN``: the thermometer that is read, and the temperature (degC) from which it counts."""
ALIKE = 0.99
"""Correlation from which two thermometers say the same: all but a fiftieth of their variance. Chosen."""


def others(machine: Machine, own: Sequence[str], seen: Mapping[str, Array]) -> list[str]:
    """Thermometers among the drivers ``seen`` (n,) that vary and say something else than ``own`` columns and each other."""
    known = [seen[name] for name in own if name in seen]
    out = list[str]()
    for name in sorted(seen, key=lambda name: name == AIR):  # the air last: it may stand for any of them
        varies = is_thermometer(machine, name) and np.ptp(seen[name]) > 0.0
        if varies and not any(_alike(seen[name], other) for other in known):
            known.append(seen[name])
            out.append(name)
    return out


def from_settings(name: str, seen: Mapping[str, Array]) -> Settings:
    """The setting of a thermometer elsewhere: it counts from its mean, because its absolute value says nothing of the part."""
    return {f"{FROM}{name}": float(f"{np.mean(seen[name]):.5g}")}


def borrowed(settings: Settings) -> tuple[str, float] | None:
    """The thermometer elsewhere that settings name, and where it counts from; None where they name none."""
    return next(((k.removeprefix(FROM), v) for k, v in settings.items() if k.startswith(FROM)), None)


def span(seen: Mapping[str, Array]) -> float:
    """Seconds from the first row to the last; 0 without a clock."""
    return float(np.ptp(seen[TIME])) if TIME in seen else 0.0


def is_thermometer(machine: Machine, name: str) -> bool:
    return machine.drives(name) == TEMPERATURE and compatible(machine.driver_unit(name), "degC")


def _alike(a: Array, b: Array) -> bool:
    """Whether they are a line of each other."""
    if np.ptp(b) == 0.0:
        return False
    return bool(abs(np.corrcoef(a, b)[0, 1]) > ALIKE)


XYZ = AXES[:3]
NEAR_ZENITH = 1e-12
"""Square of the zenith distance (rad) below which nothing is lifted any way."""


def point_names(sensor: Sensor) -> list[str]:
    """Points that a sensor sees, by the beginning of their columns: ``P1.`` of P1.x P1.y P1.z, empty of x y z."""
    if sensor.joints:  # joints may be called x, y and z
        return []
    names = [column[:-1] for column in sensor.shiftable if column.rpartition(".")[2] == "x"]
    return [name for name in names if all(f"{name}{axis}" in sensor.shiftable for axis in XYZ)]


def length_names(sensor: Sensor) -> list[str]:
    """Columns of a sensor that are lengths and no coordinates of a point."""
    coordinates = {f"{name}{axis}" for name in point_names(sensor) for axis in XYZ}
    lengths = [column for column in sensor.shiftable if sensor.columns[column] == "mm"]
    return [column for column in lengths if column not in coordinates]


def optical(sensor: Sensor) -> bool:
    """Whether a sensor looks along lengths, or at points, through air."""
    return not sensor.touches and measures_lengths(sensor)


def of_stars(sensor: Sensor) -> bool:
    """Whether a sensor says in which direction something far away is that an axis of the tool points at."""
    return isinstance(sensor, Direction) and sensor.of != ORIGIN


def bent_up(site: Site, sensor: Sensor, lift: Callable[[ca.SX], ca.SX]) -> dict[str, ca.SX]:
    """Shifts of a direction's columns that lift it by ``lift`` of its height over the horizon, rad."""
    assert isinstance(sensor, Direction)
    gravity = np.array(site.machine.gravity, dtype=float)
    zenith = frame_of(site.values, "base")[:3, :3] @ ca.DM(-gravity / np.linalg.norm(gravity))
    at = [site.values[parameter.name] for parameter in sensor.parameters[3:]]
    zenith = lie.rpy_transform([ca.SX(0)] * 3, at)[:3, :3].T @ zenith if at else zenith
    seen = ca.vertcat(*(site.seen(column) for column in sensor.columns))
    along = sensor.meant(seen)
    sine = ca.dot(along, zenith)
    cosine = ca.sqrt(ca.fmax(1.0 - sine**2, NEAR_ZENITH))
    angle = lift(ca.atan2(sine, cosine))
    moved = ca.cos(angle) * along + ca.sin(angle) * (zenith - sine * along) / cosine
    change = sensor.told(moved) - seen
    return {f"{column}.reading": change[k] for k, column in enumerate(sensor.columns)}


def measures_lengths(sensor: Sensor) -> bool:
    """Whether any of its columns is a length."""
    return any(sensor.columns[column] == "mm" for column in sensor.shiftable)


def seen_point(site: Site, name: str) -> ca.SX:
    """(3,) a point as it should be read, mm in the sensor's frame."""
    return ca.vertcat(*(site.seen(f"{name}{axis}") for axis in XYZ))


AZIMUTH, ELEVATION, RANGE = "azimuth", "elevation", "range"
"""What an instrument that looks at points reads of each: about its z axis, above its xy plane, and how far away."""
NOWHERE = 1e-12


def polar(point: ca.SX) -> dict[str, tuple[ca.SX, ca.SX]]:
    """Azimuth and elevation (rad) and range (mm) of a point (3,), each with how the point moves (3,) where one more is read;
    smooth on the axis, too."""
    x, y, z = ca.vertsplit(point)
    aside, far = ca.sqrt(x**2 + y**2 + NOWHERE), ca.sqrt(ca.sumsqr(point) + NOWHERE)
    return {
        AZIMUTH: (ca.atan2(y, x + NOWHERE), ca.vertcat(-y, x, 0.0)),
        ELEVATION: (ca.atan2(z, aside), ca.vertcat(-x * z / aside, -y * z / aside, aside)),
        RANGE: (far, point / far),
    }


def looks_from_afar(machine: Machine, sensor: Sensor) -> bool:
    """Whether a sensor looks at points from its origin, where the machine does not stand."""
    origin = [machine.geometry[f"{FRAMES[0]}.{axis}"].nominal for axis in XYZ]
    return optical(sensor) and bool(point_names(sensor)) and any(origin)


def from_home(site: Site, sensor: Sensor, column: str) -> ca.SX:
    """How much longer a column should read than at home, mm; the whole length on machines with closed loops.

    A phase counted from home stays where it is when a fit moves what only adds to every length alike.
    """
    mechanism, values = site.machine.mechanism, site.values
    if mechanism.passive:
        return site.seen(column)
    q = dict(zip(mechanism.readings, map(ca.SX, home_readings(mechanism)), strict=True))
    placed = assemble(site.machine, values, q, site.z, ca.SX(0, 1))
    own = {name: values[name] for name in (*(p.name for p in sensor.parameters), *sensor.reads)}
    home = sensor.predict(placed.seen(sensor.view, values), own)
    return site.seen(column) - home[list(sensor.columns).index(column)]


def moved_point(name: str, shift: ca.SX) -> dict[str, ca.SX]:
    """A shift (3,) of the columns of a point, by port."""
    return {f"{name}{axis}.reading": shift[k] for k, axis in enumerate(XYZ)}


def stretched(site: Site, sensor: Sensor, strain: ca.SX) -> dict[str, ca.SX]:
    """Shifts of a sensor whose every range and length reads ``strain`` of itself too long."""
    columns = [*length_names(sensor), *(f"{name}{axis}" for name in point_names(sensor) for axis in XYZ)]
    return {f"{column}.reading": strain * site.seen(column) for column in columns}
