"""A five-axis arm whose constants move between sessions: its forward model, machine file and recordings.

The forward model is Khalil and Kleinfinger's convention written out here in numpy, in mm and rad, apart from
the library's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from support.plain_kinematics import chain, frame_of
from truepose.arrays import Array

JOINTS = {
    "q1": {"r": 300.0},
    "q2": {"alpha": -90.0, "d": 50.0, "theta": -90.0},
    "q3": {"d": 400.0},
    "q4": {"alpha": -90.0, "r": 350.0},
    "q5": {"alpha": 90.0},
}
FREE = {
    "q2.alpha": 0.2, "q2.d": 0.5, "q2.theta": 0.2, "q3.alpha": 0.2, "q3.beta": 0.2, "q3.d": 0.5, "q3.theta": 0.2,
    "q4.alpha": 0.2, "q4.d": 0.5, "q4.r": 0.5, "q4.theta": 0.2, "q5.alpha": 0.2, "q5.d": 0.5,
}  # fmt: skip
"""Tolerances, mm and deg."""
TOOL = (20.0, -10.0, 80.0)
SIGMA, TURN_SIGMA = 0.02, 0.01  # mm, deg
HOUR = 3600.0
MOVES, KEYS = "xyz", ("beta", "alpha", "d", "theta", "r")


def tool_pose(p: Mapping[str, float], q: Array) -> Array:
    """Khalil and Kleinfinger's chain with Hayati's turn, mm and rad."""
    rows = ([p[f"{name}.{key}"] for key in KEYS] for name in JOINTS)
    return chain(rows, q, frame_of(p, "base"), frame_of(p, "tool"))


def noisy(pose: Array, rng: np.random.Generator, factor: float = 1.0) -> list[float]:
    """What the sensor reads of a pose: position in mm times ``factor``, rotation vector in deg."""
    place = pose[:3, 3] + SIGMA * rng.standard_normal(3)
    noise = np.radians(TURN_SIGMA) * rng.standard_normal(3)
    turned = Rotation.from_matrix(pose[:3, :3]) * Rotation.from_euler("XYZ", noise)
    return [*(factor * place), *np.degrees(turned.as_rotvec())]


def nominal() -> dict[str, float]:
    """Drawing values, mm and rad."""
    p = {
        f"{j}.{k}": v.get(k, 0.0) * (1.0 if k in "dr" else np.pi / 180)
        for j, v in JOINTS.items()
        for k in KEYS
    }
    zero = {f"{f}.{a}": 0.0 for f in ("base", "tool") for a in ("x", "y", "z", "rx", "ry", "rz")}
    return p | zero | {f"tool.{a}": v for a, v in zip(MOVES, TOOL, strict=True)}


def tolerance(name: str) -> float:
    """mm or rad."""
    part, axis = name.split(".")
    if part in ("base", "tool"):
        length, angle = {"base": (2.0, 1.0), "tool": (1.0, 0.5)}[part]
        return length if axis in MOVES else float(np.radians(angle))
    value = FREE.get(name, 0.0)
    return value if axis in "dr" else float(np.radians(value))


def machine_text(unit: str = "mm", factor: float = 1.0) -> str:
    """The arm's file with lengths in ``unit``, ``factor`` of them in a mm."""
    rows = []
    for name, constants in JOINTS.items():
        own = {k: v * (factor if k in "dr" else 1.0) for k, v in constants.items()}
        fields = ", ".join(f"{k}: {v!r}" for k, v in own.items())
        rows.append(f"    - {{name: {name}, kind: revolute, {fields}, range: [-120, 120]}}")
    free = "\n".join(f"  {n}: {v * (factor if n[-1] in 'dr' else 1.0)!r}" for n, v in FREE.items())
    xyz = [factor * v for v in TOOL]
    return (
        f"schema: truepose/machine/1\nname: arm\nunits: {{length: {unit}, angle: deg}}\n"
        "mechanism:\n  type: serial\n  joints:\n" + "\n".join(rows) + "\n"
        f"frames:\n  base: {{tolerance: {{xyz: {2 * factor!r}, rpy: 1}}}}\n"
        f"  tool: {{in: flange, xyz: {xyz}, tolerance: {{xyz: {factor!r}, rpy: 0.5}}}}\n"
        f"sensor: {{type: pose, sigma: {{xyz: {SIGMA * factor!r}, rot: {TURN_SIGMA}}}}}\n"
        f"tolerances:\n  length: 0\n  angle: 0\n{free}\n"
    )


def built(rng: np.random.Generator) -> dict[str, float]:
    """The arm as made: drawn from the tolerances."""
    return {name: value + tolerance(name) * rng.standard_normal() for name, value in nominal().items()}


def recorded(
    p: Mapping[str, float],
    rng: np.random.Generator,
    time: float | None = None,
    n: int = 30,
    factor: float = 1.0,
) -> pd.DataFrame:
    """Poses of the arm with the sensor's noise; mm times ``factor``, deg."""
    rows = []
    for k in range(n):
        q = np.radians(rng.uniform(-110, 110, len(JOINTS)))
        row = [*np.degrees(q), *noisy(tool_pose(p, q), rng, factor)]
        rows.append(row if time is None else [time + 10.0 * k, *row])
    head = [*JOINTS, "x", "y", "z", "rx", "ry", "rz"]
    return pd.DataFrame(rows, columns=head if time is None else ["time", *head])


def write_sequence(
    folder: Path,
    seed: int,
    moves: Mapping[str, Sequence[float]],
    *,
    sessions: int = 4,
    every: float | None = 24 * HOUR,
    n: int = 30,
) -> tuple[Path, list[Path]]:
    """Machine file and recordings of one arm drawn from its tolerances, ``n`` poses a session.

    ``moves`` says by how much (mm, rad) a parameter is off in each session; ``every`` are the seconds between
    sessions, None for recordings without a clock.
    """
    rng = np.random.default_rng(seed)
    p = built(rng)
    folder.mkdir(exist_ok=True)
    (folder / "arm.yaml").write_text(machine_text(), encoding="utf-8")
    files = []
    for k in range(sessions):
        there = {name: value + (moves[name][k] if name in moves else 0.0) for name, value in p.items()}
        path = folder / f"day{k}.csv"
        recorded(there, rng, None if every is None else k * every, n).to_csv(path, index=False)
        files.append(path)
    return folder / "arm.yaml", files
