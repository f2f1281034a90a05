"""Machines as a calibration leaves them, the same with the drawing's links, and paths for them. mm, rad."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from support import MACHINES, ROOT
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

POLISHER = ROOT / "models" / "machines" / "polisher" / "machine.yaml"
SIX_AXES = """
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 25, theta: -90, range: [-120, 60]}
    - {name: q3, kind: revolute, d: 455, range: [-100, 120]}
    - {name: q4, kind: revolute, alpha: -90, d: 35, r: 420, range: [-180, 180]}
    - {name: q5, kind: revolute, alpha: 90, range: [-120, 120]}
    - {name: q6, kind: revolute, alpha: -90, r: 80, range: [-350, 350]}
frames:
  base: {xyz: [100, 20, 5], rpy: [1, 2, 40], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [10, 0, 120], rpy: [0, 20, 0], tolerance: {xyz: 1, rpy: 0.5}}
sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}
tolerances: {length: 0.2, angle: 0.05}
"""
LOADED = (
    SIX_AXES
    + """
units: {length: mm, angle: deg}
gravity: [0, 0, -9.80665]
masses:
  forearm: {kg: 12, com: [0, 0, 100], in: link4}
  payload: {kg: 2, com: [0, 0, 50], in: tool}
drivers: [payload]
effects:
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 4.0e-6, unit: rad/(N*m)}}}
"""
)
RAIL = (
    LOADED.replace(
        "kind: revolute, r: 400, range: [-170, 170]", "kind: prismatic, alpha: -90, range: [-300, 300]"
    )
    .replace("alpha: -90, d: 25,", "d: 25,")
    .replace("drivers: [payload]", "drivers: [payload, temperature.link2]")
    + "  - {effect: thermal-expansion, place: [link2], parameters: {alpha: {value: 2.3e-5, unit: 1/K}}}\n"
)
"""The loaded arm on a rail in place of its first axis, with a link that grows warm."""


def calibrated(kind: str, folder: Path, size: float = 1.0) -> Machine:
    """A machine as a calibration leaves it: values off by so many tolerances, the drawing's in ``nominal:``."""
    source = {"polisher": POLISHER, "hexapod": MACHINES / "ups.yaml"}.get(kind)
    text = source.read_text() if source is not None else RAIL if kind == "rail" else LOADED
    plain = folder / "plain.yaml"
    plain.write_text(text)
    machine = load_machine(plain)
    document: dict[str, Any] = yaml.safe_load(text)
    if machine.mechanism.expanded is not None:
        document["mechanism"] = _plain(machine.mechanism.expanded)
    rng = np.random.default_rng(4)
    nominal = {}
    turn = np.degrees(1.0)
    for parameter in machine.parameters:
        if not parameter.free or not parameter.field:
            continue
        off = size * (parameter.tolerance if np.isfinite(parameter.tolerance) else 1.0) * rng.normal()
        nominal[parameter.name] = parameter.nominal
        _put(
            document, parameter.field, (parameter.nominal + off) * (turn if parameter.unit == "rad" else 1.0)
        )
    document["nominal"] = nominal
    if size == 0.0:
        document.pop("effects", None)
    path = folder / "calibrated.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return load_machine(path)


def with_drawing(machine: Machine, folder: Path) -> Machine:
    """The same file with nominal links, its own frames, and no effect."""
    assert machine.file is not None
    document = _plain(machine.file.raw)
    nominal = document.pop("nominal")
    document.pop("effects", None)
    for parameter in machine.mechanism.parameters:
        if parameter.name in nominal:
            turn = np.degrees(1.0) if parameter.unit == "rad" else 1.0
            _put(document, parameter.field, nominal[parameter.name] * turn)
    path = folder / "ideal.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return load_machine(path)


def path_file(machine: Machine, folder: Path, count: int = 40, **columns: Any) -> Path:
    """Nominal joints in the middle third of their ranges, in the unit that the header says."""
    rng = np.random.default_rng(6)
    data: dict[str, Any] = dict(columns)
    for actuator in machine.mechanism.actuators:
        assert actuator.range is not None
        middle, half = np.mean(actuator.range), np.ptp(actuator.range) / 6
        data[f"{actuator.reading} [{actuator.reading_unit}]"] = middle + half * rng.uniform(-1, 1, count)
    path = folder / "path.csv"
    pd.DataFrame(data).to_csv(path, index=False)
    return path


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _put(document: Any, field: tuple[str | int, ...], value: float) -> None:
    for key in field[:-1]:
        if isinstance(document, dict):
            document = document.setdefault(key, {} if key not in {"xyz", "rpy"} else [0.0, 0.0, 0.0])
        else:
            document = document[key]
    document[field[-1]] = float(value)
