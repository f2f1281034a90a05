"""What effects know of a graph beside its joints: the limb of each actuated joint, and what heats up together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from truepose.models.mechanism import BASE, Joint, Limb, Mechanism

_XYZ = ("x", "y", "z")


def limbs_of(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """The mechanism with a limb for every actuated sliding joint inside a loop.

    A limb is the serial part around the joint, up to bodies where the graph branches. ``names`` gives limbs
    other names than their joint's.
    """
    joints = {joint.name: joint for joint in mechanism.joints}
    looped = _looped(mechanism)
    limbs = []
    for actuator in mechanism.actuators:
        joint = joints[actuator.drives]
        if joint.kind != "prismatic" or joint.name not in looped:
            continue
        lower, upper = (_chain(mechanism, joint, body)[-1] for body in (joint.parent, joint.child))
        name = names.get(joint.name, joint.name)
        limbs.append(Limb(name, actuator.reading, _point(lower), _point(upper), actuator.displacement))
    return replace(mechanism, limbs=tuple(limbs))


def thermal_lengths(mechanism: Mechanism) -> Mechanism:
    """The mechanism with the ports that heat up together: those of a body's joints; a limb's own length.

    A body heats up what lies between the joints that stand in it; a limb, under its name, what lies inside it.
    """
    inside = {limb.name: _inside(mechanism, limb) for limb in mechanism.limbs}
    taken = {name for names in inside.values() for name in names}
    out: dict[str, tuple[str, ...]] = {}
    for body in mechanism.bodies:
        own = [j for j in mechanism.joints if j.parent == body and j.name not in taken]
        ports = tuple(f"{joint.name}.{axis}" for joint in own for axis in _XYZ)
        if ports:
            out[body] = ports
    for limb in mechanism.limbs:
        within = tuple(f"{name}.{axis}" for name in inside[limb.name] for axis in _XYZ)
        out[limb.name] = (limb.length, *within)
    return replace(mechanism, lengths=out)


def _chain(mechanism: Mechanism, start: Joint, body: str) -> list[Joint]:
    """Joints of the serial part that leaves ``start`` through ``body``, ``start`` first."""
    chain = [start]
    while body not in {BASE, mechanism.flange}:
        around = [j for j in mechanism.joints if body in {j.parent, j.child}]
        if len(around) != 2:
            break
        chain.append(next(j for j in around if j.name != chain[-1].name))
        body = chain[-1].child if chain[-1].parent == body else chain[-1].parent
    return chain


def _point(joint: Joint) -> tuple[str, ...]:
    return tuple(f"{joint.name}.{axis}" for axis in _XYZ)


def _inside(mechanism: Mechanism, limb: Limb) -> list[str]:
    """Joints of a limb whose frames stand in its own bodies: all but those that fix its two ends."""
    joint = {j.name: j for j in mechanism.joints}[mechanism.actuator(limb.reading).drives]
    chain = [j for body in (joint.parent, joint.child) for j in _chain(mechanism, joint, body)]
    ends = {limb.base_point[0].rsplit(".", 1)[0], limb.platform_point[0].rsplit(".", 1)[0]}
    return list(dict.fromkeys(j.name for j in chain if j.name not in ends))


def _looped(mechanism: Mechanism) -> set[str]:
    """Joints that are part of a loop: those on the paths from both ends of a closing joint to their common body."""
    above = {joint.child: joint for joint in mechanism.tree}

    def path(body: str) -> list[Joint]:
        out = []
        while body in above:
            out.append(above[body])
            body = above[body].parent
        return out

    looped: set[str] = set()
    for closing in mechanism.closing:
        one, two = path(closing.parent), path(closing.child)
        shared = {j.name for j in one} & {j.name for j in two}
        looped |= {j.name for j in (*one, *two) if j.name not in shared} | {closing.name}
    return looped


__all__ = ["limbs_of", "thermal_lengths"]
