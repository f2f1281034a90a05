"""The nominal telescope in each of its models, its poses, and what a rod's stiffness is. mm, N, rad."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd

from support import MACHINES, ROOT
from truepose.arrays import Array
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

MODELS = ("spherical", "linear", "beam", "stiffness", "elastic")
LENGTH = 30.0
STIFFNESSES = (
    "flexure.bending: 797865, flexure.tension: 332098, flexure.torsion: 613742, "
    "rod.bending: 2.51327e+09, rod.tension: 2.51327e+07, rod.torsion: 1.93329e+09, "
)
KNOWN = {"beam": "beta: 0.025, ", "stiffness": STIFFNESSES, "elastic": STIFFNESSES}
"""Tolerances of what a model has beside geometry."""


def model_text(model: str) -> str:
    """Machine file of a model, seen as poses; base and tool stand exactly as drawn."""
    text = (MACHINES / "telescope.yaml").read_text(encoding="utf-8")
    text = text.replace("model: spherical", f"model: {model}")
    return text.replace("tolerances: {", "tolerances: {" + KNOWN.get(model, ""))


def machine_of(folder: Path, model: str, *edits: tuple[str, str]) -> Machine:
    """The nominal telescope in a model, its text edited."""
    text = model_text(model)
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


def _centres(point: str) -> Array:
    """(6, 3) ``a`` or ``b`` of the legs as drawn."""
    nominal = {p.name: p.nominal for p in load_machine(MACHINES / "telescope.yaml").parameters}
    return np.array([[nominal[f"leg{k}.{point}.{axis}"] for axis in "xyz"] for k in range(1, 7)])


def lower_centres(rho: Array) -> Array:
    """(6, 3) lower joint centres in the base frame at travels (6,): all actuators are vertical."""
    return np.asarray(_centres("a") + np.outer(rho, [0.0, 0.0, 1.0]))


def upper_centres() -> Array:
    """(6, 3) upper joint centres in the frame of the platform."""
    return _centres("b")


LOADED = (
    ("units: {length: mm, angle: deg}", "units: {length: mm, angle: deg}\ngravity: [0, 0, -9.80665]"),
    ("tolerances:", "masses:\n  payload: {kg: 20, com: [0, 0, 0], in: platform}\ntolerances:"),
)
TOOL = 120.0
"""Height of the tool above the platform."""
_RECORDED = pd.read_csv(ROOT / "models/machines/telescope/recording.csv", comment="#")
TRAVEL: Array = _RECORDED[[f"rho{k}" for k in range(1, 7)]].to_numpy()[:12]
