"""What the links of a URDF weigh, as the bodies of a chain carry them, and which way is down.

A link off the chain (a gripper, a cable, a motor of its own link) counts to the body of the chain that it hangs on,
through joints that stand at zero. What hangs on the chain's base carries nothing and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from truepose.arrays import Array
from truepose.models.builders.urdf_file import FARTHEST, MM_PER_M, Robot
from truepose.models.lie import pose_of, rpy_matrix
from truepose.models.machine.mechanism import Inertial
from truepose.wording import shortened

STANDARD_GRAVITY = 9.80665
_NAMED = 3


class _Hung(NamedTuple):
    """The body that a link hangs on, the link's frame (4, 4) in the body's at zero, and whether a joint could move it."""

    body: str
    frame: Array
    moved: bool

    def beyond(self, robot: Robot, joint: ElementTree.Element) -> _Hung:
        """Return the same of the link that a joint carries."""
        moved = self.moved or joint.get("type") != "fixed"
        return _Hung(self.body, self.frame @ _origin(robot, joint), moved)


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
        found = robot.carried(
            robot.joint_name(element), known, lambda above, joint: above.beyond(robot, joint)
        )
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
    mass = link.find("inertial/mass")
    if mass is None:
        return 0.0, np.zeros(3)
    kg = robot.number(link, "inertial/mass", mass.get("value", "0"))
    if not 0.0 <= kg <= FARTHEST:
        raise robot.wrong(link, "inertial/mass", f"found {kg:g}", f"a number >= 0, at most {FARTHEST:g} (kg)")
    return kg, MM_PER_M * np.array(robot.numbers(link, "inertial/origin", "xyz"))


def _origin(robot: Robot, joint: ElementTree.Element) -> Array:
    """(4, 4) child frame in the parent's at zero, mm."""
    xyz, rpy = (np.array(robot.numbers(joint, "origin", part)) for part in ("xyz", "rpy"))
    return pose_of(rpy_matrix(rpy), MM_PER_M * xyz)


__all__ = ["gravity_in", "inertials_of"]
