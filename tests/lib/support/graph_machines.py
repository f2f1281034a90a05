"""Machines with loops: a planar 3-RRR, a delta robot and the hybrid, and recordings of them."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from support import MACHINES
from truepose.arrays import Array
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.file.machine_file import write_machine
from truepose.models.file.yaml_document import read_document
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine

Document = dict[str, Any]


@cache
def machine_of(name: str) -> Machine:
    return load_machine(MACHINES / f"{name}.yaml")


@cache
def model_of(name: str) -> SymbolicModel:
    return symbolic_model(machine_of(name))


def document_of(name: str) -> Document:
    return copy.deepcopy(dict(read_document(MACHINES / f"{name}.yaml")))


def written(folder: Path, document: Mapping[str, Any]) -> Machine:
    write_machine(folder / "machine.yaml", document)
    return load_machine(folder / "machine.yaml")


def recorded(folder: Path, machine: Machine, q: Array, **columns: Array) -> Recording:
    """Readings of joints (n, nq) in mm and rad, and the sensor's columns in mm and rad."""
    units = {name: unit for sensor in machine.sensors for name, unit in sensor.columns.items()}
    data = {f"{a.reading} [{a.unit}]": q[:, k] for k, a in enumerate(machine.mechanism.actuators)}
    data |= {f"{name} [{units[name]}]": values for name, values in columns.items()}
    pd.DataFrame(data).to_csv(folder / "rows.csv", index=False)
    return load_recording(machine, [folder / "rows.csv"], need_observations=bool(columns))


def spread(name: str, count: int, share: float = 0.7, seed: int = 1) -> Array:
    """(count, nq) readings around the middle of the ranges."""
    ranges = np.array([a.range for a in machine_of(name).mechanism.actuators])
    middle, half = ranges.mean(axis=1), np.diff(ranges)[:, 0] / 2
    draws = np.random.default_rng(seed).uniform(-1, 1, (count, len(middle)))
    return np.asarray(middle + share * half * draws)


def poses(machine: Machine, folder: Path, q: Array, p: Array | None = None) -> Array:
    """(n, 4, 4) poses of the tool in the world."""
    predictor = Predictor(machine, recorded(folder, machine, q))
    out, good = predictor.poses(predictor.model.p_home if p is None else p)
    assert good.all()
    return out
