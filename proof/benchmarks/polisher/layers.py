"""Coarse, then fine calibration of simulated real robots, compensation, and what is left: Table 5 and Fig. 4 again.

The real robot is the simulator's: all source errors, encoders far off, joints that do not come back exactly, a
tracker with noise. It obeys commands and is measured; nothing else of it is seen by an estimator.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd

from truepose.identification.compensation.compensate import Method, compensate
from truepose.identification.compensation.path_table import path_rows
from truepose.identification.fit import relinearised as biased
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.recording.table import read_table
from truepose.models import lie
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXIS_UNITS as POSE

from . import bundle, montecarlo, regression
from . import workspace as ws
from .montecarlo import Size
from .motions import Array, exp
from .robot import Robot
from .source_errors import source_error_machine

JITTER = np.array([0.0007] * 3 + [np.radians(0.0002)] * 3)
"""1-sigma of where a joint stops, mm and rad: P comes back within the paper's 0.016 mm (ISO 9283)."""
VISITS = 3
ENOUGH = 0.05
"""The coarse calibration ends when an increment is below 5 % of the first. The paper compares the change of
increments with the previous one, which never becomes small while they shrink."""
ROUNDS = 10
LATER = 5000.0
"""When a robot that warms up has done so, s."""
FIELDS = ("lower", "middle", "tilted")
HEAD = (
    "model",
    *(f"{name}: {what}" for name in FIELDS for what in ("position, um", "orientation, 1e-3 deg")),
)


@dataclass(frozen=True)
class Cell:
    """A simulated real robot with its tracker; ``warm`` says how much of the demo's heat its screws take."""

    robot: Robot
    rng: np.random.Generator
    warm: float = 0.0

    def measured(self, commands: Array) -> Array:
        """(n, 9) targets at commands (n, 6), mean of the visits, mm; a cold robot that warms up meanwhile."""
        readings = []
        grown = self._grown(commands, bundle.SECONDS * np.arange(1.0, len(commands) + 1))
        for _ in range(VISITS):
            poses = self.robot.tool_poses(commands, grown + JITTER * self.rng.normal(size=commands.shape))
            readings.append(bundle.targets(poses) + ws.SIGMA * self.rng.normal(size=(len(poses), 9)))
        return np.asarray(np.mean(readings, axis=0))

    def errors(self, commands: Array, wanted: Array) -> Array:
        """(n, 6) pose errors of P, mm and rad, without noise; of a robot that is warm, where it warms up."""
        grown = self._grown(commands, np.full(len(commands), LATER))
        return regression.pose_errors(self.robot.tool_poses(commands, grown), wanted)

    def _grown(self, commands: Array, seconds: Array) -> Array:
        out = np.zeros((len(commands), 6))
        for k, screw in enumerate(bundle.SCREWS if self.warm else ()):
            out[:, k] = self.warm * screw.growth(seconds, commands[:, k])[0]
        return out


def cell(size: Size, seed: int, warm: float = 0.0) -> Cell:
    """A robot with source errors of that size and encoders off by some mm and tenths of a degree."""
    drawn = montecarlo.robot_of(size, seed)
    rng = np.random.default_rng([seed, 5])
    return Cell(Robot(drawn.errors, bundle.OFFSETS * rng.normal(size=6)), rng, warm)


@cache
def middle() -> regression.Nodes:
    """The nodes of the coarse calibration: 5 x 5 of the middle layer."""
    return regression.at_layers(5, ("middle",))


def coarse(real: Cell) -> tuple[Array, list[Array]]:
    """Encoder offsets (6,) by eq. (15), and each round's increment."""
    nodes, found = middle(), np.zeros(6)
    increments: list[Array] = []
    while len(increments) < ROUNDS:
        y = (real.measured(nodes.q - found) - nodes.nominal).ravel()
        increments.append(biased.ols(biased.decompose(nodes.H[:, : regression.ENCODERS], y)).b)
        found = found + increments[-1]
        if np.linalg.norm(increments[-1] / bundle.OFFSETS) < ENOUGH * np.linalg.norm(
            increments[0] / bundle.OFFSETS
        ):
            break
    return found, increments


@cache
def fields() -> Mapping[str, montecarlo.Field]:
    """Where errors are compared: a calibration layer, the test layer, and the test layer with a tilted tool."""
    at = ws.tool_poses(ws.nodes(7, "lower"))
    lower = montecarlo.Field(at, regression.at(ws.joints(at)))
    return {"lower": lower, "middle": montecarlo.field("test"), "tilted": montecarlo.field("tilted")}


def first_order(here: montecarlo.Field, chi: Array) -> Array:
    """(n, 6) commands by eq. (16): the nominal inverse of the pose with the predicted error of P taken off."""
    twist = -(here.nodes.B @ chi)
    arm = np.array([0.0, 0.0, ws.TOOL, 1.0])
    out = here.wanted.copy()
    out[:, :3, :3] = (
        exp(np.hstack([np.zeros((len(twist), 3)), twist[:, 3:]]))[:, :3, :3] @ here.wanted[:, :3, :3]
    )
    p = (here.wanted @ arm)[:, :3] + twist[:, :3]
    out[:, :3, 3] = p - ws.TOOL * out[:, :3, 2]
    return ws.joints(out)


@cache
def machines(size: Size) -> Mapping[str, Machine]:
    """The bundled machine, and the one of all source errors, with tolerances of that size."""
    text = (resources.files("truepose.models") / "machines" / "polisher" / "machine.yaml").read_text("utf-8")
    text = text.replace("  length: 0.05\n  angle: 0.02\n", f"  length: {size.mm}\n  angle: {size.deg}\n")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "machine.yaml").write_text(text, encoding="utf-8")
        bundled = load_machine(Path(folder) / "machine.yaml")
    return {"bundled": bundled, "all 150": source_error_machine(size.mm, size.deg)}


def calibrated(machine: Machine, q: Array, readings: Array) -> Machine:
    """The machine calibrated as ``truepose calibrate`` does, by way of its file."""
    rows = regression.recording(q, readings, machine)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibrated.yaml"
        write_calibrated(path, estimate(machine, rows), rows)
        return load_machine(path)


def followed(machine: Machine, wanted: Array, method: Method) -> Array:
    """Commands (n, 6) as ``truepose compensate`` gives them for tool frames (n, 4, 4) in the workpiece frame."""
    value = {parameter.name: parameter.nominal for parameter in machine.frames}
    base = np.eye(4)
    base[:3, :3] = lie.rpy_matrix(np.array([value[f"base.r{axis}"] for axis in "xyz"]))
    base[:3, 3] = [value[f"base.{axis}"] for axis in "xyz"]
    in_base = np.linalg.inv(base) @ wanted
    columns = np.hstack([in_base[:, :3, 3], np.degrees(lie.log_so3(in_base[:, :3, :3]))])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "path.csv"
        pd.DataFrame(columns, columns=list(POSE)).to_csv(path, index=False)
        return compensate(machine, path_rows(machine, read_table(path))[1], method=method).command


@dataclass(frozen=True)
class Left:
    """Largest and mean pose error of P, um and 1e-3 deg: (2,) position, (2,) orientation."""

    position: Array
    orientation: Array

    @classmethod
    def of(cls, errors: Array) -> Left:
        """Of (n, 6) twists, mm and rad."""
        position = 1e3 * np.linalg.norm(errors[:, :3], axis=1)
        orientation = np.degrees(1e3) * np.linalg.norm(errors[:, 3:], axis=1)
        return cls(*(np.array([np.max(v), np.mean(v)]) for v in (position, orientation)))


Found = Mapping[str, Mapping[str, Left]]
"""What is left by way of calibrating, then by field."""


def calibrate_all(real: Cell, size: Size) -> Found:
    """What is left in each field after every way of calibrating one robot."""
    offsets, _ = coarse(real)
    nodes = montecarlo.field("calibration").nodes
    readings = real.measured(nodes.q - offsets)
    y = (readings - nodes.nominal).reshape(-1, 1)
    out = {
        "before": {name: Left.of(real.errors(here.nodes.q, here.wanted)) for name, here in fields().items()}
    }
    out["coarse"] = {
        name: Left.of(real.errors(here.nodes.q - offsets, here.wanted)) for name, here in fields().items()
    }
    for scheme in montecarlo.schemes(size):
        chi = scheme.estimate(nodes.H, y)[0][:, 0]
        out[scheme.name] = {
            name: Left.of(real.errors(first_order(here, chi) - offsets, here.wanted))
            for name, here in fields().items()
        }
    ways: list[tuple[str, Method]] = [("bundled", "first-order"), ("bundled", "exact"), ("all 150", "exact")]
    machine = {name: calibrated(one, nodes.q - offsets, readings) for name, one in machines(size).items()}
    for name, method in ways:
        out[f"MAP, {name}, {method}"] = {
            field: Left.of(real.errors(followed(machine[name], here.wanted, method), here.wanted))
            for field, here in fields().items()
        }
    return out


def robots(size: Size, seeds: Sequence[int], warm: float = 0.0) -> list[Found]:
    """What is left on several robots."""
    return [calibrate_all(cell(size, seed, warm), size) for seed in seeds]


def average(found: Sequence[Found], name: str, where: str) -> tuple[Array, Array]:
    """Mean over robots of (largest, mean) position and (largest, mean) orientation error, um and 1e-3 deg."""
    position, orientation = (
        np.mean([getattr(one[name][where], part) for one in found], axis=0)
        for part in ("position", "orientation")
    )
    return position, orientation


def rows(found: Sequence[Found]) -> list[list[str]]:
    """Mean over robots of the largest and the mean error in each field."""
    table = []
    for name in found[0]:
        parts = [part for where in FIELDS for part in average(found, name, where)]
        table.append([name, *(f"{largest:.1f} / {mean:.1f}" for largest, mean in parts)])
    return table
