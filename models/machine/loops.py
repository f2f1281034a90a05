"""Which joints of a mechanism stand in closed loops, and the serial part around each of them."""

from __future__ import annotations

from dataclasses import dataclass

from truepose.models.machine.mechanism import BASE, Joint, Mechanism


@dataclass(frozen=True)
class Part:
    """Joints in a row, from one outwards, and the body at which the row ends."""

    joints: tuple[Joint, ...]
    end: str


def looped(mechanism: Mechanism) -> frozenset[str]:
    """Names of the joints that are part of a loop.

    They lie on the ways from both ends of a closing joint, or of a rod, to the body where the ways meet.
    """
    above = {joint.child: joint for joint in mechanism.tree}

    def way(body: str) -> set[str]:
        out = set()
        while body in above:
            out.add(above[body].name)
            body = above[body].parent
        return out

    ends = [(joint.parent, joint.child) for joint in mechanism.closing]
    ends += [(rod.body_a, rod.body_b) for rod in mechanism.rods]
    inside = {name for one, two in ends for name in way(one) ^ way(two)}
    return frozenset(inside | {joint.name for joint in mechanism.closing})


def serial_part(mechanism: Mechanism, joint: Joint) -> tuple[Part, Part]:
    """From a joint to where the mechanism branches or ends: one part through its parent, one through its child.

    Both parts open with the joint itself.
    """
    return _outwards(mechanism, joint, joint.parent), _outwards(mechanism, joint, joint.child)


def around(mechanism: Mechanism, body: str) -> list[Joint]:
    """Joints that join a body to others."""
    return [joint for joint in mechanism.joints if body in {joint.parent, joint.child}]


def _outwards(mechanism: Mechanism, start: Joint, body: str) -> Part:
    row = [start]
    while body not in {BASE, mechanism.flange}:
        here = around(mechanism, body)
        if len(here) != 2:
            break
        row.append(next(joint for joint in here if joint.name != row[-1].name))
        body = row[-1].child if row[-1].parent == body else row[-1].parent
    return Part(tuple(row), body)
