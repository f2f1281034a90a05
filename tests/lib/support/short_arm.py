"""Four revolute joints before a pose sensor; the tolerances are each test's own."""

from __future__ import annotations

from pathlib import Path

from truepose.identification.identifiability.analysis import Identifiability
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

HEAD = "schema: truepose/machine/1\nname: arm\n"
JOINTS = """mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 50, range: [-120, 120]}
    - {name: q3, kind: revolute, d: 400, range: [-120, 120]}
    - {name: q4, kind: revolute, alpha: -90, r: 350, range: [-120, 120]}
"""
FRAMES = """frames:
  base: {tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [20, 30, 80], tolerance: {xyz: 1, rpy: 1}}
"""
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.005}}\n"
POSITION = "sensor: {type: position, sigma: {xyz: 0.01}}\n"


def written(folder: Path, text: str, name: str = "arm") -> Machine:
    path = folder / f"{name}.yaml"
    path.write_text(HEAD + text, encoding="utf-8")
    return load_machine(path)


def arm(folder: Path, *free: str, sensor: str = POSE, frames: str = FRAMES) -> Machine:
    """The arm with some tolerances, ``q1.r: 0.2`` each."""
    rows = "".join(f"  {item}\n" for item in ("length: 0", "angle: 0", *free))
    return written(folder, JOINTS + frames + sensor + "tolerances:\n" + rows)


def status(found: Identifiability) -> dict[str, str]:
    return {p.name: p.status for p in found.parameters}
