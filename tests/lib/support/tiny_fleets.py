"""Small fleets: arms of two joints beside a tracker, some with a gain or a play that their model lacks. mm, deg."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from support.plain_kinematics import step
from truepose.arrays import Array

SIGMA, LENGTH, ANGLE = 0.01, 0.1, 0.0005
MACHINE = """schema: truepose/machine/1
name: tiny
units: {{length: mm, angle: deg}}
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, r: 300, range: [-170, 170]}}
    - {{name: q2, kind: revolute, alpha: -90, d: 100, range: [-90, 90]}}
frames: {{tool: {{in: flange, xyz: [400, 50, 30], tolerance: {{xyz: {length}}}}}}}
sensor: {{type: position, sigma: {{xyz: {sigma}}}}}
tolerances: {{length: {length}, angle: {angle}}}
"""
NOMINAL = {
    "q1.alpha": 0.0, "q1.beta": 0.0, "q1.d": 0.0, "q1.theta": 0.0, "q1.r": 300.0,
    "q2.alpha": -np.pi / 2, "q2.beta": 0.0, "q2.d": 100.0, "q2.theta": 0.0, "q2.r": 0.0,
    "tool.x": 400.0, "tool.y": 50.0, "tool.z": 30.0,
}  # fmt: skip
JOINTS = ("q1", "q2")
LIMITS = np.radians([170.0, 90.0])
ROWS = 16


@dataclass(frozen=True)
class Fault:
    """A gain (rad per rad) or a play (rad) of a joint."""

    kind: str
    joint: str
    size: float


GAIN = Fault("gain", "q1", 2e-3)
PLAY = Fault("play", "q2", 2e-3)


def machine_text(sigma_factor: float = 1.0, tolerance_factor: float = 1.0) -> str:
    """The arm's file."""
    lengths, angles = LENGTH * tolerance_factor, float(np.degrees(ANGLE)) * tolerance_factor
    return MACHINE.format(length=lengths, angle=angles, sigma=SIGMA * sigma_factor)


def built(rng: np.random.Generator, scale: float = 1.0) -> dict[str, float]:
    """The arm as made: off its drawing by its tolerances, mm and rad."""
    spread = {n: LENGTH if n[-1] in "drxyz" else ANGLE for n in NOMINAL}
    return {n: v + scale * spread[n] * rng.standard_normal() for n, v in NOMINAL.items()}


def points(p: Mapping[str, float], q: Array) -> Array:
    """(n, 3) points of the tool at joints (n, 2): forward kinematics written out, mm and rad."""
    pose = np.eye(4)
    for k, joint in enumerate(JOINTS):
        pose = pose @ step([p[f"{joint}.{key}"] for key in ("beta", "alpha", "d", "theta", "r")], q[:, k])
    point = pose @ [p["tool.x"], p["tool.y"], p["tool.z"], 1.0]
    return np.asarray(point[:, :3])


def rows(seed: int, faults: Sequence[Fault] = (), count: int = ROWS) -> pd.DataFrame:
    """A recording: readings of the joints and of the tracker, and the sides that joints came from."""
    rng = np.random.default_rng(seed)
    q = LIMITS * rng.uniform(0.0, 0.95, (count, 2)) * rng.choice([-1, 1], (count, 2))
    q = np.radians(np.degrees(q).round(6))
    side, moved = rng.choice([-1.0, 1.0], (count, 2)), q.copy()
    rng.choice([0.0, 5.0], count), rng.random(count)  # a payload and a temperature that nothing depends on
    for fault in faults:
        k = JOINTS.index(fault.joint)
        moved[:, k] += fault.size * q[:, k] if fault.kind == "gain" else -fault.size / 2 * side[:, k]
    exact = points(built(rng), moved)
    readings = exact + SIGMA * rng.standard_normal(exact.shape)
    columns = {name: np.degrees(q[:, k]) for k, name in enumerate(JOINTS)}
    columns |= {name: readings[:, k] for k, name in enumerate("xyz")}
    columns |= {f"approach.{name}": side[:, k] for k, name in enumerate(JOINTS)}
    return pd.DataFrame(columns)


def write_machine(folder: Path, recording: pd.DataFrame, name: str = "recording.csv") -> None:
    """A folder of one machine."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.yaml").write_text(machine_text(), encoding="utf-8")
    recording.to_csv(folder / name, index=False)


def write_fleet(folder: Path, faults: Mapping[str, Sequence[Fault]]) -> Path:
    """A folder of machines by name."""
    for seed, (name, own) in enumerate(faults.items()):
        write_machine(folder / name, rows(seed, own))
    return folder
