"""Bundled nominal machines: each is built, and stands where its maker (or a description by others) says that it stands."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from support.command import input_error
from truepose.arrays import Array
from truepose.models.file.machine_file import checked_machine
from truepose.models.file.yaml_document import parse_document
from truepose.models.leaves.starting.start import bundled_names, bundled_start
from truepose.models.leaves.starting.written import files_of
from truepose.models.load import build_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Link = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
"""xyz (mm) and rpy (deg) of a joint's frame, and its axis; no axis (0, 0, 0) for a fixed one."""
X, Y, Z, FIXED, NO = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
DOWN, BACK = (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)
DESCRIBED: dict[str, list[Link]] = {
    # ROS-Industrial, kuka_experimental, kr6r900sixx_macro.xacro
    "kr6": [
        ((0, 0, 400), NO, DOWN), ((25, 0, 0), NO, Y), ((455, 0, 0), NO, Y), ((0, 0, 35), NO, BACK), ((420, 0, 0), NO, Y),
        ((80, 0, 0), NO, BACK), (NO, (0, 90, 0), FIXED),
    ],
    # ROS-Industrial, abb, irb120_macro.xacro; tool0 of ABB looks along x of its last link
    "irb120": [
        (NO, NO, Z), ((0, 0, 290), NO, Y), ((0, 0, 270), NO, Y), ((0, 0, 70), NO, X), ((302, 0, 0), NO, Y),
        ((72, 0, 0), NO, X), (NO, (0, 90, 0), FIXED),
    ],
    # Vanderbilt, meca500_ros2, meca500.xacro, from the axis of joint 1
    "meca500": [
        ((0, 0, 91), NO, Z), ((0, 0, 44), NO, Y), ((0, 0, 135), NO, Y), ((0, 0, 38), NO, X), ((120, 0, 0), NO, Y),
        ((70, 0, 0), NO, X), (NO, (0, 90, 0), FIXED),
    ],
    # IFL-CAMP, iiwa_stack, iiwa7.xacro
    "iiwa7": [
        ((0, 0, 150), NO, Z), ((0, 0, 190), (90, 0, 180), Z), ((0, 210, 0), (90, 0, 180), Z), ((0, 0, 190), (90, 0, 0), Z),
        ((0, 210, 0), (-90, 180, 0), Z), ((0, 60.7, 190), (90, 0, 0), Z), ((0, 81, 60.7), (-90, 180, 0), Z),
        ((0, 0, 45), NO, FIXED),
    ],
    # Franka Robotics, franka_description, robots/fer/kinematics.yaml
    "panda": [
        ((0, 0, 333), NO, Z), (NO, (-90, 0, 0), Z), ((0, -316, 0), (90, 0, 0), Z), ((82.5, 0, 0), (90, 0, 0), Z),
        ((-82.5, 384, 0), (-90, 0, 0), Z), (NO, (90, 0, 0), Z), ((88, 0, 0), (90, 0, 0), Z), ((0, 0, 107), NO, FIXED),
    ],
    # Universal Robots, ROS 2 description, config/ur30/default_kinematics.yaml
    "ur30": [
        ((0, 0, 236.3), NO, Z), (NO, (90, 0, 0), Z), ((-637, 0, 0), NO, Z), ((-503.7, 0, 201), NO, Z),
        ((0, -159.3, 0), (90, 0, 0), Z), ((0, 154.3, 0), (90, 180, 180), Z),
    ],
}  # fmt: skip
DESCRIBED["fr3"] = DESCRIBED["panda"]
UR = {  # a2 + a3, d4 + d6, d1 - d5 of the maker's table, mm
    "ur3e": (-456.75, 223.15, 66.5),
    "ur5e": (-817.2, 232.9, 62.8),
    "ur10e": (-1184.25, 290.7, 60.85),
    "ur16e": (-838.4, 290.7, 60.85),
    "ur20": (-1590.7, 355.3, 77.0),
    "ur30": (-1140.7, 355.3, 77.0),
    "ur3": (-456.9, 194.25, 66.55),
    "ur5": (-817.25, 191.45, -5.491),
    "ur10": (-1184.3, 256.141, 11.6),
}


@cache
def built(name: str) -> Machine:
    """The machine that ``truepose init --arm NAME`` writes, with its tool and base at the identity."""
    path = Path(f"{name}.yaml")
    text = files_of(bundled_start(name))[0]
    return build_machine(checked_machine(path, parse_document(text, path)))


@cache
def pose_function(name: str) -> ca.Function:
    model = symbolic_model(built(name))
    return ca.Function("pose", [model.q], [ca.substitute(model.pose, model.p, ca.DM(model.p_home))])


def pose(name: str, readings: list[float]) -> Array:
    """Base to tool (4, 4), mm, at readings in deg or mm."""
    factor = [1.0 if a.unit == "mm" else np.pi / 180 for a in built(name).mechanism.actuators]
    return np.array(pose_function(name)(np.multiply(readings, factor)))


def described(links: list[Link], readings: list[float]) -> Array:
    out, values = np.eye(4), iter(readings)
    for xyz, rpy, axis in links:
        step, turn = np.eye(4), np.eye(4)
        step[:3, :3], step[:3, 3] = Rotation.from_euler("xyz", rpy, degrees=True).as_matrix(), xyz
        if any(axis):
            turn[:3, :3] = Rotation.from_rotvec(np.multiply(axis, next(values)), degrees=True).as_matrix()
        out = out @ step @ turn
    return out


@pytest.mark.parametrize("name", bundled_names())
def test_a_machine_is_built_with_gravity_where_its_base_has_it(name: str) -> None:
    machine = built(name)
    # at a latitude of 45 deg
    down = (-np.sqrt(0.5), 0.0, -np.sqrt(0.5)) if name == "equatorial" else (0.0, 0.0, -1.0)
    assert machine.gravity == pytest.approx([9.80665 * v for v in down], abs=1e-12)
    assert machine.name == name.replace("-", "_")  # as C can have it


@pytest.mark.parametrize("name", DESCRIBED)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_an_arm_is_the_one_that_others_describe(name: str, seed: int) -> None:
    """The whole pose at random readings; descriptions are written to 1e-9 rad."""
    readings = np.random.default_rng(seed).uniform(-160, 160, len(built(name).mechanism.actuators)).tolist()
    np.testing.assert_allclose(pose(name, readings), described(DESCRIBED[name], readings), atol=1e-5)


@pytest.mark.parametrize("name", UR)
def test_universal_robots_stand_stretched_at_zero(name: str) -> None:
    along, aside, up = UR[name]
    np.testing.assert_allclose(pose(name, [0] * 6)[:3, 3], [along, -aside, up], atol=1e-9)
    np.testing.assert_allclose(pose(name, [0] * 6)[:3, 2], [0, -1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "readings", "position", "z_axis"),
    [
        ("iiwa14", [0] * 7, (0, 0, 1306), (0, 0, 1)),
        ("iiwa14", [0, 90, 0, 0, 0, 0, 0], (946, 0, 360), (1, 0, 0)),  # reach 820, and 126 to the flange
        ("puma560", [0] * 6, (452.1, -150.05, 431.8), (0, 0, 1)),  # Corke's zero pose
        ("xarm6", [0] * 6, (207, 0, 112), (0, 0, -1)),  # UFACTORY's zero position
        ("gantry", [100, 200, -300], (100, 200, -300), (0, 0, 1)),
    ],
)
def test_an_arm_stands_where_its_maker_says(
    name: str, readings: list[float], position: tuple[float, ...], z_axis: tuple[float, ...]
) -> None:
    found = pose(name, readings)
    np.testing.assert_allclose(found[:3, 3], position, atol=1e-5)  # xArm's lean is written to 1e-7 deg
    np.testing.assert_allclose(found[:3, 2], z_axis, atol=1e-6)


@pytest.mark.parametrize(
    ("az", "alt", "direction"),
    [(0, 0, (1, 0, 0)), (90, 0, (0, -1, 0)), (0, 90, (0, 0, 1)), (180, 45, (-(0.5**0.5), 0, 0.5**0.5))],
)
def test_a_telescope_looks_north_over_east_and_up(
    az: float, alt: float, direction: tuple[float, ...]
) -> None:
    """x north, y west, z up."""
    np.testing.assert_allclose(
        pose("telescope-mount", [az, alt])[:3, 3], 1000.0 * np.array(direction), atol=1e-9
    )


def test_masses_of_universal_robots_stand_where_their_description_puts_them() -> None:
    """At zero the base sees the upper arm's centre at model.x - length along x, and model.z to the side."""
    (upper,) = [mass for mass in built("ur5e").masses if mass.name == "link2"]
    link2 = described([((0, 0, 162.5), NO, Z), (NO, (90, 0, 0), Z)], [0, 0])
    np.testing.assert_allclose((link2 @ [*upper.com, 1])[:3], [212.5 - 425, -113.36, 162.5], atol=1e-9)


@pytest.mark.parametrize("asked", ["UR5e", "ur 5e", "KR 6", "Meca500", "iiwa_14"])
def test_names_are_read_as_people_write_them(asked: str) -> None:
    assert bundled_start(asked).name == re.sub("[ _]", "", asked.lower())


def test_an_unknown_name_is_answered_with_the_near_ones() -> None:
    with input_error(r"--arm: found 'ur5x', expected a bundled machine; did you mean .*'ur5e'"):
        bundled_start("ur5x")
