"""Right pairs of several kinds of machine: constants drawn from their tolerances, noise, known and free frames, any poses."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import Phase, settings
from scipy.spatial.transform import Rotation

from support import MACHINES
from support.checked_arm import document
from support.examples import examples
from truepose.arrays import Array
from truepose.identification.identifiability.analysis import drawn_poses
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.file.machine_file import checked_machine
from truepose.models.file.yaml_document import read_document
from truepose.models.load import build_machine
from truepose.models.machine.machine import Machine

Document = dict[str, Any]
INF = float("inf")
SENSORS: dict[str, Document] = {
    "position": {"type": "position", "sigma": {"xyz": 0.01}},
    "pose": {"type": "pose", "sigma": {"xyz": 0.01, "rot": 0.003}},
    "ballbar": {"type": "ballbar", "centre": [900.0, -400.0, 300.0], "sigma": {"distance": 0.01}},
}
TOLERANCES: dict[str, Document] = {
    "exact": {"xyz": 0, "rpy": 0},
    "known": {"xyz": 3, "rpy": 0.5},
    "free": {"xyz": INF, "rpy": INF},
}
FAMILIES = ("arm", "wrist", "gantry", "serial", "ups", "hybrid", "planar")
_ANYWHERE = {"mm": 300.0, "rad": 1.0}
"""How far what nobody knows may stand from where the file has it."""


def machine_of(family: str, sensor: str = "pose", base: str = "known", tool: str = "known") -> Machine:
    """Return a machine of a family, with a sensor, and frames that are exactly, nearly or not at all known."""
    return loaded(drawn_document(family, sensor, base, tool))


def loaded(machine: Document) -> Machine:
    """Return the machine of a document."""
    return build_machine(checked_machine(Path("machine.yaml"), machine))


def drawn_document(family: str, sensor: str = "pose", base: str = "known", tool: str = "known") -> Document:
    """Return the machine file of a family as a document."""
    own = _document(family)
    frames = own.get("frames", {})
    for name, known in (("base", base), ("tool", tool)):
        frames[name] = {**frames.get(name, {}), "tolerance": TOLERANCES[known]}
    frames["tool"]["in"] = frames["tool"].get("in", "flange")
    return {**own, "frames": frames, "sensor": SENSORS[sensor]}


def _document(family: str) -> Document:
    if family == "arm":
        out = document()
        for joint in out["mechanism"]["joints"]:
            joint["range"] = [-100.0, 100.0]
        return out
    if family == "wrist":  # its axes cross at the tool, which hardly moves
        turning = [(f"q{k}", "revolute", 90.0 * (k > 1)) for k in (1, 2, 3)]
        return _serial(turning, {"xyz": [0.0, 0.0, 0.0]})
    if family == "gantry":
        axes = [("x", 90.0), ("y", 90.0), ("z", 90.0)]
        sliding = [(f"axis.{name}", "prismatic", alpha) for name, alpha in axes]
        return _serial([*sliding, ("c", "revolute", 0.0)], {"xyz": [40.0, 0.0, 120.0]})
    return read_document(MACHINES / f"{family}.yaml")


def _serial(rows: list[tuple[str, str, float]], tool: Document) -> Document:
    joints = [
        {"name": name, "kind": kind, "alpha": alpha, "range": [-100.0, 100.0]} for name, kind, alpha in rows
    ]
    return {
        "schema": "truepose/machine/1",
        "name": "machine",
        "mechanism": {"type": "serial", "joints": joints},
        "frames": {"tool": {"in": "flange", **tool}},
        "tolerances": {"length": 0.1, "angle": 0.05},
    }


def right_recording(
    machine: Machine, rows: int, seed: int, *, off: float = 1.0, share: float = 1.0
) -> Recording:
    """Return readings of a machine whose constants are ``off`` tolerances (1-sigma, at most twice that) from the drawing.

    share: of each joint's range that the poses use; what nobody knows stands anywhere, whatever ``off`` is.
    """
    rng = np.random.default_rng(seed)
    poses = drawn_poses(machine, rows, seed)
    middle = np.array([sum(a.range or (0.0, 0.0)) / 2 for a in machine.mechanism.actuators])
    poses = replace(poses, q=middle + share * (poses.q - middle), from_row=None)
    here = Predictor(machine, poses)
    p = here.model.p_home.copy()
    for parameter in machine.parameters:
        k = here.model.names.index(parameter.name)
        size = (
            _ANYWHERE.get(parameter.unit, 0.0) if np.isinf(parameter.tolerance) else off * parameter.tolerance
        )
        p[k] += size * float(np.clip(rng.standard_normal(), -2.0, 2.0))
    x, good = here.assemble(p)
    assert good.all()
    values = here.values(p, x)[1]
    seen: dict[str, Array] = {}
    first = 0
    for sensor in machine.sensors:
        own = sensor.noisy(values[:, first : first + len(sensor.columns)], rng)
        seen |= dict(zip(sensor.columns, own.T, strict=True))
        first += len(sensor.columns)
    return replace(poses, observations=seen)


@cache
def known_machine(family: str, sensor: str, base: str, tool: str) -> Machine:
    """Return ``machine_of`` these, built once."""
    return machine_of(family, sensor, base, tool)


def fewest_rows(machine: Machine) -> int:
    """Return the fewest rows with as many readings as constants have a tolerance."""
    return -(-sum(p.free for p in machine.parameters) // len(machine.channels))


def law(count: int = 12) -> settings:
    """Return settings of a law; an example that fails is told as it is, since a smaller one takes minutes."""
    return settings(max_examples=examples(count), phases=(Phase.explicit, Phase.generate))


def poses_read(recording: Recording) -> tuple[Array, Rotation]:
    """Return measured positions (n, 3) and turns (n) of poses."""
    read = recording.observations
    position, turns = (np.column_stack([read[f"{kind}{axis}"] for axis in "xyz"]) for kind in ("", "r"))
    return position, Rotation.from_rotvec(turns)
