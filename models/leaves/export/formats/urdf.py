"""A machine as URDF: metres, radians, the machine's own names.

Link ``base`` is the nominal frame of the base, ``linkK`` (or the body's name in a graph) moves with its joint,
``flange`` carries ``tool``; where the base does not stand in the sensor's frame itself, that frame is the link ``world``.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from truepose.models.builders.urdf_file import parse_own_xml
from truepose.models.leaves.export.links import (
    MM_PER_M,
    Links,
    Lump,
    Tree,
    TreeJoint,
    clean,
    cleaned,
    in_comment,
    links_of,
    text,
    xyz_rpy,
)
from truepose.models.leaves.export.write import JointFormat, follow_read, formats
from truepose.models.lie import pose_of, rpy_matrix
from truepose.models.machine.machine import Machine

_UNLIMITED = 1e6
"""mm; limits of a slide without a range, since a URDF's prismatic joint without limits cannot move."""
_STATED = (
    "m and rad. Effort and velocity are not known: 0. Masses are points: they have no inertia of their own.",
)


@formats.add("urdf")
class Urdf(JointFormat):
    """A URDF."""

    name, title, suffixes = "urdf", "URDF", (".urdf",)

    def text(self, machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
        """Return the element ``robot`` with comments, links and joints."""
        links = links_of(machine, tree)
        robot = ElementTree.Element("robot", name=machine.name)
        for line in (*_STATED, *notes):
            robot.append(ElementTree.Comment(f" {in_comment(line)} "))
        for name in (links.root, *(joint.child for joint in links.joints)):
            robot.append(_link(name, links.lumps.get(name)))
        for joint in links.joints:
            robot.append(_joint(joint, links))
        ElementTree.indent(robot)
        return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"

    def read(self, text: str, root: str) -> list[TreeJoint]:
        """Return the joints as they stand."""
        elements = parse_own_xml(text).findall("joint")
        joints = [_read_joint(element) for element in elements]
        for element, joint in zip(elements, joints, strict=True):
            for mimic in element.findall("mimic"):
                follow_read(joints, joint.name, mimic.attrib["joint"], float(mimic.attrib["multiplier"]))
        return joints


def _link(name: str, lump: Lump | None) -> ElementTree.Element:
    link = ElementTree.Element("link", name=name)
    if lump is None:
        return link
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=text(*cleaned(lump.centre)), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=text(lump.kg))
    places = [(f"i{'xyz'[i]}{'xyz'[j]}", lump.inertia[i, j]) for i in range(3) for j in range(i, 3)]
    ElementTree.SubElement(inertial, "inertia", {name: text(clean(float(v))) for name, v in places})
    return link


def _joint(joint: TreeJoint, links: Links) -> ElementTree.Element:
    kind = "continuous" if joint.kind == "revolute" and joint.range is None else joint.kind
    out = ElementTree.Element("joint", name=joint.name, type=kind)
    xyz, rpy = xyz_rpy(joint.origin)
    ElementTree.SubElement(out, "origin", xyz=text(*xyz), rpy=text(*rpy))
    ElementTree.SubElement(out, "parent", link=joint.parent)
    ElementTree.SubElement(out, "child", link=joint.child)
    if kind == "fixed":
        return out
    ElementTree.SubElement(out, "axis", xyz=text(*(float(v) for v in joint.axis)))
    if kind != "continuous":
        low, high = joint.range or (-_UNLIMITED, _UNLIMITED)
        limits = {"lower": text(low / joint.unit), "upper": text(high / joint.unit)}
        ElementTree.SubElement(out, "limit", {**limits, "effort": "0", "velocity": "0"})
    if joint.follows is not None:
        other, factor = links.follow(joint)
        ElementTree.SubElement(out, "mimic", joint=other, multiplier=text(factor), offset="0")
    return out


def _read_joint(element: ElementTree.Element) -> TreeJoint:
    """Return a joint of a URDF that truepose wrote."""
    parts = {part.tag: part.attrib for part in element}
    xyz, rpy, axis = (
        [float(v) for v in words.split()]
        for words in (
            parts["origin"]["xyz"],
            parts["origin"]["rpy"],
            parts.get("axis", {}).get("xyz", "0 0 1"),
        )
    )
    kind = element.attrib["type"].replace("continuous", "revolute")
    unit = MM_PER_M if kind == "prismatic" else 1.0
    limit = parts.get("limit")
    limits = (unit * float(limit["lower"]), unit * float(limit["upper"])) if limit else None
    ends = parts["parent"]["link"], parts["child"]["link"]
    return TreeJoint(
        element.attrib["name"],
        kind,
        *ends,
        pose_of(rpy_matrix(rpy), np.multiply(xyz, MM_PER_M)),
        np.array(axis),
        limits,
    )
