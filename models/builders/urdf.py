"""A machine read from a URDF: the chain of joints between two of its links, or the tree to several, as a graph.

A URDF is a tree, so that it holds no closed loops; those are described as ``type: graph``. Its lengths are m and
its angles rad; the graph's are in the units of the machine file. Fixed joints stay: what their frames err by is
redundant with their neighbours', and the tolerances decide how they share it. What its links weigh is read by
``truepose.models.builders.urdf_file``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal
from xml.etree.ElementTree import Element

from pydantic import Field

from truepose.errors import InputError
from truepose.models.builders.driven import Encoder, ratio_unit, with_encoders
from truepose.models.builders.graph import Graph, mechanism_of
from truepose.models.builders.urdf_file import Robot, gravity_in, inertials_of
from truepose.models.file.fields import Section
from truepose.models.machine.builder import BuildContext, builders
from truepose.models.machine.mechanism import BASE, Mechanism
from truepose.models.units import UnitSystem, convert
from truepose.wording import close_matches, cut


class Urdf(Section):
    """The section ``mechanism`` of a chain in a URDF; ``joints`` gives joints other names than the file's."""

    type: Literal["urdf"]
    """An arm read from a URDF file."""
    file: str = Field(min_length=1)
    """The URDF, found from the folder of the machine file."""
    base_link: str
    """Link where the chain starts: the base."""
    tip_link: str | tuple[str, ...] = Field(min_length=1)
    """Link where it ends: the flange. Several, `[l_hand, r_hand]`: all that leads to them; the first is the flange."""
    joints: dict[str, str] = Field(default_factory=dict)
    """Other names for joints, `name in the URDF: name in the recording`."""
    encoders: dict[str, Encoder] = Field(default_factory=dict)
    """What columns of joints hold, by the joint's name in the recording: `J3: {coupled: {J2: 1}}`."""


@builders.add("urdf")
def urdf(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
    """The mechanism of the chain from ``base_link`` to ``tip_link``, which is the flange, or of the chains to several.

    Bodies keep their names, and the first of several tips is the flange.

    Raises InputError naming the URDF and its element, or the field of the machine file.
    """
    parsed = context.parse(Urdf, section)
    robot = Robot.read(context.file.path.parent / parsed.file)
    graph = expanded(parsed, robot, context.file.units, context.where)
    graph["joints"] = with_encoders(graph["joints"], section.get("encoders", {}), context.where)
    inertials, notes = inertials_of(robot, graph["bodies"])
    mechanism = mechanism_of(context.parse(Graph, graph), context)
    gravity = gravity_in(robot, parsed.base_link) if inertials else None
    return replace(mechanism, expanded=graph, inertials=inertials, gravity=gravity, notes=notes)


def expanded(section: Urdf, robot: Robot, units: UnitSystem, where: str) -> dict[str, Any]:
    """The section of the chains as a graph, in the file's units; ``where`` opens messages."""
    tips = (section.tip_link,) if isinstance(section.tip_link, str) else section.tip_link
    chains = [robot.chain(section.base_link, tip, where) for tip in tips]
    chain = list({id(joint): joint for way in chains for joint in way}.values())
    links = [section.base_link, *(robot.end(joint, "child") for joint in chain)]
    for joint in chain:
        robot.kind(joint)  # a floating joint is refused by its name, before anything that follows from it
    if BASE in links[1:]:
        raise InputError(
            f"{where}.base_link: found {section.base_link!r}, with the link {BASE!r} further on, expected "
            f"{BASE!r} itself (where it stands belongs in frames.base)"
        )
    names = _names(section, [robot.joint_name(joint) for joint in chain], where)
    called = dict(zip(map(robot.joint_name, chain), names, strict=True))
    joints = [
        {
            "name": name,
            "parent": robot.end(joint, "parent"),
            "child": robot.end(joint, "child"),
            **robot.joint(joint, units),
            **_followed(robot, joint, called, units),
        }
        for joint, name in zip(chain, names, strict=True)
    ]
    if not any(joint.get("actuated") for joint in joints):
        ends = f"{cut(section.base_link)!r} and {cut(', '.join(tips))!r}"
        raise InputError(
            f"{where}: found no joint that moves between {ends}, expected links with one between them"
        )
    return {"type": "graph", "bodies": links, "flange": tips[0], "joints": joints}


def _followed(robot: Robot, joint: Element, called: Mapping[str, str], units: UnitSystem) -> dict[str, Any]:
    """``mimic`` and ``offset`` of a joint that follows another, in the file's units; nothing for others."""
    found = robot.mimic(joint)
    if found is None:
        return {}
    other, ratio, offset = found
    if other not in called:
        raise robot.wrong(
            joint,
            "mimic",
            f"found {cut(other)!r}, which lies on no way to a tip",
            "a joint of the machine: name a link beyond it in tip_link, too",
        )
    own, theirs = ("mm" if j.get("type") == "prismatic" else "rad" for j in (joint, robot.joints[other]))
    inside = ratio_unit(own, theirs)
    written = units.written(inside)
    moved = float(units.from_internal(offset, "length" if own == "mm" else "angle"))
    return {"mimic": {"joint": called[other], "ratio": convert(ratio, inside, written)}, "offset": moved}


def _names(section: Urdf, chain: list[str], where: str) -> list[str]:
    """Names of the chain's joints, as the machine file wants them."""
    for name, new in section.joints.items():
        if name not in chain:
            raise InputError(
                f"{where}.joints: found {cut(name)!r}, no joint of the chain; {close_matches(name, chain)}"
            )
        if not new:
            raise InputError(f"{where}.joints.{name}: found an empty name, expected one")
    names = [section.joints.get(name, name) for name in chain]
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise InputError(
            f"{where}.joints: found {cut(twice[0])!r} twice, expected every joint to have its own name"
        )
    return names
