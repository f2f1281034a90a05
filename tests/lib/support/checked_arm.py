"""A six-axis arm in standard DH and readings of it by formulas of its own: a right pair for the gate, to be spoilt."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.spatial.transform import Rotation

import truepose
from support.plain_kinematics import frame, step
from truepose.identification.leaves.check.result import Check
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.run import check_files
from truepose.models.file.yaml_document import document_text

JOINTS = tuple(f"q{k}" for k in range(1, 7))


ARM: dict[str, Any] = yaml.safe_load("""
schema: truepose/machine/1
name: arm
gravity: [0.0, 0.0, -9.80665]
mechanism:
  type: serial
  convention: standard
  joints:
    - {name: q1, kind: revolute, a: 30.0, alpha: -90.0, d: 380.0, theta: 0.0}
    - {name: q2, kind: revolute, a: 440.0, alpha: 0.0, d: 0.0, theta: -90.0}
    - {name: q3, kind: revolute, a: 35.0, alpha: -90.0, d: 0.0, theta: 0.0}
    - {name: q4, kind: revolute, a: 0.0, alpha: 90.0, d: 420.0, theta: 0.0}
    - {name: q5, kind: revolute, a: 0.0, alpha: -90.0, d: 0.0, theta: 0.0}
    - {name: q6, kind: revolute, a: 0.0, alpha: 0.0, d: 80.0, theta: 0.0}
frames:
  base: {in: world, xyz: [900.0, -300.0, 150.0], rpy: [2.0, -1.0, 70.0], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [60.0, -40.0, 130.0], rpy: [10.0, 20.0, 30.0], tolerance: {xyz: 2, rpy: 0.5}}
sensor: {type: pose, sigma: {xyz: 0.03, rot: 0.005}}
tolerances: {length: 0.2, angle: 0.05}
masses: {forearm: {kg: 8.0, com: [0.0, 0.0, 100.0], in: link4}}
""")
ROWS, FEW = 45, 12
EXACT: dict[str, Any] = {"type": "pose", "sigma": {"xyz": 0.03, "rot": 0.005}}
Document = dict[str, Any]
Spoilt = tuple[Document, pd.DataFrame]


def standing(where: Document) -> np.ndarray:
    return frame(where["xyz"], np.radians(where["rpy"]))


def recorded(seed: int = 3) -> pd.DataFrame:
    """Poses of an arm that is not quite the drawing, worked out from the table here, with noise; deg."""
    rng = np.random.default_rng(seed)
    low, high = np.array([-150, -80, -60, -170, -100, -170]), np.array([150, 60, 120, 170, 100, 170])
    q = np.radians(rng.uniform(low, high, (ROWS, 6)))
    pose = np.tile(standing(ARM["frames"]["base"]), (ROWS, 1, 1))
    for k, row in enumerate(ARM["mechanism"]["joints"]):
        off = rng.standard_normal(4) * [0.2, 0.0009, 0.2, 0.0009]
        pose = pose @ step([0.0, 0.0, 0.0, np.radians(row["theta"]) + off[1], row["d"] + off[0]], q[:, k])
        pose = pose @ step([0.0, np.radians(row["alpha"]) + off[3], row["a"] + off[2], 0.0, 0.0])
    pose = pose @ standing(ARM["frames"]["tool"])
    noise = rng.standard_normal((ROWS, 6)) * [0.03, 0.03, 0.03, 9e-5, 9e-5, 9e-5]
    seen = Rotation.from_matrix(pose[:, :3, :3]) * Rotation.from_rotvec(noise[:, 3:])
    values = np.hstack([np.degrees(q), pose[:, :3, 3] + noise[:, :3], np.degrees(seen.as_rotvec())])
    return pd.DataFrame(values, columns=[*JOINTS, "x", "y", "z", "rx", "ry", "rz"])


def document(**changes: Any) -> Document:
    copy: Document = json.loads(json.dumps(ARM))
    return {key: value for key, value in {**copy, **changes}.items() if value is not None}


def written(folder: Path, machine: Document, rows: pd.DataFrame) -> tuple[Path, Path]:
    (folder / "arm.yaml").write_text(document_text(machine), encoding="utf-8")
    rows.to_csv(folder / "r.csv", index=False)
    return folder / "arm.yaml", folder / "r.csv"


def checked(folder: Path, machine: Document, rows: pd.DataFrame) -> Check:
    paths = written(folder, machine, rows)
    return check_files(paths[0], [paths[1]])[0]


def columns(rows: pd.DataFrame, change: Callable[[pd.Series], Any], *names: str) -> Spoilt:
    out = rows.copy()
    for name in names:
        out[name] = change(out[name])
    return document(), out


def metres(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: v / 1000, "x", "y", "z")


def rig_of(folder: Path, stated: Document, real: Document | None = None, rows: int = FEW) -> Rig:
    """A machine as stated, with readings without noise of a real one."""
    q = pd.DataFrame(np.random.default_rng(3).uniform(-80, 80, (rows, 6)), columns=list(JOINTS))
    read = truepose.simulate(truepose.load_machine(written(folder, real or stated, q)[0]), q, seed=None)
    both = pd.concat([q, read.reset_index(drop=True)], axis=1)
    machine = truepose.load_machine(written(folder, stated, both)[0])
    return Rig(machine, truepose.load_recording(machine, both))
