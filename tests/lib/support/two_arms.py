"""A torso with two arms: its URDF, and its kinematics and weight written out in numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from support.plain_kinematics import frame
from truepose.arrays import Array

# name: parent, child, xyz (mm), rpy (rad), axis; every joint turns
JOINTS = {
    "waist": ("pelvis", "torso", (0, 0, 300), (0, 0.1, 0), (0, 0, 1)),
    "l1": ("torso", "l_upper", (0, 150, 200), (-1.2, 0, 0.2), (0, 0, 1)),
    "l2": ("l_upper", "l_lower", (20, 0, 250), (1.4, 0, 0), (0, 1, 0)),
    "l3": ("l_lower", "l_hand", (220, 0, 10), (0, 0.3, 0), (0.6, 0, 0.8)),
    "r1": ("torso", "r_upper", (0, -150, 200), (1.2, 0, -0.2), (0, 0, 1)),
    "r2": ("r_upper", "r_lower", (20, 0, 250), (-1.4, 0, 0), (0, 1, 0)),
    "r3": ("r_lower", "r_hand", (220, 0, -10), (0, -0.3, 0), (0, 0, 1)),
}
MASSES = {  # kg, centre in the link (mm)
    "torso": (12.0, (0, 0, 150)),
    "l_upper": (3.0, (10, 0, 120)),
    "l_lower": (2.0, (100, 5, 0)),
    "l_hand": (1.0, (40, 0, 0)),
    "r_upper": (3.0, (10, 0, 120)),
    "r_lower": (2.0, (100, -5, 0)),
    "r_hand": (1.5, (40, 0, 0)),
}
LEFT, RIGHT = ("waist", "l1", "l2", "l3"), ("waist", "r1", "r2", "r3")
GRAVITY = np.array([0.0, 0.0, -9.80665])
HEAD = "schema: truepose/machine/1\nname: pair\n"
MECHANISM = "mechanism: {type: urdf, file: pair.urdf, base_link: pelvis, tip_link: [l_hand, r_hand]}\n"
FRAMES = """frames:
  base: {in: world, xyz: [100, 50, 0], rpy: [0, 0, 20], tolerance: {xyz: .inf, rpy: .inf}}
  tool: {in: flange, xyz: [60, 0, 20], rpy: [10, 0, 30], tolerance: {xyz: 1, rpy: 0.2}}
  right: {in: r_hand, xyz: [50, 10, -20], rpy: [0, 20, 0], tolerance: {xyz: 1, rpy: 0.2}}
"""
TOOL = ((60, 0, 20), np.radians([10, 0, 30]))
RIGHT_TOOL = ((50, 10, -20), np.radians([0, 20, 0]))
BASE = ((100, 50, 0), np.radians([0, 0, 20]))
TARGETS = """sensor:
  - {type: targets, points: {L1: [40, 0, 0], L2: [0, 50, 0], L3: [0, 0, 30]}, sigma: {xyz: 0.02}}
  - {type: targets, points: {R1: [40, 0, 0], R2: [0, 50, 0], R3: [0, 0, 30]}, sigma: {xyz: 0.02}, tip: right}
tolerances: {length: 0.2, angle: 0.1}
"""


def urdf(joints: dict[str, str] | None = None) -> str:
    """The URDF; ``joints`` adds elements inside of joints, by name."""
    parts = ['<robot name="pair">', '<link name="pelvis"/>']
    for link, (kg, com) in MASSES.items():
        at = " ".join(str(v / 1000) for v in com)
        parts.append(
            f'<link name="{link}"><inertial><mass value="{kg}"/><origin xyz="{at}"/></inertial></link>'
        )
    for name, (parent, child, xyz, rpy, axis) in JOINTS.items():
        at, turn, along = (" ".join(map(repr, v)) for v in (np.array(xyz).tolist(), rpy, axis))
        at = " ".join(repr(v / 1000) for v in xyz)
        parts.append(
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{at}" rpy="{turn}"/><axis xyz="{along}"/><limit lower="-1.5" upper="1.5"/>'
            f"{(joints or {}).get(name, '')}</joint>"
        )
    return "\n".join([*parts, "</robot>"])


def write(folder: Path, text: str, joints: dict[str, str] | None = None) -> Path:
    """The machine file beside its URDF; ``text`` follows schema and name."""
    (folder / "pair.urdf").write_text(urdf(joints), encoding="utf-8")
    path = folder / "pair.yaml"
    path.write_text(HEAD + text, encoding="utf-8")
    return path


pose = frame


def chain(names: tuple[str, ...], q: dict[str, float]) -> Array:
    """(4, 4) pelvis to the last joint's child; q in rad."""
    out = np.eye(4)
    for name in names:
        _, _, xyz, rpy, axis = JOINTS[name]
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(q[name] * np.array(axis, dtype=float)).as_matrix()
        out = out @ pose(xyz, rpy) @ turn
    return out


def energy(q: dict[str, float]) -> float:
    """Potential energy of all links, N m."""
    total = 0.0
    for link, (kg, com) in MASSES.items():
        side = LEFT if link.startswith("l_") else RIGHT
        names = side[: 1 + next(k for k, name in enumerate(side) if JOINTS[name][1] == link)]
        at = chain(names, q) @ np.array([*com, 1.0])
        total -= kg * GRAVITY @ at[:3] / 1000
    return total
