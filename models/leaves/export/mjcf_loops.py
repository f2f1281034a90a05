"""A machine with closed loops as MJCF: a tree of bodies that stand as at home, and equality constraints that close it.

Every body stands in the file where it is at home, so that MuJoCo's own start is an assembled machine; ``ref`` makes joints
count as the machine does. A joint that closes a loop leads to a body of its own, welded to the one that it closes at; a rod
is a body with a universal joint at one ball and a ``connect`` at the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np

from truepose.arrays import Array
from truepose.models.leaves.export.links import Names, lump_of
from truepose.models.leaves.export.mjcf import body_in, inertial, model_head, model_text
from truepose.models.leaves.export.numbers import MM_PER_M, cleaned, text
from truepose.models.leaves.export.standing import Standing
from truepose.models.lie import inverse_pose, pose_of
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE, Actuator, Joint, Rod


@dataclass
class _Model:
    """What is built: elements of bodies by name, where they stand (4, 4), and constraints."""

    machine: Machine
    at: Standing
    names: Names
    joints: Names
    elements: dict[str, ElementTree.Element] = field(default_factory=dict)
    equality: list[ElementTree.Element] = field(default_factory=list)

    @property
    def drives(self) -> dict[str, Actuator]:
        return {a.drives: a for a in self.machine.mechanism.actuators}


def mjcf_loops_text(machine: Machine, at: Standing, notes: Sequence[str]) -> str:
    """The model; ``notes`` stand in comments at its head."""
    mechanism = machine.mechanism
    root, world = model_head(machine, at.world, notes)
    driven = {a.drives: a.reading for a in mechanism.actuators}
    own = {driven.get(j.name, j.name) for j in mechanism.tree}
    model = _Model(machine, at, Names(set(at.bodies)), Names(own))
    model.elements[BASE] = body_in(world, BASE, at.world @ at.bodies[BASE])
    for joint in mechanism.tree:
        if joint.kind == "free":  # MuJoCo has them in its own world only; the base does not move in it
            body = body_in(world, joint.child, at.world @ at.bodies[joint.child])
            model.elements[joint.child] = body
            ElementTree.SubElement(body, "freejoint", name=joint.name)
            continue
        body = _body(model, joint.child, joint.parent, at.bodies[joint.child])
        body.extend(_coordinates(model, joint, at.bodies[joint.child]))
    for joint in mechanism.closing:
        _close(model, joint)
    for rod in mechanism.rods:
        _rod(model, rod)
    tool = model.names.free("tool")
    held = model.elements["tool"] = body_in(model.elements[mechanism.flange], tool, at.tool)
    ElementTree.SubElement(held, "site", name=tool)
    for name in {mass.body for mass in machine.masses}:
        points = [(m.kg, np.array(m.com)) for m in machine.masses if m.body == name and m.kg > 0.0]
        if points:
            model.elements[name].insert(0, inertial(lump_of(points)))
    ElementTree.SubElement(root, "equality").extend(model.equality)
    return model_text(root, machine)


def _body(model: _Model, name: str, parent: str, pose: Array) -> ElementTree.Element:
    """A body that stands at a pose in the base's frame, inside another's element."""
    element = body_in(model.elements[parent], name, inverse_pose(model.at.bodies[parent]) @ pose)
    model.elements[name] = element
    return element


def _coordinates(model: _Model, joint: Joint, pose: Array) -> list[ElementTree.Element]:
    """The joint's coordinates, in the frame of a body at ``pose`` that they move."""
    frame = inverse_pose(pose) @ model.at.joints[joint.name]
    turn = frame[:3, :3]
    place = {"pos": text(*cleaned(frame[:3, 3] / MM_PER_M))}
    actuator = model.drives.get(joint.name)
    name = actuator.reading if actuator else joint.name
    if joint.kind == "universal":  # the second axis stands still in the body, the first in the parent
        return [
            _hinge(model.joints.free(f"{name}_x"), turn[:, 0], place),
            _hinge(model.joints.free(f"{name}_y"), np.array([0.0, 1.0, 0.0]), place),
        ]
    if joint.kind == "spherical":
        return [ElementTree.Element("joint", {"name": name, "type": "ball", **place})]
    if joint.kind == "fixed":
        return []
    kind = "slide" if joint.kind == "prismatic" else "hinge"
    axis = text(*cleaned(turn @ model.at.axes[joint.name]))
    out = ElementTree.Element("joint", {"name": name, "type": kind, "axis": axis, **place})
    return [_driven(model, out, actuator)]


def _hinge(name: str, axis: Array, place: dict[str, str]) -> ElementTree.Element:
    return ElementTree.Element(
        "joint", {"name": name, "type": "hinge", "axis": text(*cleaned(axis)), **place}
    )


def _driven(model: _Model, element: ElementTree.Element, actuator: Actuator | None) -> ElementTree.Element:
    """A joint that counts as its reading does, in its range."""
    if actuator is not None:
        unit = MM_PER_M if actuator.unit == "mm" else 1.0
        element.set("ref", text(model.at.readings[actuator.reading] / unit))
        if actuator.range is not None:
            element.set("range", text(*(v / unit for v in actuator.range)))
    return element


def _close(model: _Model, joint: Joint) -> None:
    """A joint whose child has its place already: a body that the joint moves, welded to the child."""
    pose = model.at.bodies[joint.child]
    name = model.names.free(f"{joint.name}_end")
    body = _body(model, name, joint.parent, pose)
    body.extend(_coordinates(model, joint, pose))
    told = {"name": joint.name, "body1": name, "body2": joint.child, "relpose": text(0, 0, 0, 1, 0, 0, 0)}
    model.equality.append(ElementTree.Element("weld", told))


def _rod(model: _Model, rod: Rod) -> None:
    """A rod from ball to ball; where an actuator sets its length, it slides in itself."""
    start, end = model.at.rods[rod.name]
    length = float(np.linalg.norm(end - start))
    pose = pose_of(_along((end - start) / length), start)
    name = model.names.free(rod.name)
    body = _body(model, name, rod.body_a, pose)
    for a in ("x", "y"):
        axis = text(*(float(a == other) for other in "xyz"))
        ElementTree.SubElement(
            body, "joint", name=model.joints.free(f"{rod.name}_{a}"), type="hinge", axis=axis
        )
    actuator = model.drives.get(rod.name)
    if actuator is not None:
        name = model.names.free(f"{rod.name}_end")
        body = body_in(body, name, np.eye(4))
        sliding = ElementTree.SubElement(body, "joint", name=actuator.reading, type="slide", axis="0 0 1")
        _driven(model, sliding, actuator)
    told = {"name": rod.name, "body1": name, "body2": rod.body_b, "anchor": text(0.0, 0.0, length / MM_PER_M)}
    model.equality.append(ElementTree.Element("connect", told))


def _along(direction: Array) -> Array:
    """(3, 3) a rotation whose z axis is a unit vector (3,)."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])
