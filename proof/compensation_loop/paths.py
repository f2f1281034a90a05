"""What the machines are to do, planned by a controller that has calibrated: nominal joints, one row a tick.

A path is planned on the machine with nominal links and calibrated frames (where its base, its tool, its beam stand);
what its links and physics make of the joints is the loop's business. mm, rad; poses in the sensor's frame.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from nanopositioner.reflection import ReflectionControl, reflections
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.compensation.compensate import ideal_constants
from truepose.identification.compensation.inverse import PoseSolver, base_frame
from truepose.identification.compensation.path_table import path_rows
from truepose.identification.recording.table import read_table
from truepose.models import lie
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXIS_UNITS as POSE

Array = NDArray[np.float64]
Planner = Callable[[Machine, int], Array]
"""Nominal joints (ticks, 6) of the machine as calibrated."""

TURNS = np.radians([2.0, 2.0, 40.0])
"""Of the mirror about the fibre's x and y, and about the light."""
TILT, FOCUS = np.radians(0.1), 0.3
"""Of the telescope's mirror."""
WIDTH, LAYER, LINES = 500.0, 60.0, 11
"""Of the raster, mm: the middle layer of the paper's workspace."""
TOOL = 250.0
"""From the head's flange to the polishing point, along the tool's z."""
_BLOCK = 4096


def about_the_spot(machine: Machine, ticks: int) -> Array:
    """The nanopositioner's mirror turned about the point where the beam meets it: a wobble while it turns."""
    ideal = _ideal(machine)
    control, solver = ReflectionControl(machine, ideal), PoseSolver(machine, ideal)
    start = control.facing(np.zeros(6))
    pose = solver.forward(start)[0]
    spot = reflections(machine, pose, ideal).world[0]
    share = np.linspace(0.0, 1.0, ticks)
    wobble = np.sin(np.pi * share) ** 2
    angles = np.column_stack(
        [wobble * np.cos(6 * np.pi * share), wobble * np.sin(6 * np.pi * share), -_smooth(share)]
    )
    turns = lie.exp_so3((TURNS * angles) @ control.fibre[:3, :3].T)
    poses = np.tile(pose, (ticks, 1, 1))
    poses[:, :3, :3] = turns @ pose[0, :3, :3]
    poses[:, :3, 3] = spot + turns @ (pose[0, :3, 3] - spot)
    return _joints(solver, poses, start)


def pointing(machine: Machine, ticks: int) -> Array:
    """The telescope's mirror tilted along a spiral while it is focused up and down."""
    ideal = _ideal(machine)
    solver = PoseSolver(machine, ideal)
    home = solver.forward(np.zeros(6))[0]
    share = np.linspace(0.0, 1.0, ticks)
    size = np.sin(np.pi * share)
    tilt = TILT * size[:, None] * np.column_stack([np.cos(8 * np.pi * share), np.sin(8 * np.pi * share)])
    poses = np.tile(home, (ticks, 1, 1))
    poses[:, :3, :3] = lie.exp_so3(np.column_stack([tilt, np.zeros(ticks)])) @ home[0, :3, :3]
    poses[:, 2, 3] += FOCUS * size * np.sin(4 * np.pi * share)
    return _joints(solver, poses, np.zeros(6))


def raster(machine: Machine, ticks: int) -> Array:
    """The polisher's point P over the whole middle layer, line by line at one speed, the tool straight down."""
    across = np.linspace(-WIDTH / 2, WIDTH / 2, LINES)
    ends = np.array(
        [[side * WIDTH / 2 * (-1.0) ** k, y] for k, y in enumerate(across) for side in (-1.0, 1.0)]
    )
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ends, axis=0), axis=1))])
    along = np.linspace(0.0, way[-1], ticks)
    poses = np.tile(np.diag([-1.0, 1.0, -1.0, 1.0]), (ticks, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = (np.interp(along, way, column) for column in ends.T)
    poses[:, 2, 3] = LAYER + TOOL
    return _read_back(machine, lie.inverse_pose(base_frame(machine)) @ poses)


def _ideal(machine: Machine) -> Array:
    return ideal_constants(machine, symbolic_model(machine, machine.effects))


def _smooth(share: Array) -> Array:
    """From 0 to 1, at rest at both ends."""
    return np.asarray(share - np.sin(2 * np.pi * share) / (2 * np.pi))


def _read_back(machine: Machine, poses: Array) -> Array:
    """(n, nq) nominal joints of base-frame poses (n, 4, 4), by way of a file as ``truepose compensate`` takes it."""
    columns = np.hstack([poses[:, :3, 3], lie.log_so3(poses[:, :3, :3])])
    header = ",".join([f"{name} [{unit}]" for name, unit in POSE.items()])
    with TemporaryDirectory() as folder:
        file = Path(folder) / "poses.csv"
        np.savetxt(file, columns, fmt="%.17g", delimiter=",", header=header, comments="")
        return path_rows(machine, read_table(file))[1].q


def _joints(solver: PoseSolver, poses: Array, start: Array) -> Array:
    parts = []
    for first in range(0, len(poses), _BLOCK):
        found = solver.inverse(poses[first : first + _BLOCK], start)
        if not found.solved.all():
            row = first + int(np.argmin(found.solved))
            who = ", ".join(found.saturated(row - first)) or "out of reach"
            raise InputError(
                f"path: row {row + 1}: the nominal machine cannot take it ({who}), expected it within reach"
            )
        parts.append(found.q)
    return np.concatenate(parts)


__all__ = ["Planner", "about_the_spot", "pointing", "raster"]
