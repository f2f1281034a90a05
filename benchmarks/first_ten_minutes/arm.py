"""An arm as a workshop has it, simulated in numpy alone: its second joint gives way under its weight, its third has play.

Rows are the data sheet's, T = RotZ(theta) TransZ(d) TransX(a) RotX(alpha). mm, rad, N m, kg.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NAMES = tuple(f"A{k}" for k in range(1, 7))
SHEET = np.array(  # a, alpha (deg), d, theta (deg)
    [(145, -90, 418, 0), (612, 0, 0, -90), (118, -90, 0, 0), (0, 90, 641, 0), (0, -90, 0, 0), (0, 0, 88, 0)],
    dtype=float,
)
RANGES = np.array([(-165, 165), (-75, 85), (-60, 80), (-175, 175), (-110, 110), (-180, 180)], dtype=float)
LENGTH, ANGLE = 0.2, float(np.radians(0.05))
"""1 sigma of what the shop makes of a length (mm) and an angle (rad)."""
TOOL = np.array([34.0, -21.0, 146.0])
"""mm, of the reflector in the frame of the flange."""
SIGMA = 0.02
COMPLIANCE, PLAY = 2.0e-6, 4.0e-4
"""rad/(N m) of the second joint, rad between the flanks of the third."""
LOAD = 14.0
"""kg that the flange carries; the arm's own weight is borne by a spring, as in many arms of this size."""
DOWN = 9.80665


@dataclass(frozen=True)
class Specimen:
    """One arm as built, on its stand: rows (6, 4) mm and rad, base (4, 4), tool (3,)."""

    rows: Array
    base: Array
    tool: Array


def specimen(rng: np.random.Generator) -> Specimen:
    """Drawn from the tolerances; the tracker stands somewhere in the room."""
    rows = SHEET.copy()
    rows[:, [1, 3]] = np.radians(rows[:, [1, 3]])
    rows += np.array([LENGTH, ANGLE, LENGTH, ANGLE]) * rng.standard_normal(rows.shape)
    base = _turn("z", float(rng.uniform(-3, 3))) @ _turn("x", float(np.radians(rng.uniform(-1, 1))))
    base[:3, 3] = [*rng.uniform(1500, 2600, 2), rng.uniform(-600, 200)]
    return Specimen(rows, base, TOOL + 0.5 * rng.standard_normal(3))


def path(rng: np.random.Generator, n: int) -> Array:
    """(n, 6) rad: poses within 85 % of the ranges, one after another, a tenth of them visited again."""
    low, high = np.radians(RANGES).T
    q = (low + high) / 2 + 0.425 * (high - low) * rng.uniform(-1, 1, (n - n // 10, 6))
    again = q[rng.permutation(len(q))[: n // 10]]
    return np.round(np.concatenate([q, again]), 7)


def seen(arm: Specimen, q: Array, rng: np.random.Generator, *, noise: bool = True) -> Array:
    """(n, 3) of the reflector in the tracker's frame, for joints gone to in this order."""
    moved = q.copy()
    moved[:, 2] -= 0.5 * PLAY * sides(q)[:, 2]
    moved[:, 1] += COMPLIANCE * _torque(arm, moved)
    at = _reflector(arm, moved)
    return at + SIGMA * rng.standard_normal(at.shape) if noise else at


def sides(q: Array) -> Array:
    """(n, 6) direction of each joint's last motion, +1 or -1; the first pose is gone to from below."""
    return np.where(np.diff(q, axis=0, prepend=q[:1] - 1.0) < 0, -1.0, 1.0)


def _reflector(arm: Specimen, q: Array) -> Array:
    flange = _frames(arm, q)[-1]
    at = flange[:, :3, :3] @ arm.tool + flange[:, :3, 3]
    return at @ arm.base[:3, :3].T + arm.base[:3, 3]


def _torque(arm: Specimen, q: Array) -> Array:
    """(n,) N m of the load about the second joint, which turns about z of the first row's frame."""
    frames = _frames(arm, q)
    lever = (frames[-1][:, :3, :3] @ arm.tool + frames[-1][:, :3, 3] - frames[1][:, :3, 3]) / 1e3
    weight = np.broadcast_to([0.0, 0.0, -LOAD * DOWN], lever.shape)
    return np.asarray(np.einsum("ni,ni->n", np.cross(lever, weight), frames[1][:, :3, 2]))


def _frames(arm: Specimen, q: Array) -> list[Array]:
    """(n, 4, 4) in the base, the base's own first."""
    at = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    out = [at]
    for (a, alpha, d, theta), own in zip(arm.rows, q.T, strict=True):
        along = np.eye(4)
        along[:3, 3] = [a, 0.0, d]
        at = at @ _turn("z", theta + own) @ along @ _turn("x", alpha)
        out.append(at)
    return out


def _turn(axis: str, angle: Array | float) -> Array:
    angle = np.asarray(angle, dtype=float)
    out = np.zeros((*angle.shape, 4, 4))
    out[..., range(4), range(4)] = 1.0
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out[..., i, i] = out[..., j, j] = np.cos(angle)
    out[..., i, j], out[..., j, i] = -np.sin(angle), np.sin(angle)
    return out
