"""An arm in plain numpy that a measured force pushes at: its joints yield until they hold it, whatever it weighs.

Torques are cross products of lever and force about each axis, and the arm stands where they are in balance; nothing of it
is a derivative of an energy. mm, rad, N, N mm inside; complex steps pass through.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array

ALPHA = np.radians([0.0, -90.0, 0.0, -90.0, 90.0, -90.0])
D = np.array([0.0, 50.0, 440.0, 35.0, 0.0, 0.0])
R = np.array([330.0, 0.0, 0.0, 420.0, 0.0, 80.0])
RANGES = np.array([[-170, 170], [-60, 140], [-140, 70], [-190, 190], [-120, 120], [-360, 360]])
SENSOR_TURN = np.radians([20.0, -35.0, 130.0])
SENSOR, TOOL = np.array([3.0, -2.0, 25.0]), np.array([0.0, 30.0, 160.0])
G = 9.80665
MASSES = ((2, 9.0, (220.0, 0.0, 60.0)), (3, 6.0, (30.0, 20.0, -40.0)), (4, 3.0, (0.0, 0.0, -60.0)))
"""Joint whose link it is, kg, centre in the link's frame."""
COLUMNS = ("ft.x", "ft.y", "ft.z", "ft.mx", "ft.my", "ft.mz")


def text(
    *,
    gravity: str = "",
    force: str = "in: sensor",
    tolerance: float = 0.0,
    base: str = "{}",
    tool: str = "",
    more: str = "",
) -> str:
    """The machine file."""
    joints = "\n".join(
        f"    - {{name: q{k + 1}, kind: revolute, alpha: {np.degrees(ALPHA[k]):.0f}, d: {D[k]}, r: {R[k]}, "
        f"range: {RANGES[k].tolist()}, gear_ratio: 100}}"
        for k in range(6)
    )
    masses = "".join(f"  m{j}: {{kg: {kg}, com: {list(com)}, in: link{j}}}\n" for j, kg, com in MASSES)
    weights = f"gravity: {gravity}\nmasses:\n{masses}" if gravity else ""
    turn = np.degrees(SENSOR_TURN).tolist()
    frame = f"  sensor: {{in: flange, xyz: {SENSOR.tolist()}, rpy: {turn}}}\n" if "sensor" in force else ""
    pushed = f"forces:\n  process: {{columns: [{', '.join(COLUMNS)}], {force}}}\n" if force else ""
    return (
        "schema: truepose/machine/1\nname: pushed\n"
        f"mechanism:\n  type: serial\n  joints:\n{joints}\n"
        f"frames:\n{frame}  base: {base}\n  tool: {{in: flange, xyz: {TOOL.tolist()}{tool}}}\n"
        "sensor: {type: position, sigma: {xyz: 0.02}}\n"
        f"tolerances: {{length: {tolerance}, angle: {tolerance / 5}, beta: 0}}\n{weights}"
        f"{pushed}{more}"
    )


def turned(axis: int, angle: complex) -> NDArray[np.complex128]:
    """(3, 3) about x, y or z."""
    out, (i, j) = np.eye(3, dtype=complex), [(1, 2), (2, 0), (0, 1)][axis]
    out[i, i] = out[j, j] = np.cos(angle)
    out[i, j], out[j, i] = -np.sin(angle), np.sin(angle)
    return out


def rpy(angles: Array) -> NDArray[np.complex128]:
    roll, pitch, yaw = angles
    return turned(2, yaw) @ turned(1, pitch) @ turned(0, roll)


def sensor_turn() -> Array:
    """(3, 3) sensor's axes in the flange."""
    return np.asarray(rpy(SENSOR_TURN).real)


@dataclass(frozen=True)
class Placed:
    """Origins (6, 3) and turns (6, 3, 3) of the links, and the tool's origin (3,)."""

    origins: NDArray[np.complex128]
    turns: NDArray[np.complex128]
    tool: NDArray[np.complex128]


def placed(q: NDArray[np.complex128] | Array, changes: Mapping[str, complex] | None = None) -> Placed:
    """Links one after the other; ``changes`` add to ``q2.d``, ``q3.r``, ``q4.alpha``, ``tool.x`` ..."""
    own = changes or {}
    turn, at = np.eye(3, dtype=complex), np.zeros(3, dtype=complex)
    origins, turns = [], []
    for k in range(6):
        name = f"q{k + 1}"
        alpha, d, r, theta = (own.get(f"{name}.{p}", 0.0) for p in ("alpha", "d", "r", "theta"))
        turn = turn @ turned(0, ALPHA[k] + alpha)
        at = at + turn[:, 0] * (D[k] + d)
        turn = turn @ turned(2, q[k] + theta)
        at = at + turn[:, 2] * (R[k] + r)
        origins.append(at)
        turns.append(turn)
    tip = TOOL + np.array([own.get(f"tool.{axis}", 0.0) for axis in "xyz"])
    return Placed(np.array(origins), np.array(turns), at + turn @ tip)


def torques(
    q: NDArray[np.complex128] | Array,
    wrench: Array,
    gravity: Array | None = None,
    changes: Mapping[str, complex] | None = None,
) -> NDArray[np.complex128]:
    """(6,) N m about the joints of what pushes at the sensor (N, N m in its axes, about its origin), and of weights."""
    links = placed(q, changes)
    flange, axes = links.turns[5], links.turns[5] @ sensor_turn()
    at, force, moment = links.origins[5] + flange @ SENSOR, axes @ wrench[:3], 1000.0 * (axes @ wrench[3:])
    out = np.zeros(6, dtype=complex)
    for k in range(6):
        z, o = links.turns[k][:, 2], links.origins[k]
        out[k] = z @ (np.cross(at - o, force) + moment)
        for joint, kg, com in MASSES if gravity is not None else ():
            if joint > k:
                centre = links.origins[joint - 1] + links.turns[joint - 1] @ np.array(com)
                out[k] += z @ np.cross(centre - o, kg * np.asarray(gravity))
    return np.asarray(out / 1000.0)


def held(q: Array, c: Array, wrench: Array, gravity: Array | None = None) -> Array:
    """(6,) joints where the arm stands in balance; ``c`` (6,) rad/(N m)."""
    here = q.copy()
    for _ in range(60):
        here = q + c * torques(here, wrench, gravity).real
    return here
