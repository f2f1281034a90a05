"""Machines that physics effects are tried on: arms, slides, hexapods, graphs, and the sensors that see them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from support import MACHINES
from support.moving_machines import written
from support.telescope_legs import leg_rows
from truepose.models.machine.machine import Machine

ARM = """
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, d: 50, range: [-170, 170], gear_ratio: 121}
    - {name: q2, kind: revolute, alpha: 90, d: 150, range: [-90, 90], gear_ratio: 141}
    - {name: q3, kind: revolute, d: 700, r: 20, range: [-90, 90]}
frames: {tool: {in: flange, xyz: [300, 0, 40], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: position, sigma: {xyz: 0.01}}
masses:
  link2: {kg: 20, com: [300, 10, 5], in: link2}
  payload: {kg: 3, com: [0, 20, 10], in: tool}
"""
STAGE = """
mechanism:
  type: serial
  joints:
    - {name: s1, kind: prismatic, range: [-150, 150], screw_pitch: 5}
    - {name: s2, kind: prismatic, alpha: -90, theta: -90, d: 30, range: [-20, 40], screw_pitch: 4}
    - {name: s3, kind: revolute, alpha: -90, r: 60, range: [-3, 3], gear_ratio: 100}
frames: {tool: {in: flange, xyz: [10, 20, 80], rpy: [5, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.001}}
"""
HEXAPOD = """
gravity: [0, 0, -9.80665]
mechanism:
  type: 6-pus
  home: [0, 0, 440, 0, 0, 0]
  legs:
"""
CARRIED = """
frames: {tool: {in: flange, xyz: [0, 0, 30], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.001}}
masses:
  platform: {kg: 8, com: [0, 0, 15], in: platform}
  payload: {kg: 2, com: [50, -20, 40], in: tool}
"""
_PUS = leg_rows("length: 500, range: [-1.3, 1.3], screw_pitch: 1")
_UPS = leg_rows("offset: 500, gain: 5, range: [-9, 9], screw_pitch: 5", joint="m")
TELESCOPE = HEXAPOD + _PUS + "  flexure: {length: 30}\n" + CARRIED
GOUGH = "units: {joint: turn}" + HEXAPOD.replace("6-pus", "6-ups") + _UPS + CARRIED
GRAPH = """
gravity: [0, 0, -9.80665]
mechanism:
  type: graph
  bodies: [pedestal, trunk, arm, carriage, hand]
  joints:
    - {name: waist, kind: revolute, parent: pedestal, child: trunk, xyz: [0, 10, 300], actuated: true,
       range: [-170, 170], gear_ratio: 121}
    - {name: shoulder, kind: revolute, parent: trunk, child: arm, xyz: [40, 0, 100], rpy: [-90, 0, 0],
       axis: [0, 0.6, 0.8], actuated: true, range: [-90, 90], gear_ratio: 100}
    - {name: boom, kind: prismatic, parent: arm, child: carriage, xyz: [250, 0, 0], axis: [1, 0, 0], actuated: true,
       range: [-200, 200], screw_pitch: 10}
    - {name: bracket, kind: fixed, parent: carriage, child: hand, xyz: [60, 5, -20], rpy: [0, 30, 0]}
frames: {tool: {in: flange, xyz: [10, 20, 80], rpy: [5, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.001}}
masses:
  arm: {kg: 9, com: [100, 10, 5], in: arm}
  payload: {kg: 3, com: [0, 20, 10], in: tool}
"""
CAMERA = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, d: 50, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 150, range: [-90, 90]}
frames:
  base: {in: world, xyz: [150, -100, 900], rpy: [5, -3, 40], tolerance: {xyz: 1, rpy: 1}}
  tool: {in: flange, xyz: [300, 0, 40], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 1}}
sensor:
  type: targets
  points: {A1: [30, 0, 10], A2: [-20, 40, 0], A3: [0, -50, 5]}
  sigma: {xyz: 0.01}
"""
CAVITY = """
mechanism:
  type: serial
  joints:
    - {name: s1, kind: prismatic, alpha: 90, range: [-5, 5]}
    - {name: s2, kind: prismatic, alpha: 90, range: [-5, 5]}
    - {name: q3, kind: revolute, range: [-3, 3]}
sensor:
  type: distance
  beam: {in: world, xyz: [0.1, 0.9, 0.1], rx: 90.7, rz: -0.5}
  mirror: {in: flange, z: 0.2, rx: 88, ry: -0.6}
  sigma: {distance: 0.00001}
  tolerance: {beam.xyz: 2, beam.angle: 2, mirror.z: 1, mirror.angle: 2}
  wavelength: 0.00155
"""
HEAD = ("schema:", "name:", "tolerances:")


def _machine(name: str) -> str:
    """A machine of the tests, without what ``written`` adds itself."""
    lines = (MACHINES / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    return "".join(f"{line}\n" for line in lines if not line.startswith(HEAD))


UNWEIGHED = ARM.split("masses:", maxsplit=1)[0]
MOUNT = """
mechanism: {type: mount, kind: equatorial, latitude: 39}
sensor: {type: direction, sigma: {angle: 1 arcsec}}
"""
ENCODED = ARM.replace(
    "sensor: {type: position, sigma: {xyz: 0.01}}",
    "sensor:\n  - {type: position, sigma: {xyz: 0.01}}\n  - {type: angle, joints: [q1, q3], sigma: {angle: 2 arcsec}}",
)
TEXTS = {
    "mount": MOUNT,
    "arm": ARM,
    "stage": STAGE,
    "telescope": TELESCOPE,
    "gough": GOUGH,
    "unweighed": UNWEIGHED,
    "hybrid": _machine("hybrid"),
    "planar": _machine("planar"),
    "graph": GRAPH,
    "camera": CAMERA,
    "cavity": CAVITY,
    "encoded": ENCODED,
}
READINGS = {
    "mount": [0.4, 0.7],
    "arm": [0.5, -0.4, 0.8],
    "stage": [60.0, 13.0, 0.03],
    "unweighed": [0.5, -0.4, 0.8],
    "telescope": [0.9, -0.5, 0.3, 1.1, -0.8, 0.2],
    "gough": [2.0, -3.0, 1.0, 4.0, 0.5, -2.0],
    "hybrid": [700.0, 760.0, 730.0, 0.3, -0.4, 0.5],
    "planar": [0.55, 2.7, -1.5],
    "graph": [0.5, -0.4, 80.0],
    "camera": [0.5, -0.4],
    "cavity": [1.5, -0.7, 0.03],
    "encoded": [0.5, -0.4, 0.8],
}
STRAIGHT = {"hybrid": [730.0, 730.0, 730.0, 0.0, 0.0, 0.0]}


Machines = Mapping[str, Machine]
"""By name."""


@cache
def read_machines(folder: Path) -> Machines:
    """All of them by name, by way of files in a new folder; read once a folder."""
    folder.mkdir()
    return {name: written(folder, text, name) for name, text in TEXTS.items()}
