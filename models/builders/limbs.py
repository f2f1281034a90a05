"""What effects know of a graph beside its joints: the limb of each actuated joint, and what heats up together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from truepose.models.machine.loops import Part, around, looped, serial_part
from truepose.models.machine.mechanism import Joint, Limb, Mechanism

_XYZ = ("x", "y", "z")
_HUB = 3
"""From so many joints on a body is where limbs meet."""


def limbs_of(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """The mechanism with a limb for every actuated sliding joint inside a loop.

    A limb is the serial part around the joint, up to bodies where the graph branches. ``names`` gives limbs
    other names than their joint's.
    """
    joints = {joint.name: joint for joint in mechanism.joints}
    limbs = []
    for actuator in mechanism.actuators:
        joint = joints[actuator.drives]
        if joint.kind == "prismatic" and joint.name in looped(mechanism):
            ends = [_end(part) for part in serial_part(mechanism, joint)]
            name = names.get(joint.name, joint.name)
            limbs.append(Limb(name, actuator.reading, ends[0], ends[1], actuator.displacement))
    return replace(mechanism, limbs=tuple(limbs))


def thermal_lengths(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """The mechanism with the ports that heat up together: those of a body's joints; a limb's own length.

    A body heats up what lies between the joints that stand in it; a limb, named as in ``limbs_of``, what lies
    inside it.
    """
    inside = _inside(mechanism)
    taken = {joint for own in inside.values() for joint in own}
    lengths = {limb.reading: limb.length for limb in mechanism.limbs}
    out: dict[str, tuple[str, ...]] = {}
    for body in mechanism.bodies:
        own = [j.name for j in mechanism.joints if _stands_in(mechanism, j) == body and j.name not in taken]
        out[body] = tuple(port for joint in own for port in _point(joint))
    for reading, own in inside.items():
        length = (lengths[reading],) if reading in lengths else ()
        limb = names.get(reading, reading)
        out[limb] = (*out.get(limb, ()), *length, *(port for joint in own for port in _point(joint)))
    return replace(mechanism, lengths={place: ports for place, ports in out.items() if ports})


def _inside(mechanism: Mechanism) -> dict[str, list[str]]:
    """Joints whose frames stand in the bodies of each actuated limb, by reading; of two actuators the first's."""
    joints, out = {joint.name: joint for joint in mechanism.joints}, dict[str, list[str]]()
    closed, taken = looped(mechanism), set[str]()
    for actuator in mechanism.actuators:
        joint = joints[actuator.drives]
        if joint.name not in closed:
            continue
        parts = serial_part(mechanism, joint)
        ends = {part.end for part in parts}
        row = dict.fromkeys(j.name for part in parts for j in part.joints)
        own = [n for n in row if n not in taken and _stands_in(mechanism, joints[n]) not in ends]
        taken |= set(own)
        out[actuator.reading] = own
    return out


def _stands_in(mechanism: Mechanism, joint: Joint) -> str:
    """The body that a joint's frame is part of: its parent.

    The end piece of a limb, fixed to the body where limbs meet, is part of that body, whichever way it is told.
    """
    if joint.kind != "fixed":
        return joint.parent
    piece = len(around(mechanism, joint.parent)) == 2 and len(around(mechanism, joint.child)) >= _HUB
    return joint.child if piece else joint.parent


def _end(part: Part) -> tuple[str, ...]:
    """Coordinates of a limb's end where they are told in the frame of the body that it ends at, else none."""
    return _point(part.joints[-1].name) if part.joints[-1].parent == part.end else ()


def _point(joint: str) -> tuple[str, ...]:
    return tuple(f"{joint}.{axis}" for axis in _XYZ)
