"""Machines of every kind whose joints' columns hold something else: counts, other joints' motion, readings modulo a turn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from support import MACHINES
from truepose.arrays import Array
from truepose.models.file.machine_file import write_machine
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.units import convert

Keys = Mapping[str, Mapping[str, Any]]
URDF = """<robot name="pair">
  <link name="base"/> <link name="lower"/> <link name="upper"/>
  <joint name="shoulder" type="revolute"> <parent link="base"/> <child link="lower"/> <origin xyz="0 0 0.3"/>
    <axis xyz="0 1 0"/> <limit lower="-3" upper="3"/> </joint>
  <joint name="elbow" type="revolute"> <parent link="lower"/> <child link="upper"/> <origin xyz="0.4 0 0.1"/>
    <axis xyz="0 1 0"/> <limit lower="-3" upper="3"/> </joint>
</robot>"""
OTHERS = {
    "pair": """
schema: truepose/machine/1
name: pair
mechanism:
  {type: urdf, file: pair.urdf, base_link: base, tip_link: upper, joints: {shoulder: J2, elbow: J3}}
frames: {tool: {in: flange, xyz: [200, 30, 10]}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.1, angle: 0.1}
""",
    "star": """
schema: truepose/machine/1
name: star
mechanism: {type: mount, kind: alt-az}
sensor: {type: direction, sigma: {angle: 0.001}}
tolerances: {length: 0.1, angle: 0.1}
""",
}
COUPLED: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "serial": {"q3": {"q2": 1.0}, "q2": {"q1": 0.02}},
    "distance": {"t": {"x": 0.05}},
    "delta": {"m2": {"m1": -0.5}},
    "planar": {"a1": {"a2": 1.0, "a3": 0.25}},
    "pus": {"rho2": {"rho1": 0.1}},
    "ups": {"m2": {"m1": 1.0}, "m3": {"m2": -1.0}},
    "hybrid": {"q5": {"q4": 1.0}, "q6": {"q4": -1.0, "q5": 0.5}},
    "pair": {"J3": {"J2": 1.0}},
    "star": {"alt": {"az": 0.1}},
}
"""Of each kind of machine, which readings hold how much of which others."""


def document(name: str) -> dict[str, Any]:
    """Return the machine's document, without the ranges of its joints."""
    text = OTHERS.get(name) or (MACHINES / f"{name}.yaml").read_text(encoding="utf-8")
    out: dict[str, Any] = yaml.safe_load(text)
    for row in _rows(out):
        row.pop("range", None)
    return out


def encoded(folder: Path, name: str, keys: Keys, **more: Any) -> Machine:
    """Return the machine with these keys of its joints, by way of its file; ``more``: sections of the file."""
    changed = {**document(name), **more}
    rows = {row.get("joint", row["name"]): row for row in _rows(changed)}
    for joint, own in keys.items():
        if joint in rows:
            rows[joint] |= dict(own)
        elif name == "star":
            changed["mechanism"].setdefault("first" if joint == "az" else "second", {}).update(own)
        else:
            changed["mechanism"].setdefault("encoders", {})[joint] = dict(own)
    (folder / "pair.urdf").write_text(URDF, encoding="utf-8")
    path = folder / f"{name}.yaml"
    write_machine(path, changed)
    return load_machine(path)


def own_readings(machine: Machine, rows: int, seed: int) -> dict[str, list[float]]:
    """Return columns of a plain machine, in the file's units: small ways about where its loops close."""
    rng, out = np.random.default_rng(seed), {}
    for actuator in machine.mechanism.actuators:
        home = _home(machine, actuator.reading)
        out[actuator.reading] = (home + rng.uniform(-0.8, 0.8, rows)).tolist()
    return out


def as_recorded(machine: Machine, columns: Mapping[str, list[float]], name: str) -> dict[str, Array]:
    """Return the columns of the machine with `COUPLED` joints whose own ways are ``columns``."""
    own = {joint: np.array(values) for joint, values in columns.items()}
    out = dict(own)
    for _ in own:  # chains of couplings settle
        out = {
            joint: own[joint]
            + sum((k * out[other] for other, k in COUPLED[name].get(joint, {}).items()), 0.0)
            for joint in own
        }
    return {joint: np.asarray(values) for joint, values in out.items()}


def in_counts(machine: Machine, columns: Mapping[str, Array], counts: float) -> dict[str, Array]:
    """Return columns of a machine as counts, so many a turn or a mm."""
    out = {}
    for joint, values in columns.items():
        unit = machine.column_unit(joint)
        out[joint] = counts * convert(np.asarray(values), unit, "mm" if unit == "mm" else "turn")
    return out


def _home(machine: Machine, reading: str) -> float:
    if machine.name == "hybrid" and reading in ("q1", "q2", "q3"):
        return 730.0
    if machine.name == "planar":
        return {"a1": 30.0, "a2": 151.0, "a3": -91.0}[reading]
    return 20.0 if machine.name in ("pair", "star", "arm") else 0.0


def _rows(changed: Mapping[str, Any]) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = changed["mechanism"].get("joints", changed["mechanism"].get("legs", []))
    return rows if isinstance(rows, list) else []
