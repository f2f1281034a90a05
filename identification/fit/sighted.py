"""Where a base stands by directions alone: axes of the tool that point at stars, or bearings to the tool's origin.

Axes tell how the base is turned, by a nearest rotation. Bearings to known points of the machine tell where it stands as well,
by orthogonal iteration (Lu, Hager and Mjolsness, IEEE TPAMI 22, 2000): each point is put onto its line of sight, and the
machine is moved onto the points, in turns. From few starts it ends in a false minimum; it is begun from many.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import TOOL_IN_WORLD
from truepose.models.sensors.direction import ORIGIN, Direction

_FEWEST = {True: 3, False: 2}
"""Fewest directions that tell a base, by whether they are bearings."""
_SWEEPS, _LAST = 15, 300
_STEADY = 1e-12
ZEROS = 2.0 * np.pi * np.arange(1, 24) / 24
"""rad: how far an unknown zero of a joint is tried from where it is stated; a fit finds the rest."""


def sensors_of_directions(machine: Machine) -> list[Direction]:
    """Those that see the tool from the world."""
    return [s for s in machine.sensors if isinstance(s, Direction) and s.view == TOOL_IN_WORLD]


def station_of(sensor: Direction, values: Iterable[float]) -> tuple[Array, Array]:
    """Rotation (3, 3) and place (3,), mm, of an instrument with ``values`` of its own parameters; the identity without any."""
    at = np.array(list(values), dtype=float)
    return (lie.rpy_matrix(at[3:]), at[:3]) if len(at) else (np.eye(3), np.zeros(3))


def unknown_zeros(machine: Machine) -> tuple[str, ...]:
    """Parameters of joints that turn which say where their reading is 0, and of which nothing is known: any angle may be."""
    turning = [a for a in machine.mechanism.actuators if a.unit == "rad"]
    names = [a.zero for a in turning]
    known = machine.geometry
    return tuple(name for name in names if name in known and np.isinf(known[name].tolerance))


def base_of(
    sensor: Direction, tool: Array, read: Array, station: tuple[Array, Array]
) -> tuple[Array, float] | None:
    """(4, 4) base that turns the poses (n, 4, 4) of the tool in its frame to the directions (n, k) that were read, and the mean
    square of what is left, as between unit vectors.

    None where too few were read. A base that axes turn stays at the origin.
    """
    whole = np.isfinite(read).all(axis=1)
    if whole.sum() < _FEWEST[sensor.of == ORIGIN]:
        return None
    turned, place = station
    seen = sensor.vectors(read[whole]) @ turned.T
    base = np.eye(4)
    if sensor.of == ORIGIN:
        base[:3, :3], base[:3, 3] = base_by_bearings(tool[whole, :3, 3], seen, place)
        there = tool[whole, :3, 3] @ base[:3, :3].T + base[:3, 3] - place
        there /= np.linalg.norm(there, axis=1, keepdims=True)
    else:
        axes = tool[whole, :3, "xyz".index(sensor.of)]
        base[:3, :3] = lie.nearest_rotation(seen.T @ axes)
        there = axes @ base[:3, :3].T
    return base, float(np.mean(np.sum((there - seen) ** 2, axis=1)))


def base_by_bearings(points: Array, seen: Array, station: Array) -> tuple[Array, Array]:
    """Rotation and place of a base whose points (n, 3) are seen along unit vectors (n, 3) from a ``station`` (3,)."""
    across = np.eye(3) - np.einsum("ni,nj->nij", seen, seen)
    best = min((_iterated(points, seen, across, r, _SWEEPS) for r in _many()), key=lambda found: found[2])
    rotation, shift, _ = _iterated(points, seen, across, best[0], _LAST)
    return rotation, shift + station


def _many() -> Array:
    """(24, 3, 3) turns of a cube."""
    return np.asarray(Rotation.create_group("O").as_matrix())


def _iterated(
    points: Array, seen: Array, across: Array, rotation: Array, sweeps: int
) -> tuple[Array, Array, float]:
    """Rotation, shift, and mean square of how far points are beside their line of sight; behind the station counts as far."""
    middle, left = points.mean(axis=0), float("inf")
    whole = across.sum(axis=0)
    for _ in range(sweeps):
        carried = points @ rotation.T
        shift = -np.linalg.lstsq(whole, np.einsum("nij,nj->i", across, carried), rcond=1e-12)[0]
        there = carried + shift
        along = np.maximum(np.sum(there * seen, axis=1), 0.0)
        onto = along[:, None] * seen
        fresh = float(np.mean(np.sum((there - onto) ** 2, axis=1)))
        if left - fresh < _STEADY * fresh:
            break
        left = fresh
        rotation = lie.nearest_rotation((onto - onto.mean(axis=0)).T @ (points - middle))
    return rotation, shift, fresh
