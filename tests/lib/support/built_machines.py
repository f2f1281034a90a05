"""An arm and a hexapod as built, what a sensor reads of such machines, and how far an estimate is from them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from support.moving_machines import record, written
from support.telescope_legs import leg_rows
from truepose.arrays import Array
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

MADE = "tolerances: {length: 0.2, angle: 0.1}\n"
FRAMES = """
frames:
  base: {in: world, xyz: [10, -20, 30], rpy: [4, -3, 25], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [5, -7, 60], rpy: [-8, 6, 12], tolerance: {xyz: 1, rpy: 1}}
"""
UNKNOWN = re.sub(r"xyz: [15], rpy: 1\}", "xyz: .inf, rpy: .inf}", FRAMES)
"""The same frames, nobody having measured them."""
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.005}}\n"
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 128, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, range: [-170, 170]}
    - {name: q3, kind: revolute, d: -612.7, range: [-170, 170]}
    - {name: q4, kind: revolute, d: -571.6, r: 163.9, range: [-170, 170]}
    - {name: q5, kind: revolute, alpha: 90, r: 115.7, range: [-170, 170]}
    - {name: q6, kind: revolute, alpha: -90, r: 92.2, range: [-170, 170]}
"""
HEXAPOD = "mechanism:\n  type: 6-pus\n  home: [0, 0, 440, 0, 0, 0]\n  legs:\n" + leg_rows(
    "length: 500, range: [-80, 80]"
)
TEXTS = {"arm": MADE + FRAMES + ARM + POSE, "hexapod": MADE + FRAMES + HEXAPOD + POSE}


Machines = Mapping[str, Machine]
"""By name."""


def read_machines(folder: Path) -> Machines:
    """Both by name, by way of files in this folder."""
    return {name: written(folder, text, name) for name, text in TEXTS.items()}


def nominal(machine: Machine) -> Array:
    return np.array([p.nominal for p in machine.parameters])


def manufactured(machine: Machine, rng: np.random.Generator) -> Array:
    """Parameters as built: Gaussian in their tolerances where these are finite."""
    sigma = np.array([p.tolerance for p in machine.parameters])
    return nominal(machine) + np.where(np.isfinite(sigma), sigma, 0.0) * rng.standard_normal(len(sigma))


def configurations(machine: Machine, rng: np.random.Generator, n: int, spread: float) -> Array:
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    out: Array = ranges.mean(axis=1) + spread * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (n, len(ranges)))
    return out


def simulated(
    machine: Machine,
    truth: Array,
    rng: np.random.Generator,
    n: int = 40,
    *,
    spread: float = 0.45,
    noise: bool = True,
) -> Recording:
    """What the sensors read of the machine ``truth``, with their noise."""
    q = configurations(machine, rng, n, spread)
    predictor = Predictor(machine, record(machine, q))
    x, good = predictor.assemble(truth)
    assert good.all()
    names, values, _, _ = predictor.columns(truth, x)
    (sensor,) = machine.sensors
    read = sensor.noisy(values, rng) if noise else values
    return record(machine, q, dict(zip(names, read.T, strict=True)), files=("simulated.csv",))


def departures(fit: Estimate, truth: Array) -> Array:
    """How far the estimate is from the truth, in posterior stds."""
    free = fit.prior.free
    out: Array = (fit.p - truth)[free] / fit.std[free]
    return out
