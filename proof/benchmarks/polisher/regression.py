"""The linear regression of the paper (eqs. 7-10) from the library's exact derivatives, at nominal geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Column, Table
from truepose.models.machine.machine import Machine
from truepose.models.units import UnitSystem

from . import workspace as ws
from .source_errors import SourceError, source_error_machine, source_errors

Array = NDArray[np.float64]
COORDINATES = tuple(f"{name}.{axis}" for name in ws.POINTS for axis in "xyz")


@cache
def machine() -> Machine:
    """The machine of all source errors."""
    return source_error_machine()


@cache
def errors() -> tuple[SourceError, ...]:
    """Its 150 source errors, encoders first."""
    return source_errors()


ENCODERS = 6


def unit(angle: str = "deg") -> Array:
    """(150,) what one unit of each error is in mm and rad: 1 mm, and 1 deg or 1 rad."""
    turn = np.radians(1.0) if angle == "deg" else 1.0
    return np.array([turn if error.turns else 1.0 for error in errors()])


@dataclass(frozen=True)
class Nodes:
    """Nominal model at n configurations: H (9 n, 150) of the targets' coordinates and B (n, 6, 150) of the pose error
    at P, per mm and rad; nominal targets (n, 9); in the workpiece frame."""

    q: Array
    H: Array
    B: Array
    nominal: Array


def recording(q: Array, readings: Array | None = None, of: Machine | None = None) -> Recording:
    """Joints (n, 6), mm and rad, with targets (n, 9) when measured, as the library takes them."""
    columns = {f"q{k + 1}": q[:, k].tolist() for k in range(6)}
    if readings is not None:
        columns |= {name: readings[:, k].tolist() for k, name in enumerate(COORDINATES)}
    table = Table("simulated", tuple(Column(name) for name in columns), columns, len(q))
    actuators = (of or machine()).mechanism.actuators
    joints = [JointColumn(a.reading, a.reading_unit, a.range) for a in actuators]
    units = UnitSystem("mm", "rad")
    return read_recording([table], joints, dict.fromkeys(COORDINATES, "mm"), units, readings is not None)


def at(q: Array, parameters: Sequence[str] | None = None, of: Machine | None = None) -> Nodes:
    """The nominal model at joints (n, 6), mm and rad; columns of the source errors, or of parameters by name."""
    predictor = Predictor(of or machine(), recording(q))
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    if not good.all():
        raise ValueError("found a node where the robot cannot be assembled")
    _, nominal, jacobian, poses = predictor.columns(p, x)
    _, twists = predictor.twists(p, x)
    named = [error.parameter for error in errors()] if parameters is None else parameters
    places = [predictor.model.names.index(name) for name in named]
    twists = at_point(twists[:, :, places], poses, ws.TOOL)
    return Nodes(q, jacobian[:, :, places].reshape(-1, len(places)), twists, nominal)


def at_layers(count: int, names: Sequence[str]) -> Nodes:
    """The nominal model at count^2 nodes of each layer, by pure translation."""
    return at(ws.joints(ws.tool_poses(ws.layers(count, *names))))


def at_point(twists: Array, poses: Array, distance: float) -> Array:
    """Twists (n, 6, k) of the tool frame told at a point ``distance`` along the tool's z instead."""
    arm = (distance * poses[:, :3, 2])[:, :, None]
    out = twists.copy()
    out[:, :3] += np.cross(twists[:, 3:], np.broadcast_to(arm, twists[:, 3:].shape), axis=1)
    return out


def pose_errors(poses: Array, wanted: Array) -> Array:
    """(n, 6) twists of P from the wanted tool frames (n, 4, 4) to the real ones, first order in the turn."""
    arm = np.array([0.0, 0.0, ws.TOOL, 1.0])
    turn = poses[:, :3, :3] @ wanted[:, :3, :3].transpose(0, 2, 1)
    skew = 0.5 * (turn - turn.transpose(0, 2, 1))
    moved = ((poses - wanted) @ arm)[:, :3]
    return np.column_stack([moved, skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]])
