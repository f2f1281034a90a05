"""A machine as URDF: metres, radians, the machine's own names.

Link ``base`` is the nominal frame of the base, ``linkK`` (or the body's name in a graph) moves with its joint,
``flange`` carries ``tool``; where the base does not stand in the sensor's frame itself, that frame is the link ``world``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

from truepose.models.leaves.export.links import Lump, links_of
from truepose.models.leaves.export.numbers import MM_PER_M, clean, cleaned, text, xyz_rpy
from truepose.models.leaves.export.tree import Tree, TreeJoint
from truepose.models.machine.machine import Machine

_UNLIMITED = 1e6
"""mm; limits of a slide without a range, since a URDF's prismatic joint without limits cannot move."""
_STATED = (
    "m and rad. Effort and velocity are not known: 0. Masses are points: they have no inertia of their own.",
)


def urdf_text(machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
    """The URDF; ``notes`` stand in a comment at its head."""
    robot = urdf_elements(machine, tree, notes)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def urdf_elements(machine: Machine, tree: Tree, notes: Sequence[str]) -> ElementTree.Element:
    """The element ``robot`` with comments, links and joints."""
    links = links_of(machine, tree)
    robot = ElementTree.Element("robot", name=machine.name)
    for line in (*_STATED, *notes):
        robot.append(ElementTree.Comment(f" {in_comment(line)} "))
    for name in (links.root, *(joint.child for joint in links.joints)):
        robot.append(_link(name, links.lumps.get(name)))
    for joint in links.joints:
        robot.append(_joint(joint, links.slides))
    return robot


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


def _joint(joint: TreeJoint, slides: Mapping[str, bool]) -> ElementTree.Element:
    """``slides``: of each joint by name, whether it is prismatic."""
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
        unit = MM_PER_M if kind == "prismatic" else 1.0
        limits = {"lower": text(low / unit), "upper": text(high / unit)}
        ElementTree.SubElement(out, "limit", {**limits, "effort": "0", "velocity": "0"})
    if joint.follows is not None:
        other, ratio = joint.follows
        unit = MM_PER_M if slides[joint.name] else 1.0
        factor = ratio / unit * (MM_PER_M if slides[other] else 1.0)
        ElementTree.SubElement(out, "mimic", joint=other, multiplier=text(factor), offset="0")
    return out


def in_comment(line: str) -> str:
    """A line that may stand in an XML comment."""
    while "--" in line:
        line = line.replace("--", "- -")
    return line.removesuffix("-")
