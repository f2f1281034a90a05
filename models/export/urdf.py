"""A machine as URDF: metres, radians, the machine's own names.

Link ``base`` is the nominal frame of the base, ``linkK`` (or the body's name in a graph) moves with its joint,
``flange`` carries ``tool``; where the base does not stand in the sensor's frame itself, that frame is the link ``world``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from truepose.models.export.numbers import MM_PER_M, clean, text, xyz_rpy
from truepose.models.export.tree import Tree, TreeJoint
from truepose.models.machine import Machine, Mass
from truepose.models.mechanism import BASE

Array = NDArray[np.float64]
_UNLIMITED = 1e6
"""mm; limits of a slide without a range, since a URDF's prismatic joint without limits cannot move."""
_STATED = (
    "m and rad. Effort and velocity are not known: 0. Masses are points: they have no inertia of their own.",
)


def urdf_text(machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
    """The URDF; ``notes`` stand in a comment at its head."""
    links = _Names({BASE, *(joint.child for joint in tree.joints)})
    joints = _Names({joint.name for joint in tree.joints})
    flange = tree.flange if tree.flange == "flange" else links.free("flange")
    tool = links.free("tool")
    fixed = [_fixed(joints.free("tool_joint"), flange, tool, tree.tool)]
    if flange != tree.flange:
        fixed = [_fixed(joints.free("flange_joint"), tree.flange, flange, np.eye(4)), *fixed]
    standing = []
    if not np.array_equal(tree.world, np.eye(4)):
        standing = [_fixed(joints.free("base_joint"), links.free("world"), BASE, tree.world)]
    bodies = {BASE: BASE, **{joint.child: joint.child for joint in tree.joints}, "tool": tool}
    masses: dict[str, list[tuple[float, Array]]] = {}
    for mass in machine.masses:
        masses.setdefault(bodies[mass.body], []).append((mass.kg, _centre(mass, tree)))
    robot = ElementTree.Element("robot", name=machine.name)
    for line in (*_STATED, *notes):
        robot.append(ElementTree.Comment(f" {_in_comment(line)} "))
    chain = [*standing, *tree.joints, *fixed]
    for name in (chain[0].parent, *(joint.child for joint in chain)):
        robot.append(_link(name, masses.get(name, ())))
    slides = {joint.name: joint.kind == "prismatic" for joint in chain}
    for joint in chain:
        robot.append(_joint(joint, slides))
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


class _Names:
    """Names that are taken; a further one gets underscores until it is free."""

    def __init__(self, taken: set[str]) -> None:
        self._taken = taken

    def free(self, name: str) -> str:
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name


def _fixed(name: str, parent: str, child: str, origin: Array) -> TreeJoint:
    return TreeJoint(name, "fixed", parent, child, origin, np.array([0.0, 0.0, 1.0]))


def _centre(mass: Mass, tree: Tree) -> Array:
    """Centre of a mass (3,), mm, in the frame of its link."""
    point = np.append(mass.com, 1.0)
    out: Array = (point if mass.body == "tool" else tree.offsets[mass.body] @ point)[:3]
    return out


def _link(name: str, masses: Iterable[tuple[float, Array]]) -> ElementTree.Element:
    link = ElementTree.Element("link", name=name)
    points = [(kg, centre) for kg, centre in masses if kg > 0.0]
    if not points:
        return link
    total = sum(kg for kg, _ in points)
    centre = np.sum([kg * at for kg, at in points], axis=0) / total
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_metres(centre), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=text(total))
    spread = np.zeros((3, 3))
    for kg, at in points:
        arm = (at - centre) / MM_PER_M
        spread += kg * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    places = [(f"i{'xyz'[i]}{'xyz'[j]}", spread[i, j]) for i in range(3) for j in range(i, 3)]
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


def _metres(point: Array) -> str:
    return text(*(clean(float(v) / MM_PER_M) for v in point))


def _in_comment(line: str) -> str:
    """A line that may stand in an XML comment."""
    while "--" in line:
        line = line.replace("--", "- -")
    return line.removesuffix("-")
