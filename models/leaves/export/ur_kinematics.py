"""An arm of six revolute joints as the kinematics file that Universal Robots' ROS description reads.

Each entry is the pose of a joint's frame, whose z axis is the joint's, in the frame of the link before it: x, y, z in m
and the roll, pitch, yaw in rad of Rz(yaw) Ry(pitch) Rx(roll). ``shoulder`` stands in the controller's base frame (the
link ``base_link_inertia``), ``wrist_3`` is the flange (``tool0``). Sources: ``ur_description`` (``config/*/
default_kinematics.yaml``, ``urdf/ur_macro.xacro``) and ``ur_calibration``, which writes such a file for a robot.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import yaml

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.export.numbers import xyz_rpy
from truepose.models.leaves.export.tree import Tree, turn
from truepose.models.lie import inverse_pose, pose_of

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
FIELDS = ("x", "y", "z", "roll", "pitch", "yaw")


def ur_kinematics_text(tree: Tree, notes: Sequence[str]) -> str:
    """The file; ``notes``, the flange and the tool stand in comments at its head.

    Raises InputError where the machine is no chain of six revolute joints.
    """
    chain = _chain(tree)
    section: dict[str, object] = {name: _entry(pose) for name, pose in zip(LINKS, chain.poses, strict=True)}
    section["hash"] = _hash(section)
    head = [
        f"{tree.name}: kinematics for ur_description; m and rad, axis of each joint z.",
        "The hash tells files apart; it is not the robot's own, and the driver says so when it starts.",
        f"Not held: wrist_3 to tool: {_inline(chain.tool)}",
    ]
    if not np.array_equal(chain.flange, np.eye(4)):
        head.append(f"Not held: wrist_3 to flange: {_inline(chain.flange)}")
    if not np.array_equal(tree.world, np.eye(4)):
        head.append(f"Not held: world to base: {_inline(tree.world)}")
    comments = "".join(f"# {' '.join(line.split())}\n" for line in (*head, *notes))
    return comments + yaml.safe_dump({"kinematics": section}, sort_keys=False, allow_unicode=True)


@dataclass(frozen=True)
class _Chain:
    """Six poses (4, 4) from joint frame to joint frame, and those of flange and tool in the last frame."""

    poses: tuple[Array, ...]
    flange: Array
    tool: Array


def _chain(tree: Tree) -> _Chain:
    path = tree.path()
    driven = [joint for joint in tree.joints if joint.kind != "fixed"]
    if [joint.kind for joint in path if joint.kind != "fixed"] != ["revolute"] * 6 or len(driven) != 6:
        found = ", ".join(f"{joint.name} ({joint.kind})" for joint in driven)
        raise InputError(
            f"{tree.name}: found joints {found}, expected one chain of six revolute joints for ur-kinematics"
        )
    poses, pending = [], np.eye(4)
    for joint in path:
        pending = pending @ joint.origin
        if joint.kind != "fixed":
            along = _onto(joint.axis)
            poses.append(pending @ along)
            pending = along.T
    flange, tool = pending @ tree.offsets[tree.flange], pending @ tree.tool
    if _about_z(flange):
        poses[-1] = poses[-1] @ flange
        flange, tool = np.eye(4), inverse_pose(flange) @ tool
    return _Chain(tuple(poses), flange, tool)


def _onto(axis: Array) -> Array:
    """(4, 4) rotation of least angle that takes z onto a unit vector (3,)."""
    across = np.array([-axis[1], axis[0], 0.0])
    sine = float(np.linalg.norm(across))
    direction = across / sine if sine > 0.0 else np.array([1.0, 0.0, 0.0])
    return pose_of(turn(direction, float(np.arctan2(sine, axis[2]))), np.zeros(3))


def _about_z(pose: Array) -> bool:
    """Whether a pose turns about and moves along z only, exactly: then the last joint's frame can take it in."""
    return bool(pose[2, 2] == 1.0 and not pose[:2, 3].any())


def _entry(pose: Array) -> dict[str, float]:
    xyz, rpy = xyz_rpy(pose)
    return dict(zip(FIELDS, (*xyz, *rpy), strict=True))


def _inline(pose: Array) -> str:
    return ", ".join(f"{name} {value!r}" for name, value in _entry(pose).items())


def _hash(section: dict[str, object]) -> str:
    """``calib_`` and 64 bits of the numbers, as the files of others have it."""
    digest = hashlib.sha256(repr(section).encode()).digest()
    return f"calib_{int.from_bytes(digest[:8], 'big')}"
