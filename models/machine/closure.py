"""The one iteration that closes loops: Newton's method with short steps, many rows at once.

A machine's home, the rows of a recording, the test vectors of the generated C and gaps at measured poses go through
it. (The generated C has Newton's method in C of its own; inverse kinematics, which solves for readings too, damps.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import COORDINATES, Mechanism, coupling_matrix

Equations = Callable[[Array, Index], tuple[Array, Array, Array]]
"""Unknowns (k, nx) of the rows named (k,) to equations (k, m, 1), their Jacobian (k, m, nx) and gaps (k, g, 1), mm."""
CLOSED = 1e-11
"""Step, in parts of an unknown's natural size, after which the next one would be lost in rounding."""
ROUNDS = 40


@dataclass(frozen=True)
class CoordinateScale:
    """Natural size (nx,) of each unknown of the closed loops (mm, rad, N) and the longest step towards it.

    ``gap`` is the largest closure residual (mm) at which loops count as closed.
    """

    size: Array
    limit: Array
    gap: float


def closed(
    equations: Equations, start: Array, scale: CoordinateScale, *, rounds: int = ROUNDS, careful: bool = False
) -> tuple[Array, Mask]:
    """Unknowns (n, nx) that close the loops next to ``start`` (n, nx), and which rows do (n,).

    Steps are short: the assembly must stay the same one. A row is given up where a step is not finite, or where the
    iteration comes to rest with a gap left; with ``careful`` also where the start is singular to rounding.
    """
    x, good, active = start.astype(float), np.zeros(len(start), dtype=bool), np.arange(len(start))
    for _ in range(rounds):
        g, gx, gap = equations(x[active], active)
        step = (determined if careful else solved)(gx, g)[..., 0]
        step /= np.maximum(1.0, np.max(np.abs(step) / scale.limit, axis=1, initial=0.0))[:, None]
        x[active] -= step
        natural = np.maximum(scale.size, 1e-3 * np.abs(x[active]))
        size = np.max(np.abs(step) / natural, axis=1, initial=0.0)
        shut = np.max(np.abs(gap), axis=(1, 2), initial=0.0) < scale.gap
        good[active[(size < CLOSED) & shut]] = True
        active = active[np.isfinite(size) & (size >= CLOSED)]
        if not len(active):
            break
    return x, good


def one_row(function: ca.Function, *known: Array) -> Equations:
    """Equations of one row from a CasADi function of ``known`` vectors and then the unknowns (nx,), its outputs dense.

    It is evaluated in place: with vectors and matrices of CasADi's in between, that takes four times as long.
    """
    buffer: Any  # casadi's stubs misstate what it takes
    buffer, evaluate = function.buffer()
    given = [np.array(v, dtype=float) for v in known]
    outputs = [np.empty(function.size_out(k)[::-1]) for k in range(function.n_out())]

    def equations(x: Array, _: Index) -> tuple[Array, Array, Array]:
        for give, arrays in ((buffer.set_arg, (*given, x[0])), (buffer.set_res, outputs)):
            for k, array in enumerate(arrays):
                if array.size:
                    give(k, memoryview(array.data).cast("B").cast("d"))
        evaluate()
        g, gx, gap = (np.array(output.T, order="C")[None] for output in outputs)
        return g, gx, gap

    return equations


def solved(a: Array, b: Array) -> Array:
    """(n, nx, k) solutions of a x = b, row by row, a (n, ne, nx), b (n, ne, k): least squares if ne > nx; NaN if singular.

    NaN also where a number is infinite: a derivative at the edge of where a parameter means anything.
    """
    finite = np.isfinite(a).all(axis=(1, 2), keepdims=True) & np.isfinite(b).all(axis=(1, 2), keepdims=True)
    if not finite.all():
        a, b = np.where(finite, a, np.nan), np.where(finite, b, np.nan)
    if a.shape[1] != a.shape[2]:
        a, b = a.transpose(0, 2, 1) @ a, a.transpose(0, 2, 1) @ b
    try:
        return np.asarray(np.linalg.solve(a, b))
    except np.linalg.LinAlgError:
        return determined(a, b)


def determined(a: Array, b: Array) -> Array:
    """(n, nx, k) the same by least squares, more slowly; only rows that do not determine x are NaN."""
    out = np.full((len(a), a.shape[2], b.shape[2]), np.nan)
    for k in range(len(a)):
        if np.isfinite(a[k]).all() and np.linalg.matrix_rank(a[k]) == a.shape[2]:
            out[k] = np.linalg.lstsq(a[k], b[k], rcond=None)[0]
    return out


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
