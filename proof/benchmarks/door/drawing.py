"""Right pairs by a draw: serial, parallel, hybrid and Cartesian machines, read by sensors of several kinds."""

from __future__ import annotations

import numpy as np

from .pairs import Pair
from .sources.conditions import Conditions, drawn_conditions
from .sources.gough import gough
from .sources.hybrid import hybrid
from .sources.serial import forms, serial
from .sources.tables import ALL

SENSORS = ("pose", "position", "targets")
MOST = 3
"""Effects at once, at most."""
MANY = (60, 90)
"""Poses where a row is one reading."""
Name = tuple[str, str, str]
"""Family, form and sensor."""


def machines() -> tuple[Name, ...]:
    """Return all that can be drawn."""
    out: list[Name] = []
    for family in ALL:
        for form in forms(family):
            own = ("ballbar", "direction") if form == "serial" and family != "cartesian" else ()
            out += [
                (family, form, sensor)
                for sensor in (*SENSORS, *own)
                if form == "serial" or sensor != "targets"
            ]
    out.append(("cartesian", "serial", "distance"))
    out += [("platform", form, s) for form in ("6-ups", "6-pus") for s in (*SENSORS, "direction")]
    return (*out, *(("hybrid", "3ups-up-3r", s) for s in (*SENSORS, "direction")))


def families() -> dict[str, list[Name]]:
    """Return the machines by family: a draw takes a family first."""
    out: dict[str, list[Name]] = {}
    for name in machines():
        out.setdefault(name[0], []).append(name)
    return out


def draw(rng: np.random.Generator, k: int, **given: object) -> Pair:
    """Return the ``k``-th right pair: families in turn, under drawn conditions but for those ``given``."""
    own = families()
    few = own[list(own)[k % len(own)]]
    return make(few[int(rng.integers(len(few)))], rng, int(rng.integers(0, MOST + 1)), **given)


def make(name: Name, rng: np.random.Generator, effects: int, **given: object) -> Pair:
    """Return a right pair of a machine with so many effects that its file does not state."""
    family, form, sensor = name
    if sensor in ("direction", "distance"):
        given = {**given, "known": True}  # angles alone tell no size, one length no frame
    if sensor in ("ballbar", "distance"):
        given = {**given, "poses": int(rng.integers(*MANY))}  # a row is one reading
    under: Conditions = drawn_conditions(rng, **given)
    if family == "platform":
        return gough(form, sensor, rng, effects=effects, under=under)
    if family == "hybrid":
        return hybrid(sensor, rng, effects=effects, under=under)
    return serial(family, form, sensor, rng, effects=effects, unknown=not under.known, under=under)


__all__ = ["draw", "families", "machines", "make"]
