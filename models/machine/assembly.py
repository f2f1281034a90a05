"""Bodies placed for given parameters and readings: poses, loop closure, potential energy of gravity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from truepose.models import lie
from truepose.models.machine import flexure
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES, BASE, COORDINATES, Direction, Joint, Rod
from truepose.models.machine.potential import MM_PER_M, Still, energies, in_base
from truepose.models.machine.view import TOOL, WORLD, View

_TURNS = {"rx": lie.rot_x, "ry": lie.rot_y, "rz": lie.rot_z}


@dataclass(frozen=True)
class Assembly:
    """Bodies placed for given port values: poses, closure residual, potential energy of load cases (N mm), and what stands
    still when it is varied.

    ``carried`` are the frames that the machine carries, by name: the tool, and the further ones of its file.
    """

    bodies: Mapping[str, ca.SX]
    closure: ca.SX
    gap: ca.SX
    tool: ca.SX
    energies: Mapping[str, ca.SX]
    still: Still
    carried: Mapping[str, ca.SX]

    def seen(self, view: View, values: Mapping[str, ca.SX]) -> ca.SX:
        """Pose (4, 4) of the tip of a view in the frame that its readings are in."""
        if view.frame in self.carried and view.tip in self.carried:  # where the base stands plays no part
            return lie.inverse(self.carried[view.frame]) @ self.carried[view.tip]
        tip = self._in_world(view.tip, values)
        return lie.inverse(self._in_world(view.frame, values)) @ tip if view.relative else tip

    def _in_world(self, name: str, values: Mapping[str, ca.SX]) -> ca.SX:
        if name in self.carried:
            return frame_of(values, BASE) @ self.carried[name]
        return _motion(values, name) @ frame_of(values, name)


def assemble(
    machine: Machine,
    values: Mapping[str, ca.SX],
    q: Mapping[str, ca.SX],
    z: Mapping[str, ca.SX],
    x: ca.SX,
    poses: Mapping[str, ca.SX] | None = None,
) -> Assembly:
    """Place every body: ``values`` of parameters and ports, readings ``q``, drivers ``z``, passive ``x``.

    Bodies named in ``poses`` stand where it says (4, 4), whatever their joints are.
    """
    given = poses or {}
    mechanism = machine.mechanism
    displacement = displacements(machine, values, q)
    passive, offset = {}, 0
    for joint in mechanism.passive:
        size = COORDINATES[joint.kind]
        passive[joint.name] = x[offset : offset + size]
        offset += size
    bodies = {BASE: _motion(values, "base")}
    for joint in mechanism.tree:
        if joint.child in given:
            bodies[joint.child] = given[joint.child]
        else:
            bodies[joint.child] = bodies[joint.parent] @ _joint(joint, values, displacement, passive)
    closure = [_closing(joint, bodies, values, displacement) for joint in mechanism.closing]
    closure += [_rod(rod, bodies, values, displacement) for rod in mechanism.rods]
    tool = ca.mtimes([bodies[mechanism.flange], _motion(values, "tool"), frame_of(values, "tool")])
    gap = ca.vertcat(*closure) if closure else ca.SX(0, 1)
    square = _least_squares(gap, x) if gap.numel() > x.numel() else gap
    carried = _carried(machine, bodies, tool, values)
    energy, still = energies(machine, {**bodies, **carried}, z, values)
    return Assembly(bodies, square, gap, tool, energy, still, carried)


def _carried(
    machine: Machine, bodies: Mapping[str, ca.SX], tool: ca.SX, values: Mapping[str, ca.SX]
) -> dict[str, ca.SX]:
    """Pose (4, 4), in the nominal base frame, of the tool and of every further frame that a body carries."""
    out = {TOOL: tool}
    for mount in machine.mounts:
        if mount.body == WORLD:
            continue
        body = tool if mount.body == TOOL else bodies[mount.body]
        out[mount.name] = ca.mtimes([body, _motion(values, mount.name), frame_of(values, mount.name)])
    return out


def tool_on_flange(values: Mapping[str, ca.SX]) -> ca.SX:
    """Pose (4, 4) of the tool in the flange's frame."""
    return _motion(values, "tool") @ frame_of(values, "tool")


def rod_ends(rod: Rod, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Ball centres (3,) of a rod in the base frame, mm."""
    return _end(bodies[rod.body_a], rod.point_a, values), _end(bodies[rod.body_b], rod.point_b, values)


def _rod(
    rod: Rod, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX], displacement: Mapping[str, ca.SX]
) -> ca.SX:
    """Closure residual of a rod: how much its ends are too far apart, mm."""
    a, b = rod_ends(rod, bodies, values)
    length = displacement[rod.name] if rod.length is None else values[rod.length]
    if rod.flexures is not None:
        length = length + flexure.gains(rod.flexures, b - a, bodies[rod.body_a], bodies[rod.body_b], values)
    # (|d|^2 - l^2) / 2l: its derivative by l is -1 at closure, so its multiplier is the rod's tension
    return (ca.sumsqr(b - a) - length**2) / (2 * length)


def _least_squares(gap: ca.SX, x: ca.SX) -> ca.SX:
    """(nx,) zero where overconstrained loops close best: the gap across each column of its Jacobian, mm."""
    by_x = ca.jacobian(gap, x)
    columns = [by_x[:, k] for k in range(x.numel())]
    return ca.vertcat(*(ca.dot(column, gap) / ca.norm_2(column) for column in columns))


def displacement_of(
    machine: Machine, reading: str, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX]
) -> ca.SX:
    """offset + gain * reading + what effects add, in mm or rad."""
    actuator = machine.mechanism.actuator(reading)
    gain = values[actuator.gain] if actuator.gain else 1
    offset = values[actuator.offset] if actuator.offset else 0
    return offset + gain * q[reading] + values[actuator.displacement]


def way_of(machine: Machine, reading: str, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX]) -> ca.SX:
    """How far a joint is from where its reading is 0, mm or rad: gain * reading + what effects add."""
    offset = machine.mechanism.actuator(reading).offset
    return displacement_of(machine, reading, values, q) - (values[offset] if offset else 0)


def displacements(machine: Machine, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Displacement of every joint and rod that readings move, mm or rad, by its name."""
    mechanism = machine.mechanism
    own = {a.reading: displacement_of(machine, a.reading, values, q) for a in mechanism.actuators}
    out = {a.drives: own[a.reading] for a in mechanism.actuators}
    for follower in mechanism.followers:
        carried = (values[ratio] * own[reading] for reading, ratio in follower.terms)
        out[follower.joint] = sum(carried, values[follower.offset])
        if follower.law is not None:
            out[follower.joint] += follower.law.value(own, values)
    return out


def _joint(
    joint: Joint, values: Mapping[str, ca.SX], displacement: Mapping[str, ca.SX], passive: Mapping[str, ca.SX]
) -> ca.SX:
    """Parent to child: placement, motion, error motion."""
    out = _placed(joint, values)
    if joint.name in displacement:
        return ca.mtimes(
            [out, moved_by(joint, displacement[joint.name], values), _motion(values, joint.name)]
        )
    if joint.name in passive:
        return out @ moved_by(joint, passive[joint.name], values)
    return out


def _placed(joint: Joint, values: Mapping[str, ca.SX]) -> ca.SX:
    """Pose (4, 4) of the joint's own frame in its parent."""
    if not joint.placement:
        return ca.SX.eye(4)
    constants = ca.vertcat(*(values[step.parameter] for step in joint.placement))
    placed: ca.SX = _placement(tuple(step.kind for step in joint.placement))(constants)
    return placed


@cache
def _placement(kinds: tuple[str, ...]) -> ca.Function:
    """Steps one after the other as recorded operations: repeated, they need a fifth of the time."""
    constants, out = ca.SX.sym("c", len(kinds)), ca.SX.eye(4)
    for k, kind in enumerate(kinds):
        out = out @ _step(kind, constants[k])
    return ca.Function("placement", [constants], [out])


def moved_by(joint: Joint, coordinate: ca.SX, values: Mapping[str, ca.SX]) -> ca.SX:
    if joint.kind == "universal":
        return lie.rot_x(coordinate[0]) @ lie.rot_y(coordinate[1])
    if joint.kind == "spherical":
        return lie.transform(lie.mrp_rotation(coordinate), ca.SX.zeros(3, 1))
    if joint.kind == "free":
        return lie.transform(lie.mrp_rotation(coordinate[3:]), coordinate[:3])
    axis = axis_of(joint, values)
    if joint.kind == "prismatic":
        return lie.transform(ca.SX.eye(3), axis * coordinate)
    if joint.axis == (0.0, 0.0, 1.0):
        return lie.rot_z(coordinate)
    return lie.transform(lie.axis_rotation(axis, coordinate), ca.SX.zeros(3, 1))


def axis_of(joint: Joint, values: Mapping[str, ca.SX]) -> ca.SX:
    if not isinstance(joint.axis, Direction):
        return ca.SX(ca.DM(joint.axis))
    known = [values[name] for name in joint.axis.components if name is not None]
    third = joint.axis.sign * ca.sqrt(1 - sum(v**2 for v in known))
    return ca.vertcat(*(third if name is None else values[name] for name in joint.axis.components))


def placed_frame(joint: Joint, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> ca.SX:
    """Pose (4, 4) of a joint's own frame, before its motion, in the base frame."""
    frame = bodies[joint.parent]
    for step in joint.placement:
        frame = frame @ _step(step.kind, values[step.parameter])
    return frame


def _closing(
    joint: Joint, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX], displacement: Mapping[str, ca.SX]
) -> ca.SX:
    """Closure residual of a joint that closes a loop: what of the relative pose its kind forbids."""
    frame = placed_frame(joint, bodies, values)
    if joint.name in displacement:
        frame = frame @ moved_by(joint, displacement[joint.name], values)
    child = bodies[joint.child]
    gap = frame[:3, :3].T @ (child[:3, 3] - frame[:3, 3])
    turn = frame[:3, :3].T @ child[:3, :3]
    if joint.kind == "spherical":
        return gap
    if joint.kind == "universal":
        return ca.vertcat(gap, MM_PER_M * turn[0, 1])  # the cross's axes stay perpendicular
    if joint.kind == "fixed" or joint.name in displacement:
        return ca.vertcat(gap, MM_PER_M * lie.vee(turn))
    axis, across = axis_of(joint, values), across_of(joint)
    if joint.kind == "revolute":
        return ca.vertcat(gap, MM_PER_M * (across @ ca.cross(axis, turn @ axis)))
    return ca.vertcat(across @ ca.cross(axis, gap), MM_PER_M * lie.vee(turn))


def across_of(joint: Joint) -> ca.SX:
    """Two rows (2, 3) across the joint's nominal axis, or across its largest component where it may turn."""
    if isinstance(joint.axis, Direction):
        axis = [float(name is None) for name in joint.axis.components]
    else:
        axis = list(joint.axis)
    return ca.SX(ca.DM(np.linalg.svd(np.reshape(axis, (1, 3)))[2][1:]))


def _step(kind: str, value: ca.SX) -> ca.SX:
    if kind in _TURNS:
        return _TURNS[kind](value)
    at = "xyz".index(kind[1])
    return lie.translation(*(value if k == at else ca.SX(0) for k in range(3)))


def _motion(values: Mapping[str, ca.SX], frame: str) -> ca.SX:
    """Small error motion of a frame; smooth at zero, where it is the identity."""
    if f"{frame}.motion.x" not in values:
        return ca.SX.eye(4)
    return lie.rpy_transform(
        [values[f"{frame}.motion.{a}"] for a in AXES[:3]], [values[f"{frame}.motion.{a}"] for a in AXES[3:]]
    )


def frame_of(values: Mapping[str, ca.SX], frame: str) -> ca.SX:
    """Pose of ``base``, ``tool`` or a further frame in what it stands in (rpy angles)."""
    return lie.rpy_transform(
        [values[f"{frame}.{a}"] for a in AXES[:3]], [values[f"{frame}.{a}"] for a in AXES[3:]]
    )


def _end(frame: ca.SX, point: tuple[str, str, str] | None, values: Mapping[str, ca.SX]) -> ca.SX:
    return frame[:3, 3] if point is None else in_base(frame, [values[name] for name in point])


def symbols(prefix: str, names: Sequence[str]) -> dict[str, ca.SX]:
    """One scalar symbol a name."""
    return {name: ca.SX.sym(f"{prefix}{name}") for name in names}
