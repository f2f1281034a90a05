"""A machine without loops as rigid links with numbers in place of parameters: what robot description formats hold.

Poses are metres and roll, pitch, yaw in radians, and numbers texts that read back the same."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models import lie
from truepose.models.machine.assembly import axis_of, displacements, frame_of, motion_of, placed_frame
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE, COORDINATES, Actuator

MM_PER_M = 1000.0
_NOISE = 1e-15
"""m or rad: what is smaller came from rounding a cosine of a right angle."""


def xyz_rpy(pose: Array) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Position in m and (roll, pitch, yaw) in rad of a pose (4, 4) in mm: Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll).

    Roll is what the other two leave of the rotation, so that no digit is lost at pitch = +-90 deg.
    """
    rotation = pose[:3, :3]
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    roll = math.atan2(s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1])
    x, y, z = (clean(float(v) / MM_PER_M) for v in pose[:3, 3])
    return (x, y, z), (clean(roll), clean(pitch), clean(yaw))


def clean(value: float) -> float:
    """The value; zero (never minus zero) where it is rounding noise."""
    return value if abs(value) > _NOISE else 0.0


def cleaned(values: Array) -> list[float]:
    """A list of clean values."""
    return [clean(float(v)) for v in values]


def quaternion(rotation: Array) -> list[float]:
    """(w, x, y, z) of a rotation (3, 3), w >= 0."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return cleaned(np.array([w, x, y, z]) * (-1.0 if w < 0 else 1.0))


def text(*values: float) -> str:
    """Numbers with a space between, each the shortest that reads back as the same double."""
    return " ".join(repr(float(v)).removesuffix(".0") for v in values)


@dataclass(frozen=True)
class TreeJoint:
    """A joint from link to link: ``origin`` (4, 4) mm, then the motion by its reading about or along ``axis`` (3,).

    ``kind`` is revolute, prismatic or fixed; ``range`` in mm or rad, None where the machine file states none. ``follows`` is
    the joint whose reading moves it, with the ratio (1, mm/rad or rad/mm), where it has none of its own.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    range: tuple[float, float] | None = None
    follows: tuple[str, float] | None = None

    @property
    def unit(self) -> float:
        """The reading's internal units, mm or rad, in one of m or rad."""
        return MM_PER_M if self.kind == "prismatic" else 1.0


@dataclass(frozen=True)
class Tree:
    """Joints in an order in which parents come first, from the nominal frame of the base.

    A link's frame is where its joint leaves it; ``offsets`` (4, 4) lead from there to the frame of the body of that
    name. ``flange`` is the link that carries the tool, ``tool`` (4, 4) the tool frame in it, ``world`` (4, 4) the
    base in the sensor's frame.
    """

    name: str
    joints: tuple[TreeJoint, ...]
    offsets: Mapping[str, Array]
    flange: str
    tool: Array
    world: Array

    def pose(self, readings: Mapping[str, float]) -> Array:
        """Tool in the nominal frame of the base, (4, 4) mm, at readings in mm and rad by joint name."""
        out: Array = self.links(readings)[self.flange] @ self.tool
        return out

    def links(self, readings: Mapping[str, float]) -> dict[str, Array]:
        """Return the frames (4, 4) mm of all links in the base, at readings in mm and rad by joint name."""
        return frames_of(self.joints, readings, BASE)

    def path(self) -> tuple[TreeJoint, ...]:
        """The joints from the base to the flange, in order."""
        above = {joint.child: joint for joint in self.joints}
        out, link = [], self.flange
        while link in above:
            out.append(above[link])
            link = out[-1].parent
        return tuple(out[::-1])


def tree_of(machine: Machine, values: Mapping[str, float], what: str) -> Tree:
    """The links of a machine whose parameters and ports have these ``values`` (mm, rad).

    Raises InputError, which ``what`` (the format) opens, where the machine is no tree of driven and fixed joints.
    """
    _check(machine, values, what)
    mechanism = machine.mechanism
    symbols = {name: ca.SX(value) for name, value in values.items()}
    drives = {actuator.drives: actuator for actuator in mechanism.actuators}
    still = dict.fromkeys(mechanism.readings, ca.SX(0))
    zero = {name: float(value) for name, value in displacements(machine, symbols, still).items()}
    follows = {f.joint: (f.terms[0][0], values[f.terms[0][1]]) for f in mechanism.followers if f.terms}
    offsets = {BASE: _number(motion_of(symbols, BASE))}
    joints = []
    for joint in mechanism.tree:
        placement = _number(placed_frame(joint, {joint.parent: ca.SX.eye(4)}, symbols))
        origin = offsets[joint.parent] @ placement
        offsets[joint.child] = np.eye(4)
        axis, limits, name, kind = np.array([0.0, 0.0, 1.0]), None, joint.name, "fixed"
        if joint.name in zero:
            axis, kind = _number(axis_of(joint, symbols)).ravel(), joint.kind
            if joint.name in drives:
                limits, name = drives[joint.name].range, drives[joint.name].reading
            start = TreeJoint(name, kind, joint.parent, joint.child, origin, axis)
            origin = origin @ motion(start, zero[joint.name])
            offsets[joint.child] = _number(motion_of(symbols, joint.name))
        led = follows.get(joint.name)
        joints.append(TreeJoint(name, kind, joint.parent, joint.child, origin, axis, limits, led))
    moved = offsets[mechanism.flange] @ _number(motion_of(symbols, "tool"))
    at_flange = moved @ _number(frame_of(symbols, "tool"))
    world = _number(frame_of(symbols, "base"))
    return Tree(machine.name, tuple(joints), offsets, mechanism.flange, at_flange, world)


def frames_of(joints: Sequence[TreeJoint], readings: Mapping[str, float], root: str) -> dict[str, Array]:
    """Return the frames (4, 4) mm of all links in the ``root``, at readings in mm and rad; parents come first."""
    links = {root: np.eye(4)}
    for joint in joints:
        moved = readings.get(joint.name, 0.0)
        if joint.follows is not None:
            moved = joint.follows[1] * readings.get(joint.follows[0], 0.0)
        links[joint.child] = links[joint.parent] @ joint.origin @ motion(joint, moved)
    return links


def motion(joint: TreeJoint, displacement: float) -> Array:
    """(4, 4) motion of a joint by mm or rad; the identity for a fixed one."""
    out = np.eye(4)
    if joint.kind == "prismatic":
        out[:3, 3] = displacement * joint.axis
    elif joint.kind == "revolute":
        out[:3, :3] = turn(joint.axis, displacement)
    return out


def turn(axis: Array, angle: float) -> Array:
    """(3, 3) rotation about a unit vector (3,), rad."""
    return _number(lie.axis_rotation(ca.SX(ca.DM(axis)), ca.SX(angle)))


def _check(machine: Machine, values: Mapping[str, float], what: str) -> None:
    """Raise InputError, which ``what`` closes, for what no tree of rigid links with readings in mm and rad is."""
    mechanism = machine.mechanism
    closing = [*(j.name for j in mechanism.closing), *(rod.name for rod in mechanism.rods)]
    if closing:
        raise InputError(
            f"{machine.name}: found loops, closed by {', '.join(closing)}, expected an open machine: "
            f"{what} holds trees only"
        )
    passive = [
        (j.name, f"a {j.kind} joint that nothing drives") for j in mechanism.passive if COORDINATES[j.kind]
    ]
    several = [
        (f.joint, "a joint that follows several others") for f in mechanism.followers if len(f.terms) > 1
    ]
    computed = [(f.joint, "a joint that a formula moves") for f in mechanism.followers if f.law is not None]
    for name, found in (*passive, *several, *computed):
        raise InputError(
            f"{machine.name}: joint {name!r}: found {found}, expected joints that are driven, or follow one other, for {what}"
        )
    mounts = {mount.name for mount in machine.mounts}
    hung = [mass.name for mass in machine.masses if mass.body in mounts]
    if hung:
        raise InputError(
            f"{machine.name}: masses.{hung[0]}: found a mass in a further frame, expected one in a body for {what}"
        )
    for actuator in mechanism.actuators:
        check_uncoupled(machine, actuator, what)
        gain = values[actuator.gain] if actuator.gain else 1.0
        if gain != 1.0 or actuator.reading_unit != actuator.unit:
            raise InputError(
                f"{machine.name}: joint {actuator.reading!r}: found a gain of {gain:g} {actuator.unit} per "
                f"{actuator.reading_unit}, expected readings in mm and rad with gain 1 for {what}"
            )


def check_uncoupled(machine: Machine, actuator: Actuator, what: str) -> None:
    """Raises InputError, which ``what`` closes, for a joint whose readings hold the motion of others."""
    if any(actuator.coupled.values()):
        raise InputError(
            f"{machine.name}: joint {actuator.reading!r}: found readings coupled to {', '.join(actuator.coupled)}, expected "
            f"the joint's own motion for {what}"
        )


def _number(expression: ca.SX) -> Array:
    return np.array(ca.evalf(expression).full(), dtype=float)


@dataclass(frozen=True)
class Lump:
    """Point masses of one link: kg, centre (3,) m, and inertia (3, 3) kg m^2 about it."""

    kg: float
    centre: Array
    inertia: Array


@dataclass(frozen=True)
class Links:
    """Joints in an order in which parents come first; the first link is ``root``, the tool's frame is ``tool``."""

    joints: tuple[TreeJoint, ...]
    root: str
    tool: str
    lumps: Mapping[str, Lump]

    def follow(self, joint: TreeJoint) -> tuple[str, float]:
        """Return the joint that one follows, and the ratio in m and rad."""
        other, ratio = joint.follows or ("", 0.0)
        lead = next(each for each in self.joints if each.name == other)
        return other, ratio / joint.unit * lead.unit


def links_of(machine: Machine, tree: Tree) -> Links:
    """Return the links of a machine's tree. ``world`` is there if the base does not stand in the sensor's frame itself."""
    links = {BASE, *(joint.child for joint in tree.joints)}
    joints = {joint.name for joint in tree.joints}
    flange = tree.flange if tree.flange == "flange" else free_name("flange", links)
    tool = free_name("tool", links)
    fixed = [_fixed(free_name("tool_joint", joints), flange, tool, tree.tool)]
    if flange != tree.flange:
        fixed = [_fixed(free_name("flange_joint", joints), tree.flange, flange, np.eye(4)), *fixed]
    standing = []
    if not np.array_equal(tree.world, np.eye(4)):
        standing = [_fixed(free_name("base_joint", joints), free_name("world", links), BASE, tree.world)]
    chain = (*standing, *tree.joints, *fixed)
    return Links(chain, chain[0].parent, tool, _lumps(machine, tree, tool))


def free_name(name: str, taken: set[str]) -> str:
    """Return the name, with underscores if it is ``taken``, and add it to those."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _fixed(name: str, parent: str, child: str, origin: Array) -> TreeJoint:
    return TreeJoint(name, "fixed", parent, child, origin, np.array([0.0, 0.0, 1.0]))


def _lumps(machine: Machine, tree: Tree, tool: str) -> dict[str, Lump]:
    """Return the masses of each link as one."""
    points: dict[str, list[tuple[float, Array]]] = {}
    for mass in machine.masses:
        if mass.kg > 0.0:
            body, offset = (tool, np.eye(4)) if mass.body == "tool" else (mass.body, tree.offsets[mass.body])
            points.setdefault(body, []).append((mass.kg, (offset @ np.append(mass.com, 1.0))[:3]))
    return {body: _lump(held) for body, held in points.items()}


def _lump(points: Sequence[tuple[float, Array]]) -> Lump:
    """Return points of kg at places (3,) mm as one."""
    total = sum(kg for kg, _ in points)
    centre = np.sum([kg * at for kg, at in points], axis=0) / total
    spread = np.zeros((3, 3))
    for kg, at in points:
        arm = (at - centre) / MM_PER_M
        spread += kg * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Lump(total, centre / MM_PER_M, spread)


def in_comment(line: str) -> str:
    """Return a line that may stand in an XML comment."""
    while "--" in line:
        line = line.replace("--", "- -")
    return line.removesuffix("-")
