"""Tell how an arm of six joints stands: wrist behind axis 1, wrist behind the lower arm, axis 5 below zero.

Controllers of KUKA and ABB tell configurations by these. Forward is the x axis of the robot's base, turned with axis 1;
up is its z axis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truepose.arrays import Array, Mask
from truepose.models.leaves.export.links import Tree, TreeJoint, tree_of, turn
from truepose.models.machine.machine import Machine


class ArmShape:
    """The shape of one arm with these ``values`` of parameters (mm, rad). Raises InputError for what is no chain of joints."""

    def __init__(self, machine: Machine, values: Mapping[str, float]) -> None:
        known = {p.name: p.nominal for p in machine.parameters} | dict.fromkeys(machine.ports, 0.0)
        told = {name: value for name, value in values.items() if name in known}
        self._tree: Tree = tree_of(machine, known | told, "a robot program")
        self._driven = [joint for joint in self._tree.path() if joint.kind != "fixed"]

    def of(self, q: Array) -> Mask:
        """(m, 3) of joints (m, 6): wrist behind axis 1, wrist behind the lower arm, axis 5 below zero."""
        return np.array([self._at(row) for row in q]).reshape(-1, 3)

    def reach(self) -> tuple[Array, float]:
        """A point (3,) of the first axis in the sensor's frame, and how far (mm) from there the tool can be at most.

        No straight line between the ends of links is longer than all links in a row.
        """
        path = self._tree.path()
        first = path.index(self._driven[0])
        links = self._tree.links({})
        length = float(np.linalg.norm(self._tree.tool[:3, 3]))
        for joint in path[first + 1 :]:
            length += float(np.linalg.norm(joint.origin[:3, 3]))
        for joint in path[first:]:
            if joint.kind == "prismatic":
                length += max(map(abs, joint.range)) if joint.range else np.inf
        root = self._tree.world @ links[path[first].child]
        return root[:3, 3], length

    def _at(self, q: Array) -> tuple[bool, bool, bool]:
        links = self._tree.links({joint.name: float(v) for joint, v in zip(self._driven, q, strict=True)})
        lines = [_line(joint, links) for joint in self._driven[:5]]
        (root, first), (shoulder, _), (elbow, _) = lines[:3]
        wrist = _nearest(lines[4], lines[3])
        forward, up = turn(first, float(q[0]))[:, 0], np.array([0.0, 0.0, 1.0])
        along, to_wrist = elbow - shoulder, wrist - elbow
        across = float(along @ up) * float(to_wrist @ forward) - float(along @ forward) * float(to_wrist @ up)
        return bool((wrist - root) @ forward < 0), across < 0, bool(q[4] < 0)


def _line(joint: TreeJoint, links: Mapping[str, Array]) -> tuple[Array, Array]:
    """A point (3,) and the direction (3,) of a joint's axis in the base."""
    frame = links[joint.child]
    return frame[:3, 3], frame[:3, :3] @ joint.axis


def _nearest(line: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """The point (3,) of a line that is next to another."""
    (a, u), (b, v) = line, other
    across = np.cross(u, v)
    square = float(across @ across)
    if square < 1e-12:
        return a
    out: Array = a + u * float(np.linalg.det(np.array([b - a, v, across]))) / square
    return out
