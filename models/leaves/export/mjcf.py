"""A machine as MuJoCo's MJCF: m, rad, kg; the machine's own names of bodies and joints, and a site ``tool``.

Source: MuJoCo documentation, XML reference (``body``, ``joint``, ``inertial``, ``equality/joint``, ``compiler``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

import numpy as np

from truepose.arrays import Array
from truepose.models.leaves.export.links import Links, Lump, links_of
from truepose.models.leaves.export.numbers import MM_PER_M, cleaned, quaternion, text
from truepose.models.leaves.export.tree import Tree, TreeJoint
from truepose.models.leaves.export.urdf import in_comment
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE

_STATED = (
    "m, rad and kg. Masses are points; boundmass and boundinertia give those links something that have none, as MuJoCo asks.",
)
_LEAST = ("1e-06", "1e-09")
"""kg and kg m^2: a millionth of what moves in an arm."""


def mjcf_text(machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
    """The model; ``notes`` stand in comments at its head. The tool's site is named like the tool's link in the URDF."""
    links = links_of(machine, tree)
    root, world = model_head(machine, tree.world, notes)
    bodies = _bodies(world, links)
    for name, lump in links.lumps.items():
        bodies[name].insert(0, inertial(lump))
    ElementTree.SubElement(bodies[links.tool], "site", name=links.tool)
    equality = [_following(joint, links.slides) for joint in links.joints if joint.follows is not None]
    if equality:
        ElementTree.SubElement(root, "equality").extend(equality)
    return model_text(root, machine)


def model_text(root: ElementTree.Element, machine: Machine) -> str:
    """Return the text of a model, to which a motor for each driven joint is added: it says which joints are driven."""
    motors = ElementTree.SubElement(root, "actuator")
    for name in machine.mechanism.readings:
        ElementTree.SubElement(motors, "motor", name=name, joint=name)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def model_head(
    machine: Machine, world_base: Array, notes: Sequence[str]
) -> tuple[ElementTree.Element, ElementTree.Element]:
    """The element ``mujoco`` with comments, settings and gravity, and its ``worldbody``, the sensor's frame."""
    root = ElementTree.Element("mujoco", model=machine.name)
    for line in (*_STATED, *notes):
        root.append(ElementTree.Comment(f" {in_comment(line)} "))
    mass, inertia = _LEAST
    compiler = {"angle": "radian", "autolimits": "true", "inertiafromgeom": "false", "balanceinertia": "true"}
    ElementTree.SubElement(root, "compiler", {**compiler, "boundmass": mass, "boundinertia": inertia})
    if machine.gravity is not None:  # told in the base's frame
        world_gravity = world_base[:3, :3] @ np.array(machine.gravity)
        ElementTree.SubElement(root, "option", gravity=text(*cleaned(world_gravity)))
    return root, ElementTree.SubElement(root, "worldbody")


def body_in(parent: ElementTree.Element, name: str, pose: Array) -> ElementTree.Element:
    """A body at a pose (4, 4) mm inside another's element."""
    place = {"pos": text(*cleaned(pose[:3, 3] / MM_PER_M)), "quat": text(*quaternion(pose[:3, :3]))}
    return ElementTree.SubElement(parent, "body", {"name": name, **place})


def _bodies(world: ElementTree.Element, links: Links) -> dict[str, ElementTree.Element]:
    """Elements of all links by name, each inside its parent's; the sensor's frame is MuJoCo's own world."""
    root = world if links.root != BASE else ElementTree.SubElement(world, "body", name=BASE)
    out = {links.root: root}
    for joint in links.joints:
        body = out[joint.child] = body_in(out[joint.parent], joint.child, joint.origin)
        if joint.kind != "fixed":
            body.append(_joint(joint))
    return out


def _joint(joint: TreeJoint) -> ElementTree.Element:
    slides = joint.kind == "prismatic"
    kind = {"name": joint.name, "type": "slide" if slides else "hinge"}
    out = ElementTree.Element("joint", {**kind, "axis": text(*cleaned(joint.axis))})
    if joint.range is not None:
        unit = MM_PER_M if slides else 1.0
        out.set("range", text(*(v / unit for v in joint.range)))
    return out


def inertial(lump: Lump) -> ElementTree.Element:
    places = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    inertia = text(*cleaned(np.array([lump.inertia[place] for place in places])))
    where = {"pos": text(*cleaned(lump.centre)), "mass": text(lump.kg)}
    return ElementTree.Element("inertial", {**where, "fullinertia": inertia})


def _following(joint: TreeJoint, slides: Mapping[str, bool]) -> ElementTree.Element:
    """A joint that follows another, as an equality constraint."""
    other, ratio = joint.follows or ("", 0.0)
    unit = MM_PER_M if slides[joint.name] else 1.0
    factor = ratio / unit * (MM_PER_M if slides[other] else 1.0)
    told = {"joint1": joint.name, "joint2": other, "polycoef": text(0.0, factor, 0.0, 0.0, 0.0)}
    return ElementTree.Element("joint", told)
