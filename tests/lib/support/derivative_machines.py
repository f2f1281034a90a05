"""An arm, two hexapods, a hybrid machine and a mount with everything off its plane, drawn and read anywhere near."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

from support.moving_machines import FRAMED, POSE
from support.telescope_legs import UNEVEN, leg_rows
from truepose.arrays import Array
from truepose.models.file.names import nearest_name
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.machine import Machine

HEAD = "schema: truepose/machine/1\nname: {name}\ntolerances: {{length: 0.2, angle: 0.1}}\n"
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, beta: 1, alpha: 2, d: 3, theta: 4, r: 20, range: [-90, 90], screw_pitch: 5}
    - {name: q2, kind: revolute, alpha: -90, r: 30, range: [-90, 90], gear_ratio: 50}
    - {name: q3, kind: revolute, beta: 1, d: 300, range: [-90, 90], gear_ratio: 80}
    - {name: q4, kind: revolute, alpha: 85, d: 20, r: 200, range: [-90, 90], gear_ratio: 100}
masses: {link3: {kg: 12, com: [150, 5, 40], in: link3}, payload: {kg: 4, com: [3, 20, 10], in: tool}}
"""
CARRIED = "masses: {platform: {kg: 8, com: [10, -5, 15], in: platform}, payload: {kg: 2, com: [5, -2, 40], in: tool}}\n"


def hexapod(kind: str, tail: str) -> str:
    legs = leg_rows(f"{tail}, screw_pitch: 4", UNEVEN)
    return f"mechanism:\n  type: {kind}\n  home: [0, 0, 440, 0, 0, 5]\n  legs:\n{legs}{CARRIED}"


HYBRID = """
mechanism: {type: 3ups-up-3r, base_radius: 350, platform_radius: 135, platform_offset: 345, wrist_offset: 405,
  head: 120, tool: 250, limb_range: [800, 1000], wrist_range: [-40, 40], screw_pitch: 10}
"""
MOUNT = """
mechanism: {type: mount, kind: equatorial, latitude: 39, first: {name: ha, range: [-15, 195]},
  second: {name: dec, range: [-60, 240]}}
sensor: {type: direction, sigma: {angle: 1 arcsec}}
"""
MACHINES: Mapping[str, str] = {
    "arm": FRAMED + ARM + POSE,
    "6-pus": FRAMED + hexapod("6-pus", "u: [0.1, -0.05, 1], length: 500, range: [-60, 60]") + POSE,
    "6-ups": FRAMED + hexapod("6-ups", "gain: 1.02, offset: 3, range: [480, 540]") + POSE,
    "hybrid": HYBRID + POSE,
    "mount": MOUNT,
}


def written(folder: Path, text: str, name: str = "m") -> Machine:
    """The machine of a text, by way of its file."""
    path = folder / f"{name}.yaml"
    path.write_text(HEAD.format(name=nearest_name(name)) + text)
    return load_machine(path)


@cache
def read_machines(folder: Path) -> Mapping[str, Machine]:
    """All of them by name, by way of files in a folder; read once a folder."""
    return {name: written(folder, text, name) for name, text in MACHINES.items()}


def readings(machine: Machine, rng: np.random.Generator, n: int = 1) -> Array:
    """(n, nq) within the middle 60 % of the ranges."""
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    out: Array = ranges.mean(axis=1) + 0.3 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (n, len(ranges)))
    return out


def symbols_of(model: SymbolicModel) -> list[ca.SX]:
    """What its functions take: passive coordinates, readings, drivers, parameters."""
    return [model.x, model.q, model.z, model.p]
