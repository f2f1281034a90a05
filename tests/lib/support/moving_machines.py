"""Serial chains and hexapods with everything off its plane, and recordings of them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from support.recordings import rows_of
from support.telescope_legs import UNEVEN, leg_rows
from truepose.arrays import Array
from truepose.identification.recording.recording import Recording
from truepose.models.file.names import nearest_name
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

HEAD = "schema: truepose/machine/1\nname: {name}\n"
TOLERANCES = "tolerances: {length: 0.1, angle: 0.1}\n"
FRAMED = """
gravity: [0.5, -0.3, -9.80665]
frames:
  base: {in: world, xyz: [10, -20, 30], rpy: [4, -3, 25], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [5, -7, 60], rpy: [-8, 6, 12], tolerance: {xyz: 1, rpy: 1}}
"""
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}\n"
MOVERS = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, range: [-150, 150]}
    - {name: q2, kind: prismatic, alpha: -90, theta: -90, d: 30, range: [-150, 150]}
    - {name: q3, kind: prismatic, beta: 2, alpha: -90, theta: -90, r: 40, range: [-150, 150]}
    - {name: q4, kind: revolute, alpha: -90, theta: -90, d: 15, range: [-40, 40]}
    - {name: q5, kind: revolute, alpha: -90, theta: -90, r: 25, range: [-40, 40]}
    - {name: q6, kind: revolute, beta: -1, alpha: -90, d: 12, r: 8, range: [-40, 40]}
masses:
  link2: {kg: 20, com: [30, 10, 5], in: link2}
  payload: {kg: 3, com: [0, 20, 10], in: tool}
"""
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 128, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, r: 6, range: [-170, 170]}
    - {name: q3, kind: revolute, beta: 0, d: -612.7, range: [-170, 170]}
    - {name: q4, kind: revolute, beta: 0.2, d: -571.6, r: 163.9, range: [-170, 170]}
    - {name: q5, kind: revolute, alpha: 90, r: 115.7, range: [-170, 170]}
    - {name: q6, kind: revolute, alpha: -90, r: 92.2, range: [-170, 170]}
masses:
  upper: {kg: 12, com: [-300, 5, 40], in: link2}
  payload: {kg: 4, com: [3, 20, 10], in: tool}
"""
RAILS = ("[0, 0, 1]", "[0.1, 0, 1]", "[0, -0.2, 1]", "[1, 0.1, 0.9]", "[0, 0, 1]", "[0.1, 0.1, 1]")
CARRIED = """
tolerances: {length: 0.1, angle: 0.1, gain: 0.001}
masses:
  platform: {kg: 8, com: [10, -5, 15], in: platform}
  payload: {kg: 2, com: [50, -20, 40], in: tool}
"""


def _pus_leg(k: int) -> str:
    return f"u: {RAILS[k - 1]}, length: {500 + k}, offset: {0.1 * k}, range: [-60, 60]"


def _ups_leg(k: int) -> str:
    return f"offset: {k}, gain: 1.0{k}, range: [300, 700]"


PUS = f"""
mechanism:
  type: 6-pus
  home: [0, 0, 440, 0, 0, 0]
  legs:
{leg_rows(_pus_leg, UNEVEN)}{CARRIED}"""
UPS = f"""
mechanism:
  type: 6-ups
  home: [0, 0, 440, 0, 0, 5]
  legs:
{leg_rows(_ups_leg, UNEVEN)}{CARRIED}"""
TEXTS = {"movers": MOVERS, "arm": ARM, "pus": PUS, "ups": UPS}
SERIAL, HEXAPODS = ("movers", "arm"), ("pus", "ups")


def written(folder: Path, text: str, name: str = "m") -> Machine:
    """The machine of a text, by way of its file."""
    path = folder / f"{name}.yaml"
    tolerances = "" if "tolerances:" in text else TOLERANCES
    path.write_text(HEAD.format(name=nearest_name(name)) + tolerances + text)
    return load_machine(path)


@cache
def read_machines(folder: Path) -> Mapping[str, Machine]:
    """All of them by name, with a pose sensor, by way of files in a new folder; read once a folder."""
    folder.mkdir()
    return {name: written(folder, FRAMED + text + POSE, name) for name, text in TEXTS.items()}


def record(machine: Machine, q: Array, readings: Mapping[str, Array] | None = None, **more: Any) -> Recording:
    """A recording of these joint readings (n, nq)."""
    bare = {"files": ("f.csv",), "session_recorded": np.zeros(len(q), dtype=bool), "time": None}
    own = {"joints": machine.mechanism.readings, "observations": readings or {}}
    return rows_of(q, **own, **{**bare, **more})


def drawn(machine: Machine, rng: np.random.Generator, spread: float = 3.0) -> Array:
    """Parameters a few tolerances off their drawing."""
    sigma = np.array([p.tolerance for p in machine.parameters])
    nominal = np.array([p.nominal for p in machine.parameters])
    return nominal + spread * sigma * rng.uniform(-1, 1, len(sigma))


def nominal(machine: Machine) -> Mapping[str, float]:
    return {p.name: p.nominal for p in machine.parameters}


def named(machine: Machine, p: Array) -> Mapping[str, float]:
    return dict(zip((q.name for q in machine.parameters), p, strict=False))
