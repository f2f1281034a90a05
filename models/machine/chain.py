"""An open chain as screws: fixed placements between motions about or along z, from the base to the tool.

Every motion of joints and effects that depends on the readings becomes one *move* about (or along) the z axis of
its own frame; all that lies between two moves is constant while the machine moves. The derivative of the pose by
a move is the screw of its axis, so nothing has to be differentiated but the moves themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from truepose.models import lie
from truepose.models.machine.assembly import displacements
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.mechanism import AXES, BASE, Direction, Joint

_UNIT = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_FRAME = ("x", "y", "z", "rz", "ry", "rx")
"""Steps of a frame and of an error motion: Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll)."""


@dataclass(frozen=True)
class Move:
    """A turn (rad) about, or a slide (mm) along, the z axis that ``before`` (4, 4) puts it on."""

    turn: bool
    value: ca.SX
    before: ca.SX


@dataclass(frozen=True)
class Chain:
    """Nominal base frame to tool: before, move, before, move ... ``after`` (4, 4). Only values depend on readings.

    ``plain`` are the moves before turns on either side took in what they can of a placement between them.
    """

    moves: tuple[Move, ...]
    after: ca.SX
    plain: tuple[Move, ...] = ()

    @property
    def values(self) -> ca.SX:
        """(nv,) values of the moves."""
        return ca.vertcat(*(move.value for move in self.moves)) if self.moves else ca.SX(0, 1)


@dataclass(frozen=True)
class _Motion:
    turn: bool
    axis: tuple[float, float, float]
    value: ca.SX


def chain_of(model: SymbolicModel) -> Chain | None:
    """The chain of a model without passive coordinates; None where loops have to be closed."""
    if model.x.numel() or model.machine.mechanism.loops != "exact":
        return None
    moves, fixed = [], ca.SX.eye(4)
    for motion in _motions(model):
        if not ca.depends_on(motion.value, model.q):
            fixed = fixed @ _moved(motion)
            continue
        upright = lie.transform(ca.SX(ca.DM(_from_z(motion.axis))), ca.SX.zeros(3, 1))
        moves.append(Move(motion.turn, motion.value, fixed @ upright))
        fixed = upright.T
    return Chain(tuple(_sparse(moves)), fixed, tuple(moves))


def _sparse(moves: Sequence[Move]) -> list[Move]:
    """The same chain with fewer terms: between two turns a fixed rotation is Rz(a) Rx(alpha) Rz(b), and a and b are
    added to the turns before and behind."""
    out = list(moves)
    for k in range(1, len(out)):
        if not (out[k - 1].turn and out[k].turn):
            continue
        fixed = out[k].before
        a = ca.atan2(fixed[0, 2], -fixed[1, 2])
        sine = ca.sin(a) * fixed[0, 2] - ca.cos(a) * fixed[1, 2]
        rest = lie.rot_z(a)[:3, :3].T @ fixed[:3, :]  # Rx(alpha) Rz(b), with what it is shifted by
        tilt = lie.transform(
            ca.vertcat(
                ca.horzcat(1, 0, 0), ca.horzcat(0, fixed[2, 2], -sine), ca.horzcat(0, sine, fixed[2, 2])
            ),
            rest[:, 3],
        )
        b = ca.atan2(-rest[0, 1], rest[0, 0])
        out[k - 1] = replace(out[k - 1], value=out[k - 1].value + a)
        out[k] = Move(True, out[k].value + b, tilt)
    return out


def _motions(model: SymbolicModel) -> list[_Motion]:
    values, machine = model.values, model.machine
    out = _frame(model, "base.motion")
    for joint in _path(machine.mechanism.tree, machine.mechanism.flange):
        out += [_motion(step.kind, values[step.parameter]) for step in joint.placement]
        out += _joint(model, joint)
        out += _frame(model, f"{joint.name}.motion")
    return [*out, *_frame(model, "tool.motion"), *_frame(model, "tool")]


def _joint(model: SymbolicModel, joint: Joint) -> list[_Motion]:
    if joint.name not in model.machine.mechanism.driven:
        return []
    value = displacements(model.machine, model.values, model.moved)[joint.name]
    assert not isinstance(joint.axis, Direction)  # parameterised directions belong to rails of closed chains
    return [_Motion(joint.kind == "revolute", joint.axis, value)]


def _frame(model: SymbolicModel, frame: str) -> list[_Motion]:
    """Motions of a frame whose six values are at hand; what is nothing but zero is left out."""
    if f"{frame}.x" not in model.values:
        return []
    assert set(_FRAME) == set(AXES)
    motions = [
        _motion(axis if axis[0] == "r" else f"t{axis}", model.values[f"{frame}.{axis}"]) for axis in _FRAME
    ]
    return [motion for motion in motions if not motion.value.is_zero()]


def _motion(kind: str, value: ca.SX) -> _Motion:
    return _Motion(kind[0] == "r", _UNIT[kind[1]], value)


def _moved(motion: _Motion) -> ca.SX:
    axis = ca.SX(ca.DM(motion.axis))
    if not motion.turn:
        return lie.transform(ca.SX.eye(3), axis * motion.value)
    for name, turned in (("x", lie.rot_x), ("y", lie.rot_y), ("z", lie.rot_z)):
        if motion.axis == _UNIT[name]:
            return turned(motion.value)
    return lie.transform(lie.axis_rotation(axis, motion.value), ca.SX.zeros(3, 1))


def _from_z(axis: tuple[float, float, float]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(3, 3) a rotation that takes z to a unit axis; exact where the axis is x, y or z."""
    for k, unit in enumerate(_UNIT.values()):
        if axis == unit:
            return np.roll(np.eye(3), k + 1, axis=0)
    along = np.array(axis)
    across = np.eye(3)[int(np.argmin(np.abs(along)))]
    x = across - (across @ along) * along
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(along, x), along])


def _path(tree: Sequence[Joint], flange: str) -> list[Joint]:
    """Joints from the base to the flange."""
    parent = {joint.child: joint for joint in tree}
    out: list[Joint] = []
    body = flange
    while body != BASE:
        out.insert(0, parent[body])
        body = parent[body].parent
    return out
