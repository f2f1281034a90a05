"""What the links of a URDF weigh, as the bodies of a chain carry them, and which way is down.

A link off the chain (a gripper, a cable, a motor of its own link) counts to the body of the chain that it hangs on,
through joints that stand at zero. What hangs on the chain's base carries nothing and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from truepose.models.builders.urdf_file import FARTHEST, MM_PER_M, Robot
from truepose.models.lie import rpy_matrix
from truepose.models.mechanism import Inertial
from truepose.wording import cut, shortened

Array = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665
_NAMED = 3


class _Hung(NamedTuple):
    """The body that a link hangs on, the link's frame (4, 4) in the body's at zero, and whether a joint could move it."""

    body: str
    frame: Array
    moved: bool


def inertials_of(robot: Robot, chain: Sequence[str]) -> tuple[tuple[Inertial, ...], tuple[str, ...]]:
    """Mass and centre (mm, body's frame) of each body of ``chain`` but the first, and notes on them.

    Raises InputError for a mass or an origin that is none.
    """
    sums = {link: np.zeros(4) for link in chain[1:]}  # kg, kg x, kg y, kg z
    bent: list[str] = []
    known: dict[str, _Hung | None] = {link: _Hung(link, np.eye(4), moved=False) for link in sums}
    for element in robot.elements:
        kg, com = _weight(robot, element)
        if not kg:
            continue
        found = _carried(robot, robot.joint_name(element), known)
        if found is None:
            continue
        body, frame, moved = found
        sums[body] += kg * np.array([1.0, *(frame[:3, :3] @ com + frame[:3, 3])])
        bent += [robot.joint_name(element)] if moved else []
    out = tuple(
        Inertial(body, float(s[0]), (float(s[1] / s[0]), float(s[2] / s[0]), float(s[3] / s[0])))
        for body, s in sums.items()
        if s[0] > 0.0
    )
    told = f"{robot.path}: counted where they hang with their joints at zero: {shortened(bent, _NAMED)}"
    return out, (told,) if out and bent else ()


def gravity_in(robot: Robot, base: str) -> tuple[float, float, float]:
    """Gravity (m/s^2) in the frame of a link, where the root link's z points up and all joints stand at zero."""
    turned = np.eye(4)
    link, seen = base, set[str]()
    while link in robot.above and link not in seen:
        seen.add(link)
        turned = _origin(robot, robot.above[link]) @ turned
        link = robot.end(robot.above[link], "parent")
    x, y, z = (float(round(v, 12)) + 0.0 for v in turned[:3, :3].T @ [0.0, 0.0, -STANDARD_GRAVITY])
    return x, y, z


def _weight(robot: Robot, link: ElementTree.Element) -> tuple[float, Array]:
    """Mass of a link, kg, and its centre, mm; 0 where it states none."""
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return 0.0, np.zeros(3)
    kg = robot.number(link, "inertial.mass", mass.get("value", "0"))
    if not 0.0 <= kg <= FARTHEST:
        raise robot.wrong(link, "inertial.mass", f"found {kg:g}", f"a number >= 0, at most {FARTHEST:g} (kg)")
    origin = inertial.find("origin")
    text = None if origin is None else origin.get("xyz")
    if text is None:
        return kg, np.zeros(3)
    values = [robot.number(link, "inertial.origin", word) for word in text.split(maxsplit=3)]
    if len(values) != 3 or max(map(abs, values)) > FARTHEST:
        raise robot.wrong(
            link, "inertial.origin.xyz", f"found {cut(text)!r}", f"3 numbers of at most {FARTHEST:g}"
        )
    return kg, MM_PER_M * np.array(values)


def _carried(robot: Robot, link: str, known: dict[str, _Hung | None]) -> _Hung | None:
    """What a link hangs on; ``known`` of the links seen before, which grows, so that long branches are walked once."""
    way: list[str] = []
    while link not in known:
        known[link] = None  # a ring, or the root, unless the walk comes to a body
        way.append(link)
        if link in robot.above:
            link = robot.end(robot.above[link], "parent")
    found = known[link]
    for one in reversed(way):
        if found is not None:
            joint = robot.above[one]
            found = _Hung(
                found.body, found.frame @ _origin(robot, joint), found.moved or joint.get("type") != "fixed"
            )
        known[one] = found
    return found


def _origin(robot: Robot, joint: ElementTree.Element) -> Array:
    """(4, 4) child frame in the parent's at zero, mm."""
    out = np.eye(4)
    out[:3, :3] = rpy_matrix(np.array(robot.numbers(joint, "origin", "rpy")))
    out[:3, 3] = MM_PER_M * np.array(robot.numbers(joint, "origin", "xyz"))
    return out


__all__ = ["gravity_in", "inertials_of"]
