"""Derivatives of pose and loop closure by screws: what each joint coordinate moves, and how fast.

A coordinate turns or slides everything behind its joint as one rigid body, so its column is told by one screw: far fewer
operations than differentiating products of transforms. It holds where nothing but joints moves with readings and passive
coordinates; ``gap_derivative`` says None elsewhere, and the expressions have to be differentiated.

An open chain as screws: fixed placements between motions about or along z, from the base to the tool.

Every motion of joints and effects that depends on the readings becomes one *move* about (or along) the z axis of
its own frame; all that lies between two moves is constant while the machine moves. The derivative of the pose by
a move is the screw of its axis, so nothing has to be differentiated but the moves themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models import lie
from truepose.models.machine.assembly import (
    MM_PER_M,
    across_of,
    assemble,
    axis_of,
    displacements,
    moved_by,
    placed_frame,
    rod_ends,
)
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.mechanism import AXES, BASE, COORDINATES, Direction, Joint, Rod
from truepose.models.machine.states import across

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
    for joint in machine.mechanism.way(machine.mechanism.flange):
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


def _from_z(axis: tuple[float, float, float]) -> Array:
    """(3, 3) a rotation that takes z to a unit axis; exact where the axis is x, y or z."""
    for k, unit in enumerate(_UNIT.values()):
        if axis == unit:
            return np.roll(np.eye(3), k + 1, axis=0)
    return np.column_stack([*across(axis), axis])


@dataclass(frozen=True)
class Screw:
    """Velocity of a rigid body by one coordinate, in the base frame: ``w`` (3,) and, at the origin, ``v`` (3,)."""

    w: ca.SX
    v: ca.SX

    def at(self, point: ca.SX) -> ca.SX:
        """Velocity (3,) of a point of the body."""
        return self.v + ca.cross(self.w, point)

    def times(self, factor: ca.SX) -> Screw:
        """By a coordinate that is ``factor`` times slower."""
        return Screw(self.w * factor, self.v * factor)


Screws = Mapping[int, Screw]
"""By place of the coordinate in (q, x)."""


def gap_derivative(model: SymbolicModel) -> ca.SX | None:
    """Derivative (6 + ng, nq + nx) of [twist of the tool at its origin; gap of the loops] by (q, x).

    None where screws do not tell it.
    """
    return _Velocities(model).derivative() if _told_by_screws(model) else None


def twists(pose: ca.SX, y: ca.SX) -> ca.SX:
    """Derivative (6, ny) of a pose as twists [v; w] at its origin, in the frame the pose is told in."""
    rotation = pose[:3, :3]
    by_y = ca.jacobian(ca.vec(rotation), y)
    turns = []
    for k in range(y.numel()):
        rate = ca.reshape(by_y[:, k], 3, 3)  # rate @ rotation.T is skew: three of its entries tell all
        turns.append(ca.vertcat(*(rate[i, :] @ rotation[j, :].T for i, j in ((2, 1), (0, 2), (1, 0)))))
    return ca.vertcat(ca.jacobian(pose[:3, 3], y), ca.horzcat(*turns))


def _told_by_screws(model: SymbolicModel) -> bool:
    mechanism = model.machine.mechanism
    coordinates = sum(COORDINATES[joint.kind] for joint in mechanism.passive)
    if mechanism.loops != "exact" or model.x.numel() != coordinates:
        return False
    if any(rod.flexures is not None or rod.elastic is not None for rod in mechanism.rods):
        return False
    driven = ca.vertcat(*(model.values[a.displacement] for a in mechanism.actuators))
    moving = model.machine.ports_of("displacement", "reading")
    still = [v for name, v in model.values.items() if name not in moving]
    unmoved = not ca.depends_on(ca.vertcat(*still), ca.vertcat(model.q, model.x))
    return unmoved and not ca.depends_on(driven, model.x)


class _Velocities:
    def __init__(self, model: SymbolicModel) -> None:
        machine = model.machine
        q = model.moved
        z = dict(zip(model.drivers, ca.vertsplit(model.z), strict=True)) if model.drivers else {}
        self.model, self.mechanism, self.values = model, machine.mechanism, model.values
        self.bodies = assemble(machine, model.values, q, z, model.x).bodies
        self.displacement = displacements(machine, model.values, q)
        self.passive: dict[str, int] = {}
        at = 0
        for joint in self.mechanism.passive:
            self.passive[joint.name] = at
            at += COORDINATES[joint.kind]
        self.screws: dict[str, Screws] = {BASE: {}}
        for joint in self.mechanism.tree:
            own = self._own(joint, placed_frame(joint, self.bodies, self.values))
            self.screws[joint.child] = _together(self.screws[joint.parent], own)

    def derivative(self) -> ca.SX:
        tool = self.model.pose[:3, 3]
        rows = [
            self._columns(
                {k: ca.vertcat(s.at(tool), s.w) for k, s in self.screws[self.mechanism.flange].items()}, 6
            )
        ]
        rows += [self._closing(joint) for joint in self.mechanism.closing]
        rows += [self._rod(rod) for rod in self.mechanism.rods]
        return ca.vertcat(*rows)

    def _columns(self, columns: Mapping[int, ca.SX], height: int) -> ca.SX:
        none = ca.SX(height, 1)
        size = self.model.q.numel() + self.model.x.numel()
        return ca.horzcat(*(columns.get(k, none) for k in range(size)))

    def _rates(self, name: str) -> dict[int, ca.SX]:
        """Derivative of a driven joint's displacement by the readings."""
        slope = ca.jacobian(self.displacement[name], self.model.q)
        return {k: slope[0, k] for k in slope.sparsity().get_triplet()[1]}

    def _own(self, joint: Joint, frame: ca.SX) -> Screws:
        """Screws of the joint's own coordinates; ``frame`` (4, 4) is where its motion starts."""
        turned, origin = frame[:3, :3], frame[:3, 3]
        if joint.name in self.displacement:
            screw = _screw(joint.kind == "revolute", turned @ axis_of(joint, self.values), origin)
            return {k: screw.times(rate) for k, rate in self._rates(joint.name).items()}
        if joint.name not in self.passive:
            return {}
        first = self.passive[joint.name]
        x = self.model.x[first : first + COORDINATES[joint.kind]]
        if joint.kind in ("revolute", "prismatic"):
            screws = [_screw(joint.kind == "revolute", turned @ axis_of(joint, self.values), origin)]
        elif joint.kind == "universal":
            second = turned[:, 1] * ca.cos(x[0]) + turned[:, 2] * ca.sin(x[0])
            screws = [_screw(True, turned[:, 0], origin), _screw(True, second, origin)]
        elif joint.kind == "spherical":
            screws = _ball(turned, origin, x)
        else:
            screws = [_screw(False, turned[:, k], origin) for k in range(3)]
            screws += _ball(turned, origin + turned @ x[:3], x[3:])
        return {self.model.q.numel() + first + k: screw for k, screw in enumerate(screws)}

    def _between(self, fixed: Screws, moving: Screws) -> dict[int, Screw]:
        """Screws of one body as seen from another: what moves both alike is not seen."""
        out = {k: screw for k, screw in moving.items() if k not in fixed}
        for k in fixed.keys() & moving.keys():
            if fixed[k] is not moving[k]:
                out[k] = Screw(moving[k].w - fixed[k].w, moving[k].v - fixed[k].v)
        return out | {k: screw.times(ca.SX(-1)) for k, screw in fixed.items() if k not in moving}

    def _closing(self, joint: Joint) -> ca.SX:
        """Rows of a joint that closes a loop, in the order of ``truepose.models.machine.assembly``."""
        frame = placed_frame(joint, self.bodies, self.values)
        screws = self.screws[joint.parent]
        if joint.name in self.displacement:
            screws = _together(screws, self._own(joint, frame))
            frame = frame @ moved_by(joint, self.displacement[joint.name], self.values)
        child = self.bodies[joint.child]
        columns = {
            k: self._seen(joint, frame[:3, :3].T, child, screw)
            for k, screw in self._between(screws, self.screws[joint.child]).items()
        }
        return self._columns(columns, next(iter(columns.values())).numel())

    def _seen(self, joint: Joint, back: ca.SX, child: ca.SX, screw: Screw) -> ca.SX:
        """A column of the closing's rows: the child moves by ``screw`` as seen from the frame; ``back`` turns into it."""
        gap = back @ screw.at(child[:3, 3])
        if joint.kind == "spherical":
            return gap
        if joint.kind == "universal":
            return ca.vertcat(gap, MM_PER_M * (back[0, :] @ ca.cross(screw.w, child[:3, 1])))
        if joint.kind == "fixed" or joint.name in self.displacement:
            return ca.vertcat(gap, MM_PER_M * _turning(back, child, screw))
        axis, across = axis_of(joint, self.values), across_of(joint)
        if joint.kind == "revolute":
            turned = back @ ca.cross(screw.w, child[:3, :3] @ axis)
            return ca.vertcat(gap, MM_PER_M * (across @ ca.cross(axis, turned)))
        return ca.vertcat(across @ ca.cross(axis, gap), MM_PER_M * _turning(back, child, screw))

    def _rod(self, rod: Rod) -> ca.SX:
        """The row of a rod, (|d|^2 - l^2) / 2l."""
        a, b = rod_ends(rod, self.bodies, self.values)
        d = b - a
        length = self.displacement[rod.name] if rod.length is None else self.values[rod.length]
        ends = self._between(self.screws[rod.body_a], self.screws[rod.body_b])
        both = self.screws[rod.body_b]
        columns = {k: ca.dot(d, s.at(b if k in both else a)) / length for k, s in ends.items()}
        grows = self._rates(rod.name) if rod.length is None else {}
        for k, rate in grows.items():
            shorter = (ca.sumsqr(d) + length**2) / (2 * length**2) * rate
            columns[k] = columns.get(k, ca.SX(0)) - shorter
        return self._columns(columns, 1)


def _together(below: Screws, own: Screws) -> Screws:
    """Of a body: what moves its parent, and its own joint; one coordinate may do both."""
    both = {k: Screw(below[k].w + own[k].w, below[k].v + own[k].v) for k in below.keys() & own.keys()}
    return {**below, **own, **both}


def _screw(turn: bool, axis: ca.SX, origin: ca.SX) -> Screw:
    return Screw(axis, ca.cross(origin, axis)) if turn else Screw(ca.SX.zeros(3, 1), axis)


def _ball(turned: ca.SX, origin: ca.SX, s: ca.SX) -> list[Screw]:
    """Screws of modified Rodrigues parameters s: w = 4 ((1 - n) ds + 2 s x ds + 2 s (s . ds)) / (1 + n)^2, n = s . s."""
    n = ca.dot(s, s)
    rates = 4 / (1 + n) ** 2 * ((1 - n) * ca.SX.eye(3) + 2 * lie.skew(s) + 2 * s @ s.T)
    return [_screw(True, turned @ rates[:, k], origin) for k in range(3)]


def _turning(back: ca.SX, child: ca.SX, screw: Screw) -> ca.SX:
    """Derivative (3,) of the vector of the skew part of the child's turn as seen from the frame."""
    moved = ca.horzcat(*(ca.cross(screw.w, child[:3, k]) for k in range(3)))
    return lie.vee(back @ moved)
