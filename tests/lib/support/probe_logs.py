"""A probe's file and a robot's log of one run, with a clock each: motion, kinematics and clocks in plain numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from support.plain_kinematics import chain, frame
from truepose.arrays import Array

JOINTS = ((0, 0, 330), (50, -90, 0), (440, 0, 0), (35, -90, 420), (0, 90, 0), (0, -90, 80))
"""d (mm), alpha (deg) and r (mm) of each joint."""
MACHINE = """schema: truepose/machine/1
name: cell
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 330}
    - {name: q2, kind: revolute, alpha: -90, d: 50, theta: -90}
    - {name: q3, kind: revolute, d: 440}
    - {name: q4, kind: revolute, alpha: -90, d: 35, r: 420}
    - {name: q5, kind: revolute, alpha: 90}
    - {name: q6, kind: revolute, alpha: -90, r: 80}
frames:
  base: {in: world, tolerance: {xyz: .inf, rpy: .inf}}
  tool: {in: flange, tolerance: {xyz: .inf, rpy: .inf}}
sensor: {type: pose, sigma: {xyz: 0.02, rot: 0.002}}
tolerances: {length: 0.3, angle: 0.05}
"""
OFFSET, OFF = 1234.56789, 0.1
"""s that the log's clock is before the probe's; deg that the third joint's zero is off."""
START = 5000.0


def joints_at(time: Array, period: float = 0.0) -> Array:
    """(n, 6) deg: from pose to pose in 2.1 s, a rest of 0.9 s; the same poses again after ``period`` s."""
    goals = np.random.default_rng(3).uniform(-60, 60, (400, 6))
    time = time % period if period else time
    k = (time // 3).astype(int)
    s = np.clip((time / 3 - k) / 0.7, 0, 1)
    last = round(period / 3) if period else 400
    way = (s**3 * (10 - 15 * s + 6 * s * s))[:, None]
    return np.asarray(goals[k] + (goals[(k + 1) % last] - goals[k]) * way)


def pose_of(q: Array) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and places (n, 3), mm, of the probe by the tracker."""
    zeros = np.radians([0.0, -90.0, OFF, 0.0, 0.0, 0.0])
    rows = [(0.0, np.radians(alpha), d, zero, r) for (d, alpha, r), zero in zip(JOINTS, zeros, strict=True)]
    pose = chain(rows, np.radians(q), np.eye(4), frame([20.0, 30.0, 90.0]))
    turn, place = pose[:, :3, :3], pose[:, :3, 3]
    base = Rotation.from_euler("ZYX", [140, 3, -5], degrees=True).as_matrix()
    probe = Rotation.from_euler("ZYX", [10, 20, 30], degrees=True).as_matrix()
    return base @ turn @ probe, place @ base.T + [1500, -300, 200]


def written(folder: Path, seconds: float, ppm: float = 0.0, period: float = 0.0) -> tuple[Path, Path]:
    """probe.csv (100 Hz, jitter, noise of 0.02 mm) and robot.csv (125 Hz), in folders' files."""
    rng = np.random.default_rng(1)
    logged = np.arange(0, seconds, 0.008)
    log = pd.DataFrame(joints_at(logged, period), columns=[f"q{k}" for k in range(1, 7)])
    log = log + 1e-4 * rng.standard_normal(log.shape)
    log.insert(0, "Timestamp", logged + START)
    log["temperature.air"], log["session"] = 21.5, 4
    log.to_csv(folder / "robot.csv", index=False)
    seen = np.arange(3, seconds - 4, 0.01)
    seen = seen + rng.uniform(0, 1e-3, len(seen))
    turn, place = pose_of(joints_at(seen, period))
    place = place + 0.02 * rng.standard_normal(place.shape)
    clock = seen + START - OFFSET - ppm * 1e-6 * (seen - seconds / 2)
    quaternion = Rotation.from_matrix(turn).as_quat()
    probe = np.column_stack([clock, place, quaternion])
    names = ["time", "x", "y", "z", "qx", "qy", "qz", "qw"]
    pd.DataFrame(probe, columns=names).to_csv(folder / "probe.csv", index=False)
    (folder / "cell.yaml").write_text(MACHINE)
    return folder / "probe.csv", folder / "robot.csv"
