"""Rivals without a name: a joint that errs as some smooth function of something recorded.

They compete with the catalogue, so that physics outside it is not given the nearest wrong name: where one of
these explains the data better than every named effect, the verdict is ``unknown`` and the remainder says
which joint, driven by what, in which form.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from truepose.identification.recording import Recording
from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site
from truepose.models.machine import Machine

UNNAMED = "unknown"
LARGEST = {"mm": 1.0, "rad": 0.01}
CURVE = 4


class Unnamed(Effect):
    """Displacement of one joint as a curve in one source, or as the product of two; sources scaled to -1 ... 1."""

    slug = UNNAMED
    title = "Something the catalogue does not know"

    def __init__(self, machine: Machine, recording: Recording) -> None:
        rows = ~recording.validation
        columns = {name: recording.q[rows, k] for k, name in enumerate(recording.joints)}
        self._joints = len(columns)
        for name in (
            "payload",
            "time",
            *sorted(n for n in recording.drivers if n.startswith("temperature.")),
        ):
            values = recording.driver(name)
            if values is not None:
                columns[name] = values[rows]
        self.sources = tuple(name for name, values in columns.items() if np.ptp(values) > 0)
        self._middle = {n: float(columns[n].min() + columns[n].max()) / 2 for n in self.sources}
        self._half = {n: float(np.ptp(columns[n])) / 2 for n in self.sources}
        self._machine = machine

    def places(self, machine: Machine) -> Sequence[Place]:
        """Every joint."""
        return [(reading,) for reading in machine.mechanism.readings]

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Curves in every source, products of two joints."""
        joints = [k for k, n in enumerate(self.sources) if n in machine.mechanism.readings]
        curves: list[Settings] = [{"a": float(k)} for k in range(len(self.sources))]
        products: list[Settings] = [
            {"a": float(i), "b": float(j)} for i, j in itertools.combinations(joints, 2)
        ]
        return [*curves, *products]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        """One for a product; powers for a curve, from the square on in the joint's own reading."""
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
        """Chebyshev polynomials of one source, or a product of two."""
        t = [self._scaled(site, round(site.settings[key])) for key in ("a", "b") if key in site.settings]
        if len(t) == 2:
            return {site.port(site.place[0]): site.c["c"] * t[0] * t[1]}
        powers = [ca.SX(1), t[0]]
        for _ in range(2, CURVE + 1):
            powers.append(2 * t[0] * powers[-1] - powers[-2])
        return {
            site.port(site.place[0]): sum((c * powers[int(name[1:])] for name, c in site.c.items()), ca.SX(0))
        }

    def describe(self, settings: Settings) -> tuple[str, str]:
        """Driver and form in words."""
        names = [self.sources[round(settings[key])] for key in ("a", "b") if key in settings]
        if len(names) == 2:
            return " and ".join(names), f"the product of {names[0]} and {names[1]}"
        return names[0], f"a smooth curve in {names[0]}"

    def _scaled(self, site: Site, index: int) -> ca.SX:
        name = self.sources[index]
        value = site.q[name] if name in site.q else site.driver(name)
        return (value - self._middle[name]) / self._half[name]
