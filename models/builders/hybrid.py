"""The hybrid 3UPS-UP + 3R (polishing robot of Huang et al. 2019): shorthand for its graph.

Base frame at A0, z from base to platform. Limb i starts on the base circle at azimuth 0, 120, 240 deg and ends
on the platform circle; its universal joint turns about x, then y, of a frame turned to that azimuth. The
passive UP limb turns about x, then y, then slides along z to the platform; the wrist centre stands
``platform_offset`` further; q4 turns about z, q5 about y, q6 about x.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from truepose.models.builders.driven import Encoder, with_encoders
from truepose.models.builders.graph import Graph, mechanism_of
from truepose.models.file.fields import Ascending, In, Length, Pitch, Section, bad_value
from truepose.models.machine.builder import BuildContext, builders
from truepose.models.machine.mechanism import Mechanism
from truepose.models.units import UnitSystem

LIMBS = (1, 2, 3)
Joint = dict[str, Any]


class Hybrid(Section):
    """The section ``mechanism`` of a 3UPS-UP + 3R; ``tool`` (P0 to P) only says where P is."""

    type: Literal["3ups-up-3r"]
    """Three driven limbs and a passive one carry a platform, which carries a wrist of three axes."""
    base_radius: Length
    """Radius of the circle on the base on which the limbs start."""
    platform_radius: Length
    """Radius of the circle on the platform on which they end."""
    platform_offset: Length
    """From the platform to the centre of the wrist, along z."""
    wrist_offset: Length = 0.0
    """From the centre of the wrist to the head."""
    head: Length = 0.0
    """Length of the head. Without `frames.tool` the tool frame stands wrist_offset + head along z of the flange."""
    tool: Length = 0.0
    """From the tool frame to the tool's point; only a note."""
    limb_range: Annotated[Ascending, In("length")]
    """Shortest and longest limb: the range of q1, q2 and q3."""
    wrist_range: Annotated[Ascending, In("angle")]
    """Range of the wrist's angles q4, q5 and q6."""
    screw_pitch: Pitch | None = None
    """Travel of a limb for one turn of its screw: errors that repeat with it are looked for."""
    encoders: dict[str, Encoder] = Field(default_factory=dict)
    """What columns of joints hold, by the joint's name: `q5: {coupled: {q4: 1}}`."""

    @field_validator("limb_range")
    @classmethod
    def _positive(cls, limbs: tuple[float, float]) -> tuple[float, float]:
        if limbs[0] <= 0:
            raise bad_value("lengths > 0", list(limbs))
        return limbs


@builders.add("3ups-up-3r")
def hybrid(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
    """The mechanism of its graph, with limbs ``leg1 leg2 leg3``; parameters are those of the graph."""
    parsed = context.parse(Hybrid, section)
    graph = expanded(parsed, context.file.units)
    graph["joints"] = with_encoders(graph["joints"], section.get("encoders", {}), context.where)
    mechanism = mechanism_of(context.parse(Graph, graph), context)
    return replace(mechanism, expanded=graph, tool_length=parsed.wrist_offset + parsed.head)


def expanded(machine: Hybrid, units: UnitSystem) -> dict[str, Any]:
    """The section of the same machine as a graph, in the file's units."""

    def length(value: float) -> float:
        return float(units.from_internal(value, "length"))

    joints: list[Joint] = [
        _passive("up1", "revolute", "base", "up_cross", [1, 0, 0]),
        _passive("up2", "revolute", "up_cross", "up_tube", [0, 1, 0]),
        _passive("up3", "prismatic", "up_tube", "platform", [0, 0, 1]),
    ]
    for k in LIMBS:
        joints += _limb(k, machine, units)
    bodies = ("platform", "wrist4", "wrist5", "flange")
    for k, axis in enumerate(([0, 0, 1], [0, 1, 0], [1, 0, 0])):
        joint = _passive(f"q{4 + k}", "revolute", bodies[k], bodies[k + 1], axis)
        if k == 0:
            joint["xyz"] = [0.0, 0.0, length(machine.platform_offset)]
        joints.append({**joint, "actuated": True, "range": list(machine.wrist_range)})
    middle = units.to_internal(sum(machine.limb_range) / 2, "length")
    reach = machine.base_radius - machine.platform_radius
    height = math.sqrt(max(middle**2 - reach**2, (0.1 * middle) ** 2))
    names = dict.fromkeys(end for joint in joints for end in (joint["parent"], joint["child"]))
    return {
        "type": "graph",
        "bodies": list(names),
        "joints": joints,
        "home": {"up1": 0.0, "up2": 0.0, "up3": length(height)},
        "limbs": {f"leg{k}": f"q{k}" for k in LIMBS},
    }


def _limb(k: int, machine: Hybrid, units: UnitSystem) -> list[Joint]:
    azimuth = (k - 1) * 2 * math.pi / 3
    lower, upper = (
        [
            float(units.from_internal(radius * c, "length"))
            for c in (math.cos(azimuth), math.sin(azimuth), 0.0)
        ]
        for radius in (machine.base_radius, machine.platform_radius)
    )
    first = _passive(f"u{k}a", "revolute", "base", f"cross{k}", [1, 0, 0])
    slide = _passive(f"q{k}", "prismatic", f"tube{k}", f"rod{k}", [0, 0, 1])
    slide |= {"actuated": True, "range": list(machine.limb_range)}
    if machine.screw_pitch is not None:
        slide["screw_pitch"] = float(units.from_internal(machine.screw_pitch, "length"))
    mount = {"name": f"mount{k}", "kind": "fixed", "parent": "platform", "child": f"ball{k}", "xyz": upper}
    return [
        {**first, "xyz": lower, "rpy": [0.0, 0.0, float(units.from_internal(azimuth, "angle"))]},
        _passive(f"u{k}b", "revolute", f"cross{k}", f"tube{k}", [0, 1, 0]),
        slide,
        mount,
        {"name": f"s{k}", "kind": "spherical", "parent": f"rod{k}", "child": f"ball{k}"},
    ]


def _passive(name: str, kind: str, parent: str, child: str, axis: list[int]) -> Joint:
    return {"name": name, "kind": kind, "parent": parent, "child": child, "axis": axis}
