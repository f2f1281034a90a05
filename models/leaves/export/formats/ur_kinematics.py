"""An arm of six revolute joints as the kinematics file that Universal Robots' ROS description reads.

Each entry is the pose of a joint's frame, whose z axis is the joint's, in the frame of the link before it: x, y, z in m
and the roll, pitch, yaw in rad of Rz(yaw) Ry(pitch) Rx(roll). ``shoulder`` stands in the controller's base frame (the
link ``base_link_inertia``), ``wrist_3`` is the flange (``tool0``). Sources: ``ur_description`` (``config/*/
default_kinematics.yaml``, ``urdf/ur_macro.xacro``) and ``ur_calibration``, which writes such a file for a robot.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import yaml

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.export.links import MM_PER_M, Tree, turn, xyz_rpy
from truepose.models.leaves.export.write import LinkFormat, compare_frames, formats, sample_rows
from truepose.models.lie import inverse_pose, pose_of, rpy_matrix
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
FIELDS = ("x", "y", "z", "roll", "pitch", "yaw")


@formats.add("ur-kinematics")
class UrKinematics(LinkFormat):
    """The kinematics file of a UR arm; flange and tool, which it does not hold, stand in comments at its head."""

    name, title, suffixes = "ur-kinematics", "ur-kinematics", (".yaml", ".yml")

    def text(self, machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
        """Return the file. Raises InputError where the machine is no chain of six revolute joints."""
        poses, flange, tool = _chain(tree)
        section: dict[str, object] = {name: _entry(pose) for name, pose in zip(LINKS, poses, strict=True)}
        digest = hashlib.sha256(repr(section).encode()).digest()  # the files of others have 64 bits of one
        section["hash"] = f"calib_{int.from_bytes(digest[:8], 'big')}"
        head = [
            f"{tree.name}: kinematics for ur_description; m and rad, axis of each joint z.",
            "The hash tells files apart; it is not the robot's own, and the driver says so when it starts.",
            f"Not held: wrist_3 to tool: {_inline(tool)}",
        ]
        if not np.array_equal(flange, np.eye(4)):
            head.append(f"Not held: wrist_3 to flange: {_inline(flange)}")
        if not np.array_equal(tree.world, np.eye(4)):
            head.append(f"Not held: world to base: {_inline(tree.world)}")
        comments = "".join(f"# {' '.join(line.split())}\n" for line in (*head, *notes))
        return comments + yaml.safe_dump({"kinematics": section}, sort_keys=False, allow_unicode=True)

    def compare(self, text: str, machine: Machine, meant: Tree) -> Iterator[str]:
        """Yield how the flange of a kinematics file differs from an arm's, and what its comments say of base and tool."""
        turning = [joint.name for joint in meant.path() if joint.kind != "fixed"]
        for readings in sample_rows(machine):
            flange = meant.links(readings)[meant.flange] @ meant.offsets[meant.flange]
            expected = {BASE: meant.world, "flange": flange, "tool": meant.pose(readings)}
            found = read_ur_kinematics(text, [readings[name] for name in turning])
            yield from compare_frames(found, expected)


def _chain(tree: Tree) -> tuple[list[Array], Array, Array]:
    """Return six poses (4, 4) from joint frame to joint frame, and those of flange and tool in the last frame."""
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
    if (
        flange[2, 2] == 1.0 and not flange[:2, 3].any()
    ):  # exactly about and along z: the last joint's frame takes it in
        poses[-1] = poses[-1] @ flange
        flange, tool = np.eye(4), inverse_pose(flange) @ tool
    return poses, flange, tool


def _onto(axis: Array) -> Array:
    """(4, 4) rotation of least angle that takes z onto a unit vector (3,)."""
    across = np.array([-axis[1], axis[0], 0.0])
    sine = float(np.linalg.norm(across))
    direction = across / sine if sine > 0.0 else np.array([1.0, 0.0, 0.0])
    return pose_of(turn(direction, float(np.arctan2(sine, axis[2]))), np.zeros(3))


def _entry(pose: Array) -> dict[str, float]:
    xyz, rpy = xyz_rpy(pose)
    return dict(zip(FIELDS, (*xyz, *rpy), strict=True))


def _inline(pose: Array) -> str:
    return ", ".join(f"{name} {value!r}" for name, value in _entry(pose).items())


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
