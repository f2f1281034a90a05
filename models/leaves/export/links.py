"""All links of a description file: the machine's, flange, tool and world, with free names, and the masses that they carry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.models.leaves.export.numbers import MM_PER_M
from truepose.models.leaves.export.tree import Tree, TreeJoint, frames_of
from truepose.models.machine.machine import Machine, Mass
from truepose.models.machine.mechanism import BASE


@dataclass(frozen=True)
class Lump:
    """Point masses of one link: kg, centre (3,) m, and inertia (3, 3) kg m^2 about it."""

    kg: float
    centre: Array
    inertia: Array


@dataclass(frozen=True)
class Links:
    """Joints in an order in which parents come first; the first link is ``root``, the tool's frame is ``tool``."""

    joints: tuple[TreeJoint, ...]
    root: str
    tool: str
    lumps: Mapping[str, Lump]

    @property
    def slides(self) -> dict[str, bool]:
        """Of each joint by name, whether it is prismatic."""
        return {joint.name: joint.kind == "prismatic" for joint in self.joints}

    def frames(self, readings: Mapping[str, float]) -> dict[str, Array]:
        """Return the frames (4, 4) mm of base, links, flange and tool in the base, at readings in mm and rad by joint name."""
        return frames_of([joint for joint in self.joints if joint.child != BASE], readings)


def links_of(machine: Machine, tree: Tree) -> Links:
    """The links of a machine's tree. ``world`` is there where the base does not stand in the sensor's frame itself."""
    links = Names({BASE, *(joint.child for joint in tree.joints)})
    joints = Names({joint.name for joint in tree.joints})
    flange = tree.flange if tree.flange == "flange" else links.free("flange")
    tool = links.free("tool")
    fixed = [_fixed(joints.free("tool_joint"), flange, tool, tree.tool)]
    if flange != tree.flange:
        fixed = [_fixed(joints.free("flange_joint"), tree.flange, flange, np.eye(4)), *fixed]
    standing = []
    if not np.array_equal(tree.world, np.eye(4)):
        standing = [_fixed(joints.free("base_joint"), links.free("world"), BASE, tree.world)]
    chain = (*standing, *tree.joints, *fixed)
    return Links(chain, chain[0].parent, tool, _lumps(machine, tree, tool))


class Names:
    """Names that are taken; a further one gets underscores until it is free."""

    def __init__(self, taken: set[str]) -> None:
        self._taken = taken

    def free(self, name: str) -> str:
        """The name, or one like it that is not taken; it is then."""
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name


def _fixed(name: str, parent: str, child: str, origin: Array) -> TreeJoint:
    return TreeJoint(name, "fixed", parent, child, origin, np.array([0.0, 0.0, 1.0]))


def _lumps(machine: Machine, tree: Tree, tool: str) -> dict[str, Lump]:
    points: dict[str, list[tuple[float, Array]]] = {}
    for mass in machine.masses:
        if mass.kg > 0.0:
            body = tool if mass.body == "tool" else mass.body
            points.setdefault(body, []).append((mass.kg, _centre(mass, tree)))
    return {body: lump_of(held) for body, held in points.items()}


def _centre(mass: Mass, tree: Tree) -> Array:
    """Centre of a mass (3,), mm, in the frame of its link."""
    point = np.append(mass.com, 1.0)
    out: Array = (point if mass.body == "tool" else tree.offsets[mass.body] @ point)[:3]
    return out


def lump_of(points: Sequence[tuple[float, Array]]) -> Lump:
    """Points of kg at places (3,) mm as one."""
    total = sum(kg for kg, _ in points)
    centre = np.sum([kg * at for kg, at in points], axis=0) / total
    spread = np.zeros((3, 3))
    for kg, at in points:
        arm = (at - centre) / MM_PER_M
        spread += kg * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Lump(total, centre / MM_PER_M, spread)
