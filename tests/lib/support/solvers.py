"""One machine of every kind for every solver, simulated recordings of them, and estimates beside each other."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from support.built_machines import FRAMES, POSE
from support.built_machines import simulated as simulated_within
from support.graph_machines import machine_of
from support.moving_machines import written
from support.telescope_legs import leg_rows
from truepose.arrays import Array
from truepose.identification.fit.bounds import Bounds, bounds_of
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.leaves.ipopt.solving import simultaneous
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

BASE = "\n".join(line for line in FRAMES.splitlines() if "tool" not in line) + "\n"
MADE = "tolerances: {length: 0.2, angle: 0.05}\n"
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, r: 20, range: [-100, 100]}
    - {name: q2, kind: revolute, alpha: 90, d: 40, range: [-90, 90]}
    - {name: q3, kind: revolute, d: 300, range: [-90, 90]}
    - {name: q4, kind: revolute, alpha: 90, r: 200, range: [-90, 90]}
"""


def hexapod(kind: str, tail: str) -> str:
    return f"mechanism:\n  type: {kind}\n  home: [0, 0, 440, 0, 0, 5]\n  legs:\n{leg_rows(tail)}"


HYBRID = """
mechanism: {type: 3ups-up-3r, base_radius: 350, platform_radius: 135, platform_offset: 345, wrist_offset: 405,
  head: 120, tool: 250, limb_range: [800, 1000], wrist_range: [-40, 40], screw_pitch: 10}
"""
MACHINES: Mapping[str, str] = {
    "arm": MADE + FRAMES + ARM + POSE,
    "6-pus": MADE + FRAMES + hexapod("6-pus", "length: 500, range: [-80, 80]") + POSE,
    "6-ups": MADE + FRAMES + hexapod("6-ups", "range: [480, 560]") + POSE,
    "hybrid": MADE + BASE + HYBRID + POSE,
}
"""One of every kind: a chain, loops closed by rods, a graph as shorthand."""
GRAPHS = ("delta", "planar")
"""And written-out graphs, in the folder ``machines``: over-constrained limbs, a planar linkage."""
SAME = 1e-6
"""Tolerances by which solvers may differ; each ends within 1e-6 of a 1-sigma of the minimum."""


def read_machines(folder: Path) -> Mapping[str, Machine]:
    """All of them by name, by way of files in this folder."""
    known = {name: written(folder, text, name) for name, text in MACHINES.items()}
    return known | {name: machine_of(name) for name in GRAPHS}


def simulated(machine: Machine, truth: Array, rng: np.random.Generator, n: int = 30) -> Recording:
    """What the sensors read of the machine ``truth``, with their noise."""
    return simulated_within(machine, truth, rng, n, spread=0.4)


def apart(one: Estimate, other: Estimate) -> float:
    """Largest difference of two estimates, in tolerances."""
    free = one.prior.free
    return float(np.max(np.abs(one.p - other.p)[free] / one.prior.scale[free]))


def bounded(machine: Machine, recording: Recording, bounds: Bounds | None = None, **more: object) -> Estimate:
    """The estimate by IPOPT."""
    solver = partial(simultaneous, bounds=bounds or bounds_of(machine, machine.effects))
    return estimate(machine, recording, machine.effects, solver=solver, **more)  # type: ignore[arg-type]
