"""A machine as URDF: metres, radians, the machine's own names.

Link ``base`` is the nominal frame of the base, ``linkK`` (or the body's name in a graph) moves with its joint,
``flange`` carries ``tool``; where the base does not stand in the sensor's frame itself, that frame is the link ``world``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.builders.urdf import Urdf as UrdfSection
from truepose.models.builders.urdf import expanded
from truepose.models.builders.urdf_file import Robot, inertials_of, parse_own_xml, parse_urdf
from truepose.models.file.machine_file import SCHEMA, checked_machine
from truepose.models.leaves.export.held import held
from truepose.models.leaves.export.links import (
    MM_PER_M,
    Lump,
    Tree,
    TreeJoint,
    clean,
    cleaned,
    following,
    in_comment,
    links_of,
    text,
    tree_of,
    xyz_rpy,
)
from truepose.models.leaves.export.write import (
    LinkFormat,
    compare_frames,
    compare_ranges,
    formats,
    sample_rows,
)
from truepose.models.lie import pose_of, rpy_matrix
from truepose.models.load import build_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE
from truepose.models.units import UnitSystem

_UNLIMITED = 1e6
"""mm; limits of a slide without a range, since a URDF's prismatic joint without limits cannot move."""
_STATED = (
    "m and rad. Effort and velocity are not known: 0. Masses are points: they have no inertia of their own.",
)


@formats.add("urdf")
class Urdf(LinkFormat):
    """A URDF, read back by ``type: urdf``."""

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
            robot.append(_joint(joint, links.slides))
        ElementTree.indent(robot)
        return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"

    def compare(self, text: str, machine: Machine, meant: Tree) -> Iterator[str]:
        """Yield how the links of a URDF differ from a tree."""
        links = links_of(machine, meant)
        carrying = {joint.parent for joint in links.joints} | {links.tool}
        read = read_urdf(text, [links.tool, *(j.child for j in links.joints if j.child not in carrying)])
        yield from compare_ranges(read, machine)
        yield from compare_frames({BASE: read_base(text)}, {BASE: meant.world})
        found = tree_of(read, held(read).values, "URDF")
        for readings in sample_rows(machine):
            yield from compare_frames(found.links(readings), links.frames(readings))


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
        other, factor = following(joint, slides)
        ElementTree.SubElement(out, "mimic", joint=other, multiplier=text(factor), offset="0")
    return out


def read_urdf(text: str, tips: Sequence[str]) -> Machine:
    """Return the machine that leads from the base to the links ``tips``, of which the first is the tool.

    Raises InputError naming the element that cannot be read.
    """
    file = Path("export.urdf")  # nothing is written: a process that is killed leaves no file behind
    try:
        robot = Robot.of(parse_urdf(text.encode(), file), file)
        section = UrdfSection(type="urdf", file=file.name, base_link=BASE, tip_link=tuple(tips))
        graph = expanded(section, robot, UnitSystem(), "mechanism")
        inertials_of(robot, graph["bodies"])
        return build_machine(checked_machine(file, {"schema": SCHEMA, "name": "export", "mechanism": graph}))
    except InputError as exc:
        raise InputError(str(exc).replace(f"{file}: ", "")) from exc


def read_base(text: str) -> Array:
    """Return the base (4, 4) mm in the link that carries it; the identity where it is the first link."""
    out = np.eye(4)
    for joint in parse_own_xml(text).findall("joint"):
        child, origin = joint.find("child"), joint.find("origin")
        if child is not None and origin is not None and child.get("link") == BASE:
            xyz, rpy = ([float(v) for v in origin.get(name, "0 0 0").split()] for name in ("xyz", "rpy"))
            out = pose_of(rpy_matrix(rpy), np.multiply(xyz, MM_PER_M))
    return out
