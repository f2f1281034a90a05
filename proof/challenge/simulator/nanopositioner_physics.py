"""What a nanopositioner and its interferometer add: a laser of another colour, optics, air, warped parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from . import heat
from .base import Array, Imperfection, Kind, Place
from .cavity import Constants, light
from .joint_physics import TURN, Axes, phase, rail_profile
from .motions import applied
from .mount_physics import body_temperature
from .ported import Act, Physics, Stage, Work, shapeless

REFRACTIVITY, PRESSURE, KELVIN = 2.685e-4, 1013.25, 273.15
"""n - 1 of dry air at 1.56 um, 20 degC and the pressure (hPa) beside it (Ciddor 1996)."""
BOGIE = 15.0
"""mm between a table's bearings, by which a bent rail turns it."""


@dataclass(frozen=True)
class Optics:
    """The beam's constants and the mirror's poses (n, 4, 4) in the world."""

    constants: Constants
    mirror: Array

    def spot(self, length: Array) -> Array:
        """(n, 2) where the light meets the mirror, in the mirror's plane, for cavity lengths (n,), mm."""
        origin, along = light(self.constants)
        world = origin + length[:, None] * along
        return applied(np.asarray(np.linalg.inv(self.mirror), dtype=float), world)[:, :2]


def slide_wanders(axes: Axes) -> Act:
    """The table follows its rail sideways and turns with the rail's slope."""

    def act(work: Work, imperfection: Imperfection) -> None:
        k, shape = axes.index(imperfection.place), imperfection.shape
        name, share = imperfection.place[0], axes.share(work, k)
        off = imperfection.size * rail_profile(shape, share)
        work.add(f"{name}.motion.x", off * np.cos(shape["direction"]))
        work.add(f"{name}.motion.y", off * np.sin(shape["direction"]))
        turn = imperfection.size / BOGIE * rail_profile(shape, 1.0 - share)
        work.add(f"{name}.motion.rx", turn * np.cos(shape["turn"]))
        work.add(f"{name}.motion.ry", turn * np.sin(shape["turn"]))

    return act


def instrument(wavelength: float) -> tuple[Physics, ...]:
    """Wrong wavelength, stray light once a fringe, and air that changes the wavelength."""

    def scale(work: Work, i: Imperfection) -> None:
        work.seen = work.seen * (1 + i.size)

    def stray(work: Work, i: Imperfection) -> None:
        work.seen = work.seen + i.size * np.sin(2 * TURN * work.seen / wavelength + i.shape["phase"])

    def air(work: Work, i: Imperfection) -> None:
        kelvin = work.campaign.temperatures.get("air", np.full(len(work), heat.REFERENCE)) + KELVIN
        thin = work.campaign.pressure / PRESSURE * (KELVIN + heat.REFERENCE) / kelvin
        work.seen = work.seen * (1 + i.size * REFRACTIVITY * (thin - 1) / (1 + REFRACTIVITY))[:, None]

    place: tuple[Place, ...] = (("sensor",),)
    weather = ("temperature.air", "pressure")
    return (
        Physics(
            Kind("sensor-scale", place, 3e-4, "sensor-scale", conceals=True),
            scale,
            shapeless,
            Stage.INSTRUMENT,
        ),
        Physics(Kind("sensor-periodic", place, 5e-5, "sensor-periodic"), stray, phase, Stage.INSTRUMENT),
        Physics(
            Kind("air-refraction", place, 1.0, "air-refraction", weather), air, shapeless, Stage.INSTRUMENT
        ),
    )


def unnamed(axes: Axes) -> tuple[Physics, ...]:
    """What the interface has no word for."""
    return (_bowed_mirror(), _breathing_beam(), _leaning_tables(axes), _slipping_lock(axes))


def _bowed_mirror() -> Physics:
    """Glue bows the mirror: its face lies ``size`` mm deeper where the light meets it 1 mm off its middle."""

    def act(work: Work, i: Imperfection) -> None:
        spot: Array = work.solved.spot(work.seen[:, 0])
        across = spot @ np.array([np.cos(i.shape["phase"]), np.sin(i.shape["phase"])])
        work.seen = work.seen + (i.size * (across**2 + 0.4 * across**3))[:, None]

    return Physics(Kind("mirror-bowed", (("sensor",),), 2e-4), act, phase, Stage.INSTRUMENT)


def _breathing_beam() -> Physics:
    """The beam's post grows with the room, late: ``size`` mm per kelvin, more once it is warm."""

    def act(work: Work, i: Imperfection) -> None:
        warm = body_temperature(work, "air", i.shape["lag"]) - heat.REFERENCE
        work.seen = work.seen + (i.size * (warm + 0.1 * warm**2))[:, None]

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"lag": float(rng.uniform(1200, 3600))}

    return Physics(
        Kind("beam-post-breathes", (("sensor",),), 3e-4, needs=("temperature.air",)),
        act,
        shape,
        Stage.INSTRUMENT,
    )


def _leaning_tables(axes: Axes) -> Physics:
    """A cable between two tables: where both stand far out it pulls the first ``size`` mm along its way."""

    def act(work: Work, i: Imperfection) -> None:
        k = axes.index(i.place)
        one, two = (2 * axes.share(work, j) - 1 for j in (k, (k + 1) % 3))
        work.moved[:, k] += i.size * np.tanh(3 * one * two)

    return Physics(Kind("cable-between-tables", (("q2",),), 4e-4), act)


def _slipping_lock(axes: Axes) -> Physics:
    """A clamp that gives when a goniometer leans beyond a limit: the slide below stands ``size`` mm off until it leans back."""

    def act(work: Work, i: Imperfection) -> None:
        lean = axes.path(work)[:, axes.names.index("q4")]
        limit, state, states = i.shape["limit"], 0.0, []
        for angle in lean:
            state = 1.0 if angle > limit else 0.0 if angle < -limit else state
            states.append(state)
        work.moved[:, axes.index(i.place)] += i.size * np.array(states)[1::2]

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"limit": float(rng.uniform(0.2, 0.6)) * float(axes.high[3])}

    return Physics(Kind("clamp-slips", (("q2",),), 4e-4), act, shape)


__all__ = ["BOGIE", "Optics", "instrument", "slide_wanders", "unnamed"]
