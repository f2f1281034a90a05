"""Rivals without a name: a joint, a mount or the sensor errs as some smooth function of something recorded.

They compete with the catalogue, so that physics outside it is not given the nearest wrong name: where one of
these explains the data better than every named effect, the verdict is ``unknown`` and the remainder says
which part, driven by what, in which form.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from truepose.identification.recording.recording import Recording
from truepose.models.driver import Driver
from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site
from truepose.models.effects.common import sensor_at, sensor_names
from truepose.models.effects.sights import XYZ, moved_point, point_names, seen_point
from truepose.models.machine import FRAMES, Machine
from truepose.models.mechanism import AXES, AXIS_UNITS
from truepose.wording import joined

UNNAMED = "unknown"
LARGEST = {"mm": 1.0, "rad": 0.01}
CURVE = 4
MOUNT_CURVE = 2
WARP = ("xx", "yy", "zz", "xy", "yz", "zx")
"""Squares and products of a point's coordinates: how a measuring volume bends; its linear part is scale and frame."""


class Unnamed(Effect):
    """One joint, mount or sensor that errs smoothly; sources are scaled to -1 ... 1.

    A joint's displacement as a curve in one source, or the product of two; a mount's six motions as curves in one
    driver; a sensor of points whose volume is warped quadratically.
    """

    slug = UNNAMED
    title = "Something the catalogue does not know"

    def __init__(self, machine: Machine, recording: Recording) -> None:
        rows = ~recording.validation
        columns = {name: recording.q[rows, k] for k, name in enumerate(recording.joints)}
        self._joints = len(columns)
        for name in (
            "payload",
            "time",
            *sorted(n for n in recording.drivers if Driver.of(n).thermal),
        ):
            values = recording.driver(name)
            if values is not None:
                columns[name] = values[rows]
        self.sources = tuple(name for name, values in columns.items() if np.ptp(values) > 0)
        self._middle = {n: float(columns[n].min() + columns[n].max()) / 2 for n in self.sources}
        self._half = {n: float(np.ptp(columns[n])) / 2 for n in self.sources}
        seen = [
            recording.observations[f"{p}{a}"] for s in machine.sensors for p in point_names(s) for a in XYZ
        ]
        self._reach = max((float(np.max(np.abs(v))) for v in seen if len(v)), default=1.0) or 1.0

    def places(self, machine: Machine) -> Sequence[Place]:
        """Every joint, both mounts, sensors of points."""
        pairs = zip(sensor_names(machine), machine.sensors, strict=True)
        warped = [name for name, sensor in pairs if point_names(sensor)]
        return [(name,) for name in (*machine.mechanism.readings, *FRAMES, *warped)]

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Curves in every source, for a joint also products of two joints; a sensor's warp needs none."""
        if place[0] in sensor_names(machine):
            return ({},)
        joints = [k for k, n in enumerate(self.sources) if n in machine.mechanism.readings]
        curves: list[Settings] = [{"a": float(k)} for k in range(len(self.sources))]
        if place[0] in FRAMES:  # as a curve in a joint six motions would be a black box for anything
            return [s for k, s in enumerate(curves) if k not in joints]
        products: list[Settings] = [
            {"a": float(i), "b": float(j)} for i, j in itertools.combinations(joints, 2)
        ]
        return [*curves, *products]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        """One for a product; powers for a curve, from the square on in the joint's own reading."""
        if not settings:
            names = [f"{axis}.{pair}" for axis in XYZ for pair in WARP]
            return tuple(Coefficient(name, "mm", LARGEST["mm"]) for name in names)
        if place[0] in FRAMES:
            return tuple(
                Coefficient(f"{axis}{k}", unit, LARGEST[unit] / k)
                for k in range(1, MOUNT_CURVE + 1)
                for axis, unit in AXIS_UNITS.items()
            )
        unit = machine.mechanism.actuator(place[0]).unit
        if "b" in settings:
            return (Coefficient("c", unit, LARGEST[unit]),)
        first = 2 if self.sources[round(settings["a"])] == place[0] else 1
        return tuple(Coefficient(f"c{k}", unit, LARGEST[unit] / k) for k in range(first, CURVE + 1))

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        """The sources that are no joints."""
        names = [self.sources[round(value)] for value in settings.values()]
        return tuple(n for n in names if n not in machine.mechanism.readings)

    def shifts(self, site: Site) -> Shifts:
        """Chebyshev polynomials of one source, or a product of two; squares and products of coordinates."""
        if not site.settings:
            return self._warp(site)
        t = [self._scaled(site, round(site.settings[key])) for key in ("a", "b") if key in site.settings]
        if len(t) == 2:
            return {site.port(site.place[0]): site.c["c"] * t[0] * t[1]}
        powers = [ca.SX(1), t[0]]
        for _ in range(2, CURVE + 1):
            powers.append(2 * t[0] * powers[-1] - powers[-2])
        if site.place[0] in FRAMES:
            ks = range(1, MOUNT_CURVE + 1)
            return {
                f"{site.place[0]}.motion.{axis}": sum(
                    (site.c[f"{axis}{k}"] * powers[k] for k in ks), ca.SX(0)
                )
                for axis in AXES
            }
        return {
            site.port(site.place[0]): sum((c * powers[int(name[1:])] for name, c in site.c.items()), ca.SX(0))
        }

    def describe(self, settings: Settings) -> tuple[str, str]:
        """Driver (``q1 and q2`` for two) and kind of form (see ``Form``)."""
        if not settings:
            return "position", "warp"
        names = [self.sources[round(settings[key])] for key in ("a", "b") if key in settings]
        return joined(names), "product" if len(names) == 2 else "curve"

    def _warp(self, site: Site) -> Shifts:
        """Each coordinate of each point by squares and products of them, of about 1 at the points' distance."""
        shifts: dict[str, ca.SX] = {}
        for name in point_names(sensor_at(site.machine, site.place[0])):
            at = dict(zip(XYZ, ca.vertsplit(seen_point(site, name) / self._reach), strict=True))
            moved = [sum((site.c[f"{a}.{b}"] * at[b[0]] * at[b[1]] for b in WARP), ca.SX(0)) for a in XYZ]
            shifts |= moved_point(name, ca.vertcat(*moved))
        return shifts

    def _scaled(self, site: Site, index: int) -> ca.SX:
        name = self.sources[index]
        value = site.q[name] if name in site.q else site.driver(name)
        return (value - self._middle[name]) / self._half[name]
