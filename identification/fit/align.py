"""Starting values of frames nobody measured: where the base stands and how the tool is turned.

A frame of infinite or wide tolerance may be anywhere, and Gauss-Newton needs to start within about a
radian of it. Points of the sensor (position channels, three a point) give the base by a rigid fit
(Kabsch); rotation channels give the tool's turn as the mean rotation left over. Further frames of the machine file
follow in the same ways: one that a sensor rides on as the base, a tip as the tool.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie
from truepose.models.machine import Machine
from truepose.models.mechanism import AXES
from truepose.models.view import TOOL_IN_WORLD, WORLD

Array = NDArray[np.float64]
WIDE_ANGLE = 0.2
WIDE_LENGTH = 50.0


def aligned_start(predictor: Predictor) -> Array:
    """(np,) parameters with base (and tool rotation) and further frames where readings put them, as far as they may move."""
    p = predictor.model.p_home.copy()
    if _wide(predictor.machine, "base"):
        _align_ends(predictor, p)
    for mount in predictor.machine.mounts:
        if _wide(predictor.machine, mount.name):
            _align_mount(predictor, p, mount.name)
    return p


def _align_ends(predictor: Predictor, p: Array) -> None:
    """Base and tool, in place."""
    machine = predictor.machine
    for _ in range(3):
        x, good = predictor.assemble(p)
        names, values, _, poses = predictor.columns(p, x)
        rows = good & ~predictor.recording.validation
        predicted, measured = seen_points(predictor, names, values, rows)
        if len(predicted) < 3:
            return
        rotation, shift = rigid_motion(predicted, measured)
        _move_base(predictor, p, rotation, shift)
        if not _wide(machine, "tool") or not _turn_tool(predictor, p, rows, rotation @ poses[rows, :3, :3]):
            return


def _align_mount(predictor: Predictor, p: Array, name: str) -> None:
    """A further frame, in place: where its sensor's points put it, else how its own measured poses have it turned."""
    x, good = predictor.assemble(p)
    names, values, _, _ = predictor.columns(p, x)
    rows = good & ~predictor.recording.validation
    at = [predictor.model.names.index(f"{name}.{a}") for a in AXES]
    turned = lie.rpy_matrix(p[at[3:]])
    predicted, measured = seen_points(predictor, names, values, rows, name)
    if len(predicted) >= 3:
        rotation, shift = rigid_motion(predicted, measured)
        p[at[:3]] -= turned @ rotation.T @ shift
        p[at[3:]] = lie.rpy_of(turned @ rotation.T)
        return
    for sensor in predictor.machine.sensors:
        channels = [c.name for c in sensor.channels if c.kind == "rotation"]
        if sensor.view.tip == name and len(channels) == 3:
            drawn = lie.exp_so3(values[rows][:, [names.index(c) for c in channels]])
            turn = _left_over(predictor, channels, rows, drawn)
            p[at[3:]] = p[at[3:]] if turn is None else lie.rpy_of(turned @ turn)
            return


def _wide(machine: Machine, frame: str) -> bool:
    tolerance = [machine.geometry[f"{frame}.{a}"].tolerance for a in AXES]
    return max(tolerance[:3]) > WIDE_LENGTH or max(tolerance[3:]) > WIDE_ANGLE


def seen_points(
    predictor: Predictor, names: list[str], values: Array, rows: NDArray[np.bool_], frame: str = WORLD
) -> tuple[Array, Array]:
    """Predicted and measured points (k, 3) of every point that has three position channels; ``values`` (n, columns).

    ``frame``: what the sensors stand on.
    """
    predicted, measured = [], []
    read = predictor.recording.observations
    standing = [sensor for sensor in predictor.machine.sensors if sensor.view.frame == frame]
    channels = [c.name for s in standing for c in s.channels if c.kind == "position" and c.name in names]
    for k in range(0, len(channels), 3):
        triple = channels[k : k + 3]
        points = np.column_stack([read[c][rows] for c in triple])
        whole = np.isfinite(points).all(axis=1)  # a lost reading loses the point
        predicted.append(values[rows][:, [names.index(c) for c in triple]][whole])
        measured.append(points[whole])
    return (np.vstack(predicted), np.vstack(measured)) if predicted else (np.zeros((0, 3)), np.zeros((0, 3)))


def rigid_motion(source: Array, target: Array) -> tuple[Array, Array]:
    """Rotation and shift that bring ``source`` onto ``target`` in least squares."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    rotation = lie.nearest_rotation((target - b).T @ (source - a))
    return rotation, b - rotation @ a


def _move_base(predictor: Predictor, p: Array, rotation: Array, shift: Array) -> None:
    at = [predictor.model.names.index(f"base.{a}") for a in AXES]
    p[at[:3]] = rotation @ p[at[:3]] + shift
    p[at[3:]] = lie.rpy_of(rotation @ lie.rpy_matrix(p[at[3:]]))


def _turn_tool(predictor: Predictor, p: Array, rows: NDArray[np.bool_], predicted: Array) -> bool:
    of_tool = [sensor for sensor in predictor.machine.sensors if sensor.view == TOOL_IN_WORLD]
    channels = [c.name for sensor in of_tool for c in sensor.channels if c.kind == "rotation"]
    turn = _left_over(predictor, channels, rows, predicted) if len(channels) == 3 else None
    if turn is None:
        return False
    at = [predictor.model.names.index(f"tool.{a}") for a in AXES]
    p[at[3:]] = lie.rpy_of(lie.rpy_matrix(p[at[3:]]) @ turn)
    return True


def _left_over(
    predictor: Predictor, channels: list[str], rows: NDArray[np.bool_], predicted: Array
) -> Array | None:
    """(3, 3) mean rotation from predicted turns (n, 3, 3) to those read; None where none was."""
    turns = np.column_stack([predictor.recording.observations[c][rows] for c in channels])
    whole = np.isfinite(turns).all(axis=1)
    if not whole.any():
        return None
    mean = np.mean(np.swapaxes(predicted[whole], 1, 2) @ lie.exp_so3(turns[whole]), axis=0)
    return lie.nearest_rotation(mean)
