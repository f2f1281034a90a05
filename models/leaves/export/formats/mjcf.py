"""A machine as MuJoCo's MJCF: m, rad, kg; the machine's own names of bodies and joints, and a site ``tool``.

Source: MuJoCo documentation, XML reference (``body``, ``joint``, ``inertial``, ``equality/joint``, ``compiler``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from truepose.arrays import Array
from truepose.models.builders.urdf_file import parse_own_xml
from truepose.models.file.machine_file import SCHEMA, checked_machine
from truepose.models.leaves.export.held import held
from truepose.models.leaves.export.links import (
    MM_PER_M,
    Links,
    Lump,
    Tree,
    TreeJoint,
    cleaned,
    following,
    in_comment,
    links_of,
    quaternion,
    text,
    tree_of,
)
from truepose.models.leaves.export.write import (
    LinkFormat,
    compare_frames,
    compare_ranges,
    formats,
    sample_rows,
)
from truepose.models.leaves.starting.mjcf import placed_frame
from truepose.models.leaves.starting.mjcf_graph import (
    Coupling,
    MjcfGraph,
    PartBody,
    PartJoint,
    Parts,
    Tip,
    choose,
)
from truepose.models.lie import unit_vector
from truepose.models.load import build_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE, JointKind

_STATED = (
    "m, rad and kg. Masses are points; boundmass and boundinertia give those links something that have none, as MuJoCo asks.",
)
_LEAST = ("1e-06", "1e-09")
"""kg and kg m^2: a millionth of what moves in an arm."""


@formats.add("mjcf")
class Mjcf(LinkFormat):
    """MuJoCo's MJCF, read back as ``truepose init --mjcf`` starts from it, without MuJoCo."""

    name, title, suffixes = "mjcf", "MJCF", (".xml",)

    def text(self, machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
        """Return the model. The tool's site is named like the tool's link in the URDF; motors say which joints are driven."""
        links = links_of(machine, tree)
        root = _head(machine, tree.world, notes)
        bodies = _bodies(ElementTree.SubElement(root, "worldbody"), links)
        for name, lump in links.lumps.items():
            bodies[name].insert(0, _inertial(lump))
        ElementTree.SubElement(bodies[links.tool], "site", name=links.tool)
        equality = [_following(joint, links.slides) for joint in links.joints if joint.follows is not None]
        if equality:
            ElementTree.SubElement(root, "equality").extend(equality)
        motors = ElementTree.SubElement(root, "actuator")
        for name in machine.mechanism.readings:
            ElementTree.SubElement(motors, "motor", name=name, joint=name)
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode") + "\n"

    def compare(self, text: str, machine: Machine, meant: Tree) -> Iterator[str]:
        """Yield how the bodies of an MJCF, and its site, differ from a tree in the world."""
        links, mjcf = links_of(machine, meant), read_mjcf(text)
        read, graph = mjcf.machine()
        yield from compare_ranges(read, machine)
        found = tree_of(read, held(read).values, "MJCF")
        still = {body.name: mjcf.parts.poses[k] for k, body in enumerate(mjcf.parts.bodies)}
        for readings in sample_rows(machine):
            moved = {name: graph.pose @ pose for name, pose in found.links(readings).items()}
            expected = {name: meant.world @ pose for name, pose in links.frames(readings).items()}
            yield from compare_frames({**still, **moved, BASE: still[BASE]}, expected)


def _head(machine: Machine, world_base: Array, notes: Sequence[str]) -> ElementTree.Element:
    """Return the element ``mujoco`` with comments, settings and gravity."""
    root = ElementTree.Element("mujoco", model=machine.name)
    for line in (*_STATED, *notes):
        root.append(ElementTree.Comment(f" {in_comment(line)} "))
    mass, inertia = _LEAST
    compiler = {"angle": "radian", "autolimits": "true", "inertiafromgeom": "false", "balanceinertia": "true"}
    ElementTree.SubElement(root, "compiler", {**compiler, "boundmass": mass, "boundinertia": inertia})
    if machine.gravity is not None:  # told in the base's frame
        world_gravity = world_base[:3, :3] @ np.array(machine.gravity)
        ElementTree.SubElement(root, "option", gravity=text(*cleaned(world_gravity)))
    return root


def _bodies(world: ElementTree.Element, links: Links) -> dict[str, ElementTree.Element]:
    """Elements of all links by name, each inside its parent's; the sensor's frame is MuJoCo's own world."""
    root = world if links.root != BASE else ElementTree.SubElement(world, "body", name=BASE)
    out = {links.root: root}
    for joint in links.joints:
        xyz, turn = joint.origin[:3, 3] / MM_PER_M, joint.origin[:3, :3]
        place = {"pos": text(*cleaned(xyz)), "quat": text(*quaternion(turn))}
        body = ElementTree.SubElement(out[joint.parent], "body", {"name": joint.child, **place})
        out[joint.child] = body
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


def _inertial(lump: Lump) -> ElementTree.Element:
    places = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    inertia = text(*cleaned(np.array([lump.inertia[place] for place in places])))
    where = {"pos": text(*cleaned(lump.centre)), "mass": text(lump.kg)}
    return ElementTree.Element("inertial", {**where, "fullinertia": inertia})


def _following(joint: TreeJoint, slides: Mapping[str, bool]) -> ElementTree.Element:
    """A joint that follows another, as an equality constraint."""
    other, factor = following(joint, slides)
    told = {"joint1": joint.name, "joint2": other, "polycoef": text(0.0, factor, 0.0, 0.0, 0.0)}
    return ElementTree.Element("joint", told)


_KINDS: dict[str, JointKind] = {"hinge": "revolute", "slide": "prismatic", "ball": "spherical"}


@dataclass(frozen=True)
class _Read:
    """A model that was read, with the number of each body and the frame (4, 4) mm of its site in the world."""

    parts: Parts
    bodies: dict[str, int]
    tool: str

    def machine(self) -> tuple[Machine, MjcfGraph]:
        """Return the machine that leads to the tool and to all other bodies, and the graph that it is built from."""
        carrying = {body.parent for body in self.parts.bodies}
        tips = [self.bodies[self.tool], *(k for k in self.bodies.values() if k not in carrying)]
        graph = MjcfGraph(choose(self.parts, tips, "export"), "export")
        section = graph.section(Tip(tips[0]))
        file = checked_machine(
            Path("export.yaml"), {"schema": SCHEMA, "name": "export", "mechanism": section}
        )
        return build_machine(file), graph


def read_mjcf(text: str) -> _Read:
    """Return the model of a text. Raises KeyError for a body or joint that it has not."""
    root = parse_own_xml(text)
    (world,), (site,) = root.findall("worldbody"), root.findall("worldbody//site")
    bodies = [PartBody("world", 0, np.eye(4))]
    _add_bodies(world, 0, bodies)
    numbers = {body.name: k for k, body in enumerate(bodies)}
    joints = {joint.name: joint for body in bodies for joint in body.joints}
    parts = Parts(
        tuple(bodies),
        couplings=tuple(_coupling(e, joints) for e in root.iterfind("equality/joint")),
        driven=frozenset(joints[e.get("joint", "")].name for e in root.iterfind("actuator/motor")),
    )
    return _Read(parts, numbers, site.get("name", ""))


def _add_bodies(element: ElementTree.Element, number: int, out: list[PartBody]) -> None:
    """Add all bodies inside one to ``out``, each before those inside it."""
    for body in element.findall("body"):
        frame = placed_frame(_numbers(body, "pos", "0 0 0"), _numbers(body, "quat", "1 0 0 0"))
        joints = tuple(_read_joint(e) for e in body if e.tag in ("joint", "freejoint"))
        out.append(PartBody(body.get("name", ""), number, frame, joints))
        _add_bodies(body, len(out) - 1, out)


def _read_joint(element: ElementTree.Element) -> PartJoint:
    kind: JointKind = "free" if element.tag == "freejoint" else _KINDS[element.get("type", "hinge")]
    unit = MM_PER_M if kind == "prismatic" else 1.0
    axis = unit_vector(_numbers(element, "axis", "0 0 1"))
    anchor = MM_PER_M * np.array(_numbers(element, "pos", "0 0 0"))
    (reference,) = _numbers(element, "ref", "0")
    ends = [unit * value for value in _numbers(element, "range", "")]
    limits = (ends[0], ends[1]) if ends else None
    return PartJoint(element.get("name", ""), kind, axis, anchor, unit * reference, limits)


def _coupling(element: ElementTree.Element, joints: Mapping[str, PartJoint]) -> Coupling:
    pair = [joints[element.get(end, "")] for end in ("joint1", "joint2")]
    own, other = (MM_PER_M if joint.kind == "prismatic" else 1.0 for joint in pair)
    terms = [own * v / other**n for n, v in enumerate(_numbers(element, "polycoef", "0 1 0 0 0"))]
    return Coupling(pair[0].name, pair[1].name, tuple(terms))


def _numbers(element: ElementTree.Element, attribute: str, usual: str) -> list[float]:
    return [float(word) for word in element.get(attribute, usual).split()]
