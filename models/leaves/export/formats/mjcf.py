"""A machine as MuJoCo's MJCF: m, rad, kg; the machine's own names of bodies and joints, and a site ``tool``.

Source: MuJoCo documentation, XML reference (``body``, ``joint``, ``inertial``, ``equality/joint``, ``compiler``).
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.models.builders.urdf_file import parse_own_xml
from truepose.models.leaves.export.links import (
    MM_PER_M,
    Links,
    Lump,
    Tree,
    TreeJoint,
    cleaned,
    in_comment,
    links_of,
    quaternion,
    text,
)
from truepose.models.leaves.export.write import JointFormat, follow_read, formats
from truepose.models.lie import pose_of
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE

_STATED = (
    "m, rad and kg. Masses are points; boundmass and boundinertia give those links something that have none, as MuJoCo asks.",
)
_LEAST = ("1e-06", "1e-09")
"""kg and kg m^2: a millionth of what moves in an arm."""
_KINDS = {"hinge": "revolute", "slide": "prismatic"}


@formats.add("mjcf")
class Mjcf(JointFormat):
    """MuJoCo's MJCF."""

    name, title, suffixes = "mjcf", "MJCF", (".xml",)

    def text(self, machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
        """Return the model. The tool's site is named like the tool's link in the URDF; motors say which joints are driven."""
        links = links_of(machine, tree)
        root = _head(machine, tree.world, notes)
        bodies = _bodies(ElementTree.SubElement(root, "worldbody"), links)
        for name, lump in links.lumps.items():
            bodies[name].insert(0, _inertial(lump))
        ElementTree.SubElement(bodies[links.tool], "site", name=links.tool)
        led = [joint for joint in links.joints if joint.follows is not None]
        equality = ElementTree.SubElement(root, "equality") if led else root
        for joint in led:
            other, factor = links.follow(joint)
            polynomial = text(0.0, factor, 0.0, 0.0, 0.0)
            ElementTree.SubElement(equality, "joint", joint1=joint.name, joint2=other, polycoef=polynomial)
        motors = ElementTree.SubElement(root, "actuator")
        for name in machine.mechanism.readings:
            ElementTree.SubElement(motors, "motor", name=name, joint=name)
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode") + "\n"

    def read(self, text: str, root: str) -> list[TreeJoint]:
        """Return the joints of the bodies, each behind that of its parent."""
        model = parse_own_xml(text)
        bodies = [(root, body) for body in model.findall("worldbody/body")]
        joints = []
        for parent, body in bodies:  # which grows by the bodies inside
            name = body.get("name", "")
            bodies += [(name, inner) for inner in body.findall("body")]
            if name != root:
                joints.append(_read_body(parent, name, body))
        for element in model.findall("equality/joint"):
            factor = _numbers(element, "polycoef")[1]
            follow_read(joints, element.get("joint1", ""), element.get("joint2", ""), factor)
        return joints


def _head(machine: Machine, world_base: Array, notes: Sequence[str]) -> ElementTree.Element:
    """Return the element ``mujoco`` with comments, settings and gravity."""
    root = ElementTree.Element("mujoco", model=machine.name)
    for line in (*_STATED, *notes):
        root.append(ElementTree.Comment(f" {in_comment(line)} "))
    mass, inertia = _LEAST
    compiler = {"angle": "radian", "autolimits": "true", "inertiafromgeom": "false", "balanceinertia": "true"}
    ElementTree.SubElement(root, "compiler", {**compiler, "boundmass": mass, "boundinertia": inertia})
    if machine.gravity is not None:  # stated in the base's frame
        world_gravity = world_base[:3, :3] @ np.array(machine.gravity)
        ElementTree.SubElement(root, "option", gravity=text(*cleaned(world_gravity)))
    return root


def _bodies(world: ElementTree.Element, links: Links) -> dict[str, ElementTree.Element]:
    """Return the elements of all links by name, each inside its parent's; the sensor's frame is MuJoCo's own world."""
    root = world if links.root != BASE else ElementTree.SubElement(world, "body", name=BASE)
    out = {links.root: root}
    for joint in links.joints:
        xyz, turn = joint.origin[:3, 3] / MM_PER_M, joint.origin[:3, :3]
        place = {"pos": text(*cleaned(xyz)), "quat": text(*quaternion(turn))}
        body = ElementTree.SubElement(out[joint.parent], "body", {"name": joint.child, **place})
        out[joint.child] = body
        if joint.kind != "fixed":
            kind = "slide" if joint.kind == "prismatic" else "hinge"
            moving = {"name": joint.name, "type": kind, "axis": text(*cleaned(joint.axis))}
            limits = {} if joint.range is None else {"range": text(*(v / joint.unit for v in joint.range))}
            ElementTree.SubElement(body, "joint", {**moving, **limits})
    return out


def _inertial(lump: Lump) -> ElementTree.Element:
    places = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    inertia = text(*cleaned(np.array([lump.inertia[place] for place in places])))
    where = {"pos": text(*cleaned(lump.centre)), "mass": text(lump.kg)}
    return ElementTree.Element("inertial", {**where, "fullinertia": inertia})


def _read_body(parent: str, name: str, body: ElementTree.Element) -> TreeJoint:
    """Return the joint that carries a body; a body without one is fixed."""
    w, x, y, z = _numbers(body, "quat")
    origin = pose_of(
        Rotation.from_quat([x, y, z, w]).as_matrix(), np.multiply(_numbers(body, "pos"), MM_PER_M)
    )
    joint = body.find("joint")
    if joint is None:
        return TreeJoint("", "fixed", parent, name, origin, np.array([0.0, 0.0, 1.0]))
    kind = _KINDS[joint.get("type", "")]
    ends = [float(v) * (MM_PER_M if kind == "prismatic" else 1.0) for v in joint.get("range", "").split()]
    limits = (ends[0], ends[1]) if ends else None
    return TreeJoint(
        joint.get("name", ""), kind, parent, name, origin, np.array(_numbers(joint, "axis")), limits
    )


def _numbers(element: ElementTree.Element, attribute: str) -> list[float]:
    return [float(word) for word in element.attrib[attribute].split()]
