"""Machines with a recording, and the same told otherwise: in other units, in another order, from another base."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from support.telescope_legs import ENDS
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predict import simulate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Document = dict[str, Any]
BASE = {"xyz": [10.0, -20.0, 30.0], "rpy": [4.0, -3.0, 25.0], "tolerance": {"xyz": 5.0, "rpy": 1.0}}
TOOL = {"xyz": [5.0, -7.0, 60.0], "rpy": [0.0, 0.0, 0.0], "tolerance": {"xyz": 1.0, "rpy": 0.5}}
POSE = {"type": "pose", "sigma": {"xyz": 0.01, "rot": 0.005}}
MECHANISMS: Mapping[str, Document] = {
    "arm": {
        "type": "serial",
        "joints": [
            {"name": "q1", "kind": "prismatic", "r": 0.0, "range": [-150.0, 150.0]},
            {"name": "q2", "kind": "revolute", "alpha": 90.0, "d": 40.0, "r": 100.0, "range": [-90.0, 90.0]},
            {"name": "q3", "kind": "revolute", "d": 300.0, "range": [-90.0, 90.0]},
        ],
    },
    "hexapod": {
        "type": "6-pus",
        "home": [0.0, 0.0, 440.0, 0.0, 0.0, 0.0],
        "legs": [
            {
                "name": f"leg{k}",
                "joint": f"rho{k}",
                "a": list(a),
                "b": list(b),
                "length": 500.0,
                "range": [-80.0, 80.0],
            }
            for k, (a, b) in enumerate(ENDS, start=1)
        ],
    },
    "pair": {
        "type": "serial",
        "joints": [
            {"name": "q1", "kind": "prismatic", "range": [-100.0, 100.0]},
            {"name": "q2", "kind": "revolute", "d": 50.0, "range": [-90.0, 90.0]},
        ],
    },
}
LENGTHS = ("r", "d", "length", "offset", "a", "b", "xyz")
ANGLES = ("alpha", "beta", "theta", "rpy", "rot", "angle")


@dataclass(frozen=True)
class Case:
    """A machine file's document and the table of its recording."""

    document: Document
    table: pd.DataFrame

    def loaded(self, folder: Path) -> tuple[Machine, Recording]:
        """By way of files, as a user would."""
        (folder / "m.yaml").write_text(yaml.safe_dump(self.document, sort_keys=False))
        self.table.to_csv(folder / "r.csv", index=False, float_format="%.17g")
        machine = load_machine(folder / "m.yaml")
        return machine, load_recording(machine, [folder / "r.csv"], need_observations="x" in self.table)


def described(name: str) -> Document:
    return {
        "schema": "truepose/machine/1",
        "name": name,
        "mechanism": copy.deepcopy(MECHANISMS[name]),
        "frames": {"base": copy.deepcopy(BASE), "tool": copy.deepcopy(TOOL)},
        "sensor": copy.deepcopy(POSE),
        "tolerances": {"length": 0.2, "angle": 0.1},
    }


def recorded(
    document: Document,
    folder: Path,
    rows: int,
    effects: tuple[str, ...] = (),
    seed: int = 1,
    poses_of: Callable[[pd.DataFrame], pd.DataFrame] = lambda table: table,
) -> Case:
    """Readings of a machine drawn from the tolerances, with time and the way each joint came.

    ``poses_of`` makes the poses that are measured from ``rows`` drawn ones (mm and deg).
    """
    rng = np.random.default_rng(seed)
    (folder / "m.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    machine = load_machine(folder / "m.yaml")
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    turns = np.array([a.unit == "rad" for a in machine.mechanism.actuators])
    q = ranges.mean(axis=1) + 0.4 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (rows, len(ranges)))
    table = pd.DataFrame(np.where(turns, np.degrees(q), q), columns=list(machine.mechanism.readings))
    table["time"] = 7.0 * np.arange(rows)
    for name in machine.mechanism.readings:
        table[f"approach.{name}"] = rng.choice([-1.0, 1.0], rows)
    table = poses_of(table)
    machine, poses = Case(document, table).loaded(folder)
    if effects:
        read = simulate(machine, poses, [parse_effect(text, machine) for text in effects], seed=seed)
        return Case(document, pd.concat([table, read], axis=1))
    truth = np.array([p.nominal + p.tolerance * rng.standard_normal() for p in machine.parameters])
    predictor = Predictor(machine, poses)
    names, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    values = machine.sensors[0].noisy(values, rng)
    values[:, 3:] = np.degrees(values[:, 3:])
    return Case(document, pd.concat([table, pd.DataFrame(values, columns=names)], axis=1))


# ------------------------------------------------------------------------------------ ways to tell it


def as_it_is(case: Case) -> Case:
    return case


def in_um_and_mrad(case: Case) -> Case:
    """Every length in um and every angle in mrad, in the machine file and in the recording."""
    document = _rescaled(case.document, 1e3, 1e3 * np.pi / 180)
    table, factors = case.table.copy(), {"x": 1e3, "y": 1e3, "z": 1e3}
    for joint in document["mechanism"].get("joints", document["mechanism"].get("legs")):
        angle = joint.get("kind") == "revolute"
        factors[joint.get("joint", joint["name"])] = 1e3 * (np.pi / 180 if angle else 1.0)
    for name in table.columns:
        table[name] *= factors.get(name, 1e3 * np.pi / 180 if name in ("rx", "ry", "rz") else 1.0)
    return Case({**document, "units": {"length": "um", "angle": "mrad"}}, table)


def _rescaled(value: Any, length: float, angle: float) -> Any:
    if isinstance(value, list):
        return [_rescaled(item, length, angle) for item in value]
    if not isinstance(value, dict):
        return value
    out = {}
    for key, item in value.items():
        if key == "range":
            out[key] = _times(item, angle if value.get("kind") == "revolute" else length)
        elif key == "home":
            out[key] = _times(item[:3], length) + _times(item[3:], angle)
        elif key in LENGTHS:
            out[key] = _times(item, length)
        elif key in ANGLES:
            out[key] = _times(item, angle)
        else:
            out[key] = _rescaled(item, length, angle)
    return out


def _times(value: Any, factor: float) -> Any:
    return [_times(item, factor) for item in value] if isinstance(value, list) else value * factor


def shuffled(case: Case) -> Case:
    """Rows in another order; time and the way joints came are recorded."""
    return Case(case.document, case.table.sample(frac=1.0, random_state=3))


def elsewhere(case: Case) -> Case:
    """The base 700 mm away and turned about the vertical, so that rpy tolerances mean the same."""
    return moved(case, [0.0, 0.0, 1.2])


def overturned(case: Case) -> Case:
    """The base turned about all axes: only where nothing is known of it does that mean the same."""
    return moved(case, [0.5, -0.8, 1.2])


def moved(case: Case, turn: list[float]) -> Case:
    document, table = copy.deepcopy(case.document), case.table.copy()
    base, rotation, shift = (
        document["frames"]["base"],
        lie.exp_so3(np.array(turn)),
        np.array([100.0, -50.0, 700.0]),
    )
    base["xyz"] = (rotation @ np.array(base["xyz"]) + shift).tolist()
    base["rpy"] = np.degrees(lie.rpy_of(rotation @ lie.rpy_matrix(np.radians(base["rpy"])))).tolist()
    table[["x", "y", "z"]] = table[["x", "y", "z"]].to_numpy() @ rotation.T + shift
    read = lie.exp_so3(np.radians(table[["rx", "ry", "rz"]].to_numpy()))
    table[["rx", "ry", "rz"]] = np.degrees(lie.log_so3(rotation @ read))
    return Case(document, table)


OTHERWISE: Mapping[str, Callable[[Case], Case]] = {
    "um and mrad": in_um_and_mrad,
    "shuffled": shuffled,
    "elsewhere": elsewhere,
}


def altogether(case: Case) -> Case:
    """Elsewhere, shuffled, and last in other units: the other ways are written in mm and deg."""
    return in_um_and_mrad(shuffled(elsewhere(case)))


def apart(one: Estimate, other: Estimate) -> float:
    """Largest relative difference of two estimates' physical parameters: all but where the base stands."""
    assert one.prior.names == other.prior.names
    inside = [k for k in one.prior.free if not one.prior.names[k].startswith("base.")]
    size = np.maximum(np.abs(one.p[inside]), one.prior.scale[inside])
    return float(np.max(np.abs(one.p - other.p)[inside] / size))
