"""Machines whose links, legs, rails and cross joints give way, and how far one pose is turned from another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from support import MACHINES
from support.telescope_legs import leg_rows
from support.tool_pose import HEAD
from truepose.arrays import Array
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

G = 9.80665
BEAM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, alpha: 90, range: [-180, 180]}
frames: {tool: {in: flange, xyz: [800, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.0003}}
masses: {tip: {kg: 12, com: [0, 0, 0], in: tool}}
"""
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, d: 50, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 150, range: [-90, 90]}
    - {name: q3, kind: revolute, d: 700, r: 20, range: [-90, 90]}
    - {name: q4, kind: prismatic, alpha: 90, r: 100, range: [0, 500], screw_pitch: 10}
frames: {tool: {in: flange, xyz: [300, 0, 40], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.005, rot: 0.001}}
masses:
  link2: {kg: 20, com: [300, 10, 5], in: link2}
  payload: {kg: 3, com: [0, 20, 10], in: tool}
"""
LEGS = leg_rows("length: 500, range: [-60, 60]")
POSE = "sensor: {type: pose, sigma: {xyz: 0.002, rot: 0.0005}}\n"
HEXAPOD = "mechanism:\n  type: 6-pus\n  home: [0, 0, 440, 0, 0, 0]\n  legs:\n" + LEGS
BENT = HEXAPOD + "  flexure: {length: 30}\n"
STAGE = """
mechanism:
  type: serial
  joints:
    - {name: s1, kind: prismatic, range: [-0.1, 0.1]}
    - {name: s2, kind: prismatic, alpha: -90, theta: -90, range: [-0.1, 0.1]}
sensor: {type: pose, sigma: {xyz: 0.0001, rot: 0.001}}
"""
DELTA = "".join(
    f"{line}\n"
    for line in (MACHINES / "delta.yaml").read_text(encoding="utf-8").splitlines()
    if not line.startswith(("schema:", "name:", "tolerances:", "gravity:", "#"))
).replace("sigma: {xyz: 0.02}", "sigma: {xyz: 0.004}")
TEXTS = {
    "beam": BEAM,
    "arm": ARM,
    "hexapod": HEXAPOD + POSE,
    "flexed": BENT + POSE,
    "bent": BENT + "  model: beam\n" + POSE,
    "stage": STAGE,
    "delta": DELTA,
}


def structure(folder: Path, name: str) -> Machine:
    """A machine of ``TEXTS``, read from a file in a folder."""
    path = folder / f"{name}.yaml"
    path.write_text(HEAD.format(name=name) + TEXTS[name])
    return load_machine(path)


def turn_between(one: Array, two: Array) -> Array:
    """(3,) rotation vector from one pose to the other, base frame."""
    return np.asarray(Rotation.from_matrix(two[:3, :3] @ one[:3, :3].T).as_rotvec())
