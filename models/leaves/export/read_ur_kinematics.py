"""Read an exported kinematics file of a UR arm: six frames and turns about z, and the frames in its comments."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
import yaml

from truepose.arrays import Array
from truepose.models.leaves.export.numbers import MM_PER_M
from truepose.models.leaves.export.ur_kinematics import FIELDS, LINKS
from truepose.models.lie import pose_of, rpy_matrix

_NUMBERS = ", ".join(rf"{field} (\S+)" for field in FIELDS)
_NOT_HELD = re.compile(rf"^# Not held: (.+?) to (.+?): {_NUMBERS}$", re.MULTILINE)


def read_ur_kinematics(text: str, angles: Sequence[float]) -> dict[str, Array]:
    """Return the frames (4, 4) mm ``flange`` and ``tool`` in the base, and ``base`` in the world, at six angles (rad)."""
    section = yaml.safe_load(text)["kinematics"]
    noted = {found[2]: _frame(map(float, found.groups()[2:])) for found in _NOT_HELD.finditer(text)}
    at = np.eye(4)
    for link, angle in zip(LINKS, angles, strict=True):
        fixed = _frame(section[link][field] for field in FIELDS)
        at = at @ fixed @ pose_of(rpy_matrix([0.0, 0.0, angle]), np.zeros(3))
    return {
        "base": noted.get("base", np.eye(4)),
        "flange": at @ noted.get("flange", np.eye(4)),
        "tool": at @ noted["tool"],
    }


def _frame(numbers: Iterable[float]) -> Array:
    """Return a pose (4, 4) mm of x, y, z (m) and roll, pitch, yaw (rad)."""
    values = np.array(list(numbers))
    return pose_of(rpy_matrix(values[3:]), MM_PER_M * values[:3])
