"""Where the solution of closed loops starts: the assembly nearest to the home that the machine file gives."""

from __future__ import annotations

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.machine.closure import CoordinateScale, closed, one_row
from truepose.models.machine.couplings import coupling_matrix
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import COORDINATES, Mechanism

STRAINED = 2e-2
"""Loops with more equations than unknowns close by least squares, when no gap exceeds this part of the
machine's size: as built they are strained a little."""
_NEWTON = 200
_STARTS = 60
_SPREAD = 0.3
"""rad, and parts of the reach, by which further starts leave the given home: it may be a singular pose."""


def coordinate_scale(machine: Machine, unknowns: int, equations: int) -> CoordinateScale:
    """Scales for ``unknowns`` (coordinates of the mechanism's unknown joints, then forces) of ``equations``."""
    mechanism = machine.mechanism
    lengths = [abs(p.nominal) for p in mechanism.parameters if p.unit == "mm"]
    reach = max([1.0, *lengths, *(abs(v) for joint in mechanism.unknown for v in joint.home)])
    kinds = slides_of(mechanism)
    forces = unknowns - len(kinds)
    size = np.array([reach if slide else 1.0 for slide in kinds] + forces * [1.0])
    limit = np.concatenate([0.2 * size[: len(kinds)], np.full(forces, np.inf)])
    strained = equations > len(kinds)
    return CoordinateScale(size, limit, STRAINED * reach if strained else np.inf)


def slides_of(mechanism: Mechanism) -> list[bool]:
    """Of each coordinate of the unknown joints whether it is a length."""
    slides = {"prismatic": [True], "free": 3 * [True] + 3 * [False]}
    return [slide for j in mechanism.unknown for slide in slides.get(j.kind, COORDINATES[j.kind] * [False])]


def home_readings(mechanism: Mechanism) -> Array:
    """(nq,) readings at home: what puts joints where the file says, else zero, or mid-range where zero is out of range."""
    out, coupled = [], coupling_matrix(mechanism)
    for actuator in mechanism.actuators:
        low, high = actuator.range or (-np.inf, np.inf)
        inside = 0.0 if low <= 0.0 <= high else (low + high) / 2
        out.append(inside if actuator.home is None else actuator.home)
    if coupled is None:
        return np.array(out, dtype=float)
    stated = [actuator.home is not None for actuator in mechanism.actuators]
    return np.linalg.solve(np.where(np.array(stated)[:, None], coupled, np.eye(len(out))), np.array(out))


def closed_home(closure: ca.Function, given: Array, scale: CoordinateScale) -> Array | None:
    """(nx,) an assembly near ``given`` (nx,); ``closure`` maps x to (equations, their Jacobian, gaps).

    Where Newton's method fails from there, starts further and further away are tried, the same ones every time.
    The closed assembly nearest to home is taken; None when no start leads to one.
    """
    found = _newton(closure, given, scale)
    if found is not None or not len(given):
        return given if found is None else found
    rng = np.random.default_rng(0)
    best: tuple[float, Array] | None = None
    moved = np.isfinite(scale.limit)
    for k in range(_STARTS):
        spread = _SPREAD * (1 + 3 * k / _STARTS)
        start = given + np.where(moved, spread * scale.size * rng.uniform(-1, 1, len(given)), 0.0)
        found = _newton(closure, start, scale)
        if found is None:
            continue
        away = float(np.linalg.norm(((found - given) / scale.size)[moved]))
        if best is None or away < best[0]:
            best = (away, found)
    return None if best is None else best[1]


def _newton(closure: ca.Function, start: Array, scale: CoordinateScale) -> Array | None:
    x, good = closed(one_row(closure), start[None], scale, rounds=_NEWTON, careful=True)
    return x[0] if good[0] else None


__all__ = ["STRAINED", "closed_home", "coordinate_scale", "home_readings"]
