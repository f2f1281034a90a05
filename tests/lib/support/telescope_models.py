"""The nominal telescope in each of its models, its poses, and chains of beam elements to hold them against. mm, N, rad."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
MODELS = ("spherical", "linear", "beam", "stiffness", "elastic")
LENGTH = 30.0
simulator = import_module("telescope_simulator")
campaigns, fits = import_module("telescope_models.campaign"), import_module("telescope_models.fits")
ClosurePredictor = import_module("telescope_models.implicit").ClosurePredictor


def machine_of(folder: Path, model: str, *edits: tuple[str, str], sensor: str = "pose") -> Machine:
    """The nominal telescope in a model, its text edited."""
    text = campaigns.model_text(model, sensor)
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{model}.yaml"
    path.write_text(text)
    return load_machine(path)


def recording_of(folder: Path, machine: Machine, rho: Array) -> Recording:
    """Travels (n, 6) with readings that mean nothing."""
    columns = [*machine.mechanism.readings, *(c for s in machine.sensors for c in s.columns)]
    rows = [[*row, *np.zeros(len(columns) - 6)] for row in rho]
    text = "\n".join(",".join(f"{v:.9g}" for v in row) for row in rows)
    (folder / "poses.csv").write_text(",".join(columns) + "\n" + text + "\n")
    return load_recording(machine, [folder / "poses.csv"])


def poses_of(folder: Path, machine: Machine, rho: Array, placed: tuple[PlacedEffect, ...] = ()) -> Array:
    """(n, 4, 4) poses of the tool."""
    predictor = Predictor(machine, recording_of(folder, machine, rho), placed)
    poses, good = predictor.poses(predictor.model.p_home)
    assert good.all()
    return poses


def apart(one: Array, other: Array) -> float:
    """Largest distance of tool positions, mm."""
    return float(np.max(np.linalg.norm(one[:, :3, 3] - other[:, :3, 3], axis=1)))


def number(value: ca.SX) -> float:
    return float(ca.evalf(value))


def hinged(machine: Machine) -> list[tuple[str, str]]:
    """Edits that make legs nearly rigid in tension and flexures nearly free to bend and twist."""
    value = {p.name: p.nominal for p in machine.parameters}

    def text(part: str, soft: float, stiff: float) -> str:
        b, t, w = (value[f"{part}.{name}"] for name in ("bending", "tension", "torsion"))
        return f"bending: {soft * b:.6g}, tension: {stiff * t:.6g}, torsion: {soft * w:.6g}"

    return [
        (text("flexure", 1.0, 1.0), text("flexure", 1e-6, 1e4)),
        (text("rod", 1.0, 1.0), text("rod", 1.0, 1e4)),
    ]


LOADED = (
    ("units: {length: mm, angle: deg}", "units: {length: mm, angle: deg}\ngravity: [0, 0, -9.80665]"),
    ("tolerances:", "masses:\n  payload: {kg: 20, com: [0, 0, 0], in: platform}\ntolerances:"),
)
TRAVEL = np.asarray(simulator.paper_poses()[1][:12])
