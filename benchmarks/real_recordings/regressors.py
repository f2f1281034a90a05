"""What may be missing, as columns of a linear fit: a port of the arm times functions of what was recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from real_recordings.common import Array
from real_recordings.linearised import Linearised, gravity_torques

Rows = NDArray[np.intp]
LARGEST, DECAY, FLOOR = 6e-4, 1.5, 1e-5
"""Expected amplitudes of a periodic error, rad: 2 arcmin falling as order^-1.5, and not below 2 arcsec."""
TORQUE, COUPLING, ARRIVAL = 1e-5, 1e-3, 3e-4
MOUNT = np.array([0.05, 0.05, 0.05, 5e-5, 5e-5, 5e-5])
MOVED = 0.01
"""Steps beyond this (rad) have a direction; below, the arm only trembles about its goal."""
KNOTS = 24


@dataclass(frozen=True)
class Term:
    """Columns port (n, 6, c) times factor(rows) (m, f): all products (m, 6, c * f); summed, c = f, their sum (m, 6, 1)."""

    port: Array
    factor: Callable[[Rows], Array]
    summed: bool = False

    def columns(self, rows: Rows, drivers: Rows | None = None) -> Array:
        """Columns of some rows, with the factors of other rows where ``drivers`` are given (a placebo)."""
        port, factor = self.port[rows], self.factor(rows if drivers is None else drivers)
        if self.summed:
            return np.asarray(np.einsum("nij,nj->ni", port, factor)[:, :, None])
        return (port[:, :, :, None] * factor[:, None, None, :]).reshape(len(rows), 6, -1)


def given(values: Array) -> Callable[[Rows], Array]:
    """A factor that is a table (n, f)."""
    return lambda rows: values[rows]


def of_joint(data: Linearised, k: int, values: Array) -> Term:
    """A displacement of joint k as a combination of the columns of a table (n, f), rad."""
    return Term(data.joint[:, :, [k]], given(values))


def amplitude(orders: Array) -> Array:
    """Expected amplitude of each order, rad."""
    return np.maximum(np.minimum(LARGEST, 5e-3 / orders**DECAY), FLOOR)


def waves(data: Linearised, orders: Sequence[int]) -> list[Term]:
    """Periodic errors of every joint: sine and cosine of whole multiples of its angle."""
    k = np.array(orders, dtype=float)

    def factor(joint: int) -> Callable[[Rows], Array]:
        def values(rows: Rows) -> Array:
            phase = data.q[rows, joint, None] * k
            return np.hstack([np.sin(phase) * amplitude(k), np.cos(phase) * amplitude(k)])

        return values

    return [Term(data.joint[:, :, [j]], factor(j)) for j in range(data.q.shape[1])]


def gravity(data: Linearised) -> list[Term]:
    """Joints 2 to 5 give way to gravity's torque, whatever the masses and where they are."""
    return [of_joint(data, k, gravity_torques(data, k) * TORQUE) for k in range(1, 5)]


def couplings(data: Linearised) -> list[Term]:
    """Each joint errs in proportion to every other one."""
    n = data.q.shape[1]
    return [of_joint(data, k, data.q[:, [j for j in range(n) if j != k]] * COUPLING) for k in range(n)]


def direction(data: Linearised) -> Array:
    """(n, nq) direction in which each joint arrived, -1 to 1."""
    return np.asarray(np.clip(data.steps / MOVED, -1.0, 1.0))


def share_of_path(data: Linearised) -> Array:
    """(n, nq) each joint's part of the last motion, the joint that went furthest being 1: all stop at one time."""
    longest = np.maximum(np.abs(data.steps).max(axis=1, keepdims=True), 1e-4)
    return np.asarray(data.steps / longest)


def arrival(data: Linearised) -> list[Term]:
    """Joints stand off their readings along the last motion, and by its direction alone."""
    along, sign = share_of_path(data), direction(data)
    return [
        of_joint(data, k, ARRIVAL * np.column_stack([along[:, k], sign[:, k]]))
        for k in range(data.q.shape[1])
    ]


def hats(x: Array, knots: int) -> Array:
    """(n, knots) a broken line over x by its values at evenly spaced knots."""
    place = (x - x.min()) / (np.ptp(x) or 1.0) * (knots - 1)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(knots))))


def mount(data: Linearised, name: str, values: Array) -> Term:
    """Six small motions of base, tool or a joint times the columns of a table (n, f)."""
    return Term(data.motion[name] * MOUNT, given(values))


def drift(data: Linearised, knots: int = KNOTS) -> list[Term]:
    """The base moves slowly in the order of the rows."""
    return [mount(data, "base", hats(np.arange(len(data), dtype=float), knots))]


def beam(data: Linearised) -> tuple[Array, Array]:
    """Unit vectors (n, 3) from the tracker to the probe, before the tracker and in the tool's frame."""
    ray = data.position / np.linalg.norm(data.position, axis=1, keepdims=True)
    return ray, np.einsum("nji,nj->ni", data.rotation, ray)


def powers(values: Array, degree: int) -> Array:
    """(n, m) all products of the columns up to a degree, less their means."""
    exponents = [e for e in np.ndindex(*(degree + 1,) * values.shape[1]) if 0 < sum(e) <= degree]
    out = np.array([np.prod(values**e, axis=1) for e in np.array(exponents)]).T
    return np.asarray(out - out.mean(axis=0))


def tracker(data: Linearised) -> Term:
    """Range, horizontal and vertical angle err as cubics of the three."""
    ray, _ = beam(data)
    reach = np.linalg.norm(data.position, axis=1, keepdims=True)
    azimuth, elevation = np.arctan2(ray[:, 1], ray[:, 0]), np.arcsin(ray[:, 2])
    across = np.column_stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(len(data))])
    port = np.zeros((len(data), 6, 3))
    port[:, :3] = np.stack([ray, across, np.cross(ray, across)], axis=2) * MOUNT[0]
    where = np.column_stack([azimuth, elevation, reach[:, 0] / 1000.0])
    return Term(port, given(powers(where - where.mean(axis=0), 3)))


def incidence(data: Linearised) -> Term:
    """The probe errs with the direction in which the beam meets it: polynomials of degree 4 of that direction."""
    ray, met = beam(data)
    return Term(tilted(data, ray), given(powers(met - met.mean(axis=0), 4)))


def tilted(data: Linearised, ray: Array) -> Array:
    """(n, 6, 6) a shift of the measured point along the beam and across it, and a turn of the probe."""
    port = np.zeros((len(data), 6, 6))
    side = np.cross(ray, np.array([0.0, 0.0, 1.0]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    port[:, :3, :3] = np.stack([ray, side, np.cross(ray, side)], axis=2) * MOUNT[0]
    port[:, 3:, 3:] = np.eye(3) * MOUNT[3]
    return port
