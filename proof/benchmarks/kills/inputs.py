"""Small files for every command that writes: an arm of three joints with play, and what was read of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from truepose.identification.prediction.simulate import simulate, with_inputs
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.table import read_table
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine

MACHINE = """schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-100, 100]}
    - {name: q2, kind: revolute, alpha: 90, d: 25, range: [-60, 60]}
    - {name: q3, kind: revolute, d: 450, range: [-60, 60]}
frames:
  tool: {in: flange, xyz: [360, 30, 40], tolerance: {xyz: 1}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.1, angle: 0.1}
"""
ROBOT = """schema: truepose/machine/1
name: robot
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-100, 100]}
    - {name: q2, kind: revolute, alpha: 90, d: 25, range: [-60, 60]}
    - {name: q3, kind: revolute, d: 450, range: [-60, 60]}
    - {name: q4, kind: revolute, alpha: 90, d: 35, r: 420, range: [-90, 90]}
    - {name: q5, kind: revolute, alpha: -90, range: [20, 90]}
    - {name: q6, kind: revolute, alpha: 90, range: [-90, 90]}
frames:
  base: {in: world, tolerance: {xyz: 1, rpy: 0.1}}
  tool: {in: flange, xyz: [60, 30, 40], tolerance: {xyz: 1}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.1, angle: 0.1}
"""
JOB = """DEF job()
$BASE=BASE_DATA[1]
PTP {{A1 {first},A2 20.0,A3 -15.0,A4 30.0,A5 45.0,A6 5.0}}
END
"""
POINTS = """// SpatialAnalyzer, units: mm
Cell::A::P1, {x}, -318.227, 902.118
Cell::A::P2, 1105.090, -77.914, 1210.332
"""
JOINTS = "point,q1,q2,q3\nP1,-31.2,42.0,-18.5\nP2,-8.0,20.5,-31.0\n"
FLEET = ("a", "b")
"""Machines of a fleet."""


def write_inputs(folder: Path) -> None:
    """All of them, the first and the second of each kind."""
    folder.mkdir(parents=True)
    (folder / "machine.yaml").write_text(MACHINE, encoding="utf-8")
    (folder / "robot.yaml").write_text(ROBOT, encoding="utf-8")
    (folder / "joints.csv").write_text(JOINTS, encoding="utf-8")
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        other = MACHINE.replace("xyz: [360", f"xyz: [36{seed}")
        (folder / f"machine{seed}.yaml").write_text(other, encoding="utf-8")
        values = {
            "q1": rng.uniform(-90, 90, 24),
            "q2": rng.uniform(-50, 50, 24),
            "q3": rng.uniform(-50, 50, 24),
        }
        side = {f"approach.{name}": rng.choice([-1, 1], 24) for name in values}
        pd.DataFrame(values | side).to_csv(folder / f"poses{seed}.csv", index=False)
        for day in "ab":
            _simulate(folder, seed, day)
        wrong = pd.read_csv(folder / f"rows{seed}a.csv")
        wrong[["x", "y", "z"]] /= 1000.0
        wrong.to_csv(folder / f"metres{seed}.csv", index=False)
        (folder / f"job{seed}.src").write_text(JOB.format(first=10.0 + seed), encoding="utf-8")
        (folder / f"points{seed}.txt").write_text(POINTS.format(x=1240.512 + seed), encoding="utf-8")
        _write_seen(folder / f"seen{seed}.csv", rng)
        for name in FLEET:
            place = folder / f"line{seed}" / name
            place.mkdir(parents=True)
            (place / "machine.yaml").write_text(MACHINE, encoding="utf-8")
            day = "ab"[FLEET.index(name)]
            (place / "recording.csv").write_bytes((folder / f"rows{seed}{day}.csv").read_bytes())


def _simulate(folder: Path, seed: int, day: str) -> None:
    machine = load_machine(folder / "machine.yaml")
    whole = machine.with_effects((parse_effect("backlash@q3:b=1e-3", machine),))
    poses = folder / f"poses{seed}.csv"
    rows = load_recording(machine, [poses], need_observations=False)
    frame = with_inputs(read_table(poses), simulate(whole, rows, seed=10 * seed + ord(day)))
    frame.to_csv(folder / f"rows{seed}{day}.csv", index=False)


def _write_seen(path: Path, rng: np.random.Generator) -> None:
    """Four points of a body, seen six times."""
    points = rng.uniform(-100, 100, (4, 3))
    seen = {
        f"P{k + 1}.{axis}": points[k, j] + rng.normal(0.0, 0.005, 6)
        for k in range(4)
        for j, axis in enumerate("xyz")
    }
    pd.DataFrame(seen).to_csv(path, index=False)


__all__ = ["write_inputs"]
