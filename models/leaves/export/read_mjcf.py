"""Read an exported MJCF: the parts that it states, as ``truepose init --mjcf`` has them of MuJoCo, and the machine they make.

Only what ``mjcf`` and ``mjcf_loops`` write is read here, so that nobody needs MuJoCo to export.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from truepose.arrays import Array
from truepose.models.builders.urdf_file import parse_own_xml
from truepose.models.file.machine_file import SCHEMA, checked_machine
from truepose.models.leaves.export.numbers import MM_PER_M
from truepose.models.leaves.starting.mjcf_choice import choose
from truepose.models.leaves.starting.mjcf_graph import MjcfGraph
from truepose.models.leaves.starting.mjcf_model import placed_frame
from truepose.models.leaves.starting.mjcf_parts import Coupling, PartBody, PartJoint, Parts, Tie, Tip
from truepose.models.lie import inverse_pose, pose_of, unit_vector
from truepose.models.load import build_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import JointKind

_KINDS: dict[str, JointKind] = {"hinge": "revolute", "slide": "prismatic", "ball": "spherical"}


@dataclass(frozen=True)
class Mjcf:
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


def read_mjcf(text: str) -> Mjcf:
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
    ties = [_tie(e, numbers, parts.poses) for e in root.iterfind("equality/*") if e.tag != "joint"]
    return Mjcf(replace(parts, ties=tuple(ties)), numbers, site.get("name", ""))


def _add_bodies(element: Element, number: int, out: list[PartBody]) -> None:
    """Add all bodies inside one to ``out``, each before those inside it."""
    for body in element.findall("body"):
        frame = placed_frame(_numbers(body, "pos", "0 0 0"), _numbers(body, "quat", "1 0 0 0"))
        joints = tuple(_joint(e) for e in body if e.tag in ("joint", "freejoint"))
        out.append(PartBody(body.get("name", ""), number, frame, joints))
        _add_bodies(body, len(out) - 1, out)


def _joint(element: Element) -> PartJoint:
    kind: JointKind = "free" if element.tag == "freejoint" else _KINDS[element.get("type", "hinge")]
    unit = MM_PER_M if kind == "prismatic" else 1.0
    axis = unit_vector(_numbers(element, "axis", "0 0 1"))
    anchor = MM_PER_M * np.array(_numbers(element, "pos", "0 0 0"))
    (reference,) = _numbers(element, "ref", "0")
    ends = [unit * value for value in _numbers(element, "range", "")]
    limits = (ends[0], ends[1]) if ends else None
    return PartJoint(element.get("name", ""), kind, axis, anchor, unit * reference, limits)


def _coupling(element: Element, joints: Mapping[str, PartJoint]) -> Coupling:
    pair = [joints[element.get(end, "")] for end in ("joint1", "joint2")]
    own, other = (MM_PER_M if joint.kind == "prismatic" else 1.0 for joint in pair)
    terms = [own * v / other**n for n, v in enumerate(_numbers(element, "polycoef", "0 1 0 0 0"))]
    return Coupling(pair[0].name, pair[1].name, tuple(terms))


def _tie(element: Element, numbers: Mapping[str, int], poses: Array) -> Tie:
    """Return a tie; a ``connect`` holds the points together that are one where the file has the bodies."""
    one, other = (numbers[element.get(end, "world")] for end in ("body1", "body2"))
    straight = [1.0, 0.0, 0.0, 0.0]
    if element.tag == "weld":
        place = _numbers(element, "relpose", "")
        frames = (placed_frame(place[:3], place[3:]), np.eye(4))
        return Tie(element.get("name", ""), "fixed", (one, other), frames)
    here = placed_frame(_numbers(element, "anchor", "0 0 0"), straight)
    there = pose_of(np.eye(3), (inverse_pose(poses[other]) @ poses[one] @ here)[:3, 3])
    return Tie(element.get("name", ""), "spherical", (one, other), (here, there))


def _numbers(element: Element, attribute: str, usual: str) -> list[float]:
    return [float(word) for word in element.get(attribute, usual).split()]
