"""A raster over a large concave lens, followed by a simulated real robot: what each way of compensation leaves."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from . import layers, montecarlo, regression
from . import workspace as ws
from .layers import Cell, Left
from .montecarlo import Size
from .motions import Array

RADIUS = 3000.0
"""Of the lens, mm; its lowest point is the middle of the workspace."""
HALF, LINES, STEP = 200.0, 9, 5.0
SIZE, SEED = Size(0.05, 0.02), 3


def raster() -> Array:
    """(n, 4, 4) tool frames in the workpiece frame: lines to and fro, the tool square to the lens."""
    along = np.arange(-HALF, HALF + STEP / 2, STEP)
    at = []
    for k, y in enumerate(np.linspace(-HALF, HALF, LINES)):
        x = along if k % 2 == 0 else along[::-1]
        at.append(np.column_stack([x, np.full(len(x), y)]))
    xy = np.concatenate(at)
    down = np.sqrt(RADIUS**2 - np.sum(xy**2, axis=1))
    normal = np.column_stack([-xy, down]) / RADIUS
    up = np.broadcast_to([0.0, 0.0, 1.0], normal.shape)
    axis = np.cross(up, normal)
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(size[:, 0], normal[:, 2])
    turns = Rotation.from_rotvec(axis / np.where(size > 0, size, 1.0) * angle[:, None]).as_matrix()
    return ws.tool_poses(np.column_stack([xy, ws.HEIGHT / 2 + RADIUS - down]), turns)


@dataclass(frozen=True)
class Followed:
    """Pose errors of P (n, 6) along the raster, mm and rad, by what the commands know; seconds of the exact way."""

    errors: dict[str, Array]
    seconds: float


@cache
def followed() -> Followed:
    """One robot, coarse then fine calibration, one raster."""
    real: Cell = layers.cell(SIZE, SEED)
    wanted = raster()
    offsets, _ = layers.coarse(real)
    nodes = montecarlo.field("calibration").nodes
    readings = real.measured(nodes.q - offsets)
    fitted = {
        name: layers.calibrated(machine, nodes.q - offsets, readings)
        for name, machine in layers.machines(SIZE).items()
    }
    path = montecarlo.Field(wanted, regression.at(ws.joints(wanted)))
    y = (readings - nodes.nominal).reshape(-1, 1)
    commands = {"nothing": path.nodes.q, "encoders (coarse)": path.nodes.q - offsets}
    for scheme in montecarlo.schemes(SIZE):
        if scheme.name in ("OLS", "LE, eq. (14)", "MAP"):
            chi = scheme.estimate(nodes.H, y)[0][:, 0]
            commands[f"{scheme.name}, eq. (16)"] = layers.first_order(path, chi) - offsets
    for name, machine in fitted.items():
        start = time.perf_counter()
        commands[f"MAP, {name}, exact"] = layers.followed(machine, wanted, "exact")
    seconds = time.perf_counter() - start
    return Followed({name: real.errors(q, wanted) for name, q in commands.items()}, seconds)


def rows() -> list[list[str]]:
    """Largest and mean error along the raster."""
    table = []
    for name, errors in followed().errors.items():
        left = Left.of(errors)
        cells = (left.position[0], left.position[1], left.orientation[0], left.orientation[1])
        table.append([name, *(f"{value:.1f}" for value in cells)])
    return table


HEAD = ("commands know", "position, um: largest", "mean", "orientation, 1e-3 deg: largest", "mean")
