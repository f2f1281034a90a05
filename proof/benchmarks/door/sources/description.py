"""An arm of a data sheet as a graph of bodies and joints, and as a URDF: axes point along x, y or z, either way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..pairs import Array
from ..rotations import shift, turn
from .tables import Sheet

AXES = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), (0, -1, 0), (-1, 0, 0)], dtype=float)
STEEP = 1.0
"""rad: pitch beyond which a frame is drawn otherwise."""


def graph_section(sheet: Sheet, names: Sequence[str], rng: np.random.Generator) -> dict[str, Any]:
    """The section ``mechanism`` of a machine file."""
    bodies = ["base", *(f"link{k + 1}" for k in range(len(names)))]
    joints = []
    for k, (origin, axis) in enumerate(_placed(sheet, rng)):
        joint: dict[str, Any] = {"name": names[k], "kind": "prismatic" if sheet.slides[k] else "revolute"}
        joint |= {"parent": bodies[k], "child": bodies[k + 1], "xyz": _rounded(origin[:3, 3])}
        joint |= {"rpy": _rounded(np.degrees(_rpy(origin))), "axis": axis.tolist(), "actuated": True}
        joint["range"] = [float(v) for v in sheet.ranges[k]]
        joints.append(joint)
    return {"type": "graph", "bodies": bodies, "joints": joints}


def urdf_text(sheet: Sheet, names: Sequence[str], rng: np.random.Generator) -> str:
    """m and rad."""
    lines = ["<robot name='arm'>", "  <link name='base'/>"]
    for k, (origin, axis) in enumerate(_placed(sheet, rng)):
        kind = "prismatic" if sheet.slides[k] else "revolute"
        scale = 1e-3 if sheet.slides[k] else np.pi / 180
        low, high = (f"{scale * v:.9g}" for v in sheet.ranges[k])
        xyz, rpy = (" ".join(f"{v:.15g}" for v in values) for values in (origin[:3, 3] / 1e3, _rpy(origin)))
        parent = f"link{k}" if k else "base"
        lines += [
            f"  <link name='link{k + 1}'/>",
            f"  <joint name='{names[k]}' type='{kind}'>",
            f"    <parent link='{parent}'/><child link='link{k + 1}'/>",
            f"    <origin xyz='{xyz}' rpy='{rpy}'/>",
            f"    <axis xyz='{' '.join(f'{v:g}' for v in axis)}'/>",
            f"    <limit lower='{low}' upper='{high}' effort='1' velocity='1'/>",
            "  </joint>",
        ]
    return "\n".join([*lines, "</robot>", ""])


def _placed(sheet: Sheet, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Frame (4, 4) of each joint in the one before, mm, and its axis; the last frame is the sheet's own."""
    out, before = [], np.eye(4)
    for k, (_, alpha, d, theta, r) in enumerate(sheet.modified):
        last = k == len(sheet.rows) - 1
        step = turn("x", np.radians(alpha)) @ shift(x=d) @ turn("z", np.radians(theta)) @ shift(z=r)
        for choice in AXES[[2]] if last else rng.permutation(AXES):
            own = np.eye(4)
            own[:3, :3] = _turning(choice)
            origin = np.linalg.inv(before) @ step @ own
            # a pitch of 90 deg would leave a direction without a parameter
            if abs(_rpy(origin)[1]) < STEEP:
                break
        out.append((origin, choice))
        before = own
    return out


def _turning(axis: Array) -> Array:
    """(3, 3) that brings ``axis`` to z."""
    out = np.eye(3)
    if axis[2] < 0:
        out = np.diag([1.0, -1.0, -1.0])
    elif not axis[2]:
        out[2], out[1] = axis, [0.0, 0.0, 1.0]
        out[0] = np.cross(out[1], out[2])
    return out


def _rpy(pose: Array) -> Array:
    """(3,) rad."""
    with np.errstate(all="ignore"):
        pitch = np.arctan2(-pose[2, 0], np.hypot(pose[0, 0], pose[1, 0]))
        if np.hypot(pose[0, 0], pose[1, 0]) < 1e-9:
            return np.array([np.arctan2(-pose[1, 2], pose[1, 1]), pitch, 0.0])
        return np.array([np.arctan2(pose[2, 1], pose[2, 2]), pitch, np.arctan2(pose[1, 0], pose[0, 0])])


def _rounded(values: Array) -> list[float]:
    return [float(v) for v in np.round(values, 12) + 0.0]
