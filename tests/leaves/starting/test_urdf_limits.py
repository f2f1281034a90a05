"""A URDF within limits: what unfolds, nests or goes on without end is refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.command import input_error
from truepose.models.builders.urdf_file import CHAIN_MOST, FARTHEST, Robot, inertials_of
from truepose.models.leaves.starting.urdf import urdf_start
from truepose.models.units import UnitSystem
from truepose.wording import close_matches, cut

ARM = """<robot name="arm"><link name="world"/><link name="hand"/>
<joint name="lift" type="revolute"><parent link="world"/><child link="hand"/><axis xyz="{axis}"/></joint></robot>"""


def chain(count: int) -> str:
    links = "".join(
        f'<link name="l{k}"><inertial><mass value="1"/></inertial></link>' for k in range(count + 1)
    )
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/></joint>'
        for k in range(count)
    )
    return f'<robot name="a">{links}{joints}</robot>'


def read(folder: Path, text: str) -> Robot:
    (folder / "arm.urdf").write_text(text)
    return Robot.read(folder / "arm.urdf")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="m"/></robot>', "found xacro"),
        ('<robot><link name="' + "l" * 300 + '"/></robot>', "of 300 characters"),
    ],
    ids=["xacro", "name"],
)
def test_what_goes_on_without_end_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with input_error(told) as caught:
        read(tmp_path, text)
    assert len(str(caught.value)) < 1000 + len(str(tmp_path))


def test_a_place_is_as_far_as_the_limit_and_no_farther(tmp_path: Path) -> None:
    placed = ARM.replace("<parent", '<origin xyz="0 {far} 0"/><parent').replace("{axis}", "0 0 1")
    robot = read(tmp_path, placed.format(far=-FARTHEST))
    assert robot.joint(robot.above["hand"], UnitSystem())["xyz"] == [0, -FARTHEST * 1e3, 0]
    robot = read(tmp_path, placed.format(far=FARTHEST * (1 + 1e-9)))
    with input_error("3 numbers of at most 1e\\+09"):
        robot.joint(robot.above["hand"], UnitSystem())


def test_thousands_of_links_are_read_and_a_chain_of_them_is_not_built(tmp_path: Path) -> None:
    read(tmp_path, chain(20_000))
    with input_error(f"found 20000 joints .* expected at most {CHAIN_MOST}"):
        urdf_start(tmp_path / "arm.urdf", tmp_path / "arm.yaml", "", "", written_out=False)


def test_a_long_branch_weighs_what_its_links_weigh(tmp_path: Path) -> None:
    robot = read(tmp_path, chain(3000))
    (one,), _ = inertials_of(robot, ["l0", "l1"])
    assert one.kg == 3000.0


@pytest.mark.parametrize(
    ("axis", "direction"),
    [
        ("1e-300 0 0", (1, 0, 0)),
        ("0 -1e300 0", (0, -1, 0)),
        ("5e-324 5e-324 0", (1, 1, 0)),
        ("0 0.6 -0.8", (0, 0.6, -0.8)),
    ],
)
def test_an_axis_is_a_direction_however_long_it_is(
    tmp_path: Path, axis: str, direction: tuple[float, ...]
) -> None:
    robot = read(tmp_path, ARM.format(axis=axis))
    assert robot.joint(robot.above["hand"], UnitSystem())["axis"] == list(direction)


@pytest.mark.parametrize(
    "axis", ["0 0 0", "nan 0 0", "9" * 400 + " 0 0", "1_0 0 0", "1 0", "1 " * 100_000], ids=range(6)
)
def test_an_axis_that_is_no_direction_is_refused_in_a_line(tmp_path: Path, axis: str) -> None:
    robot = read(tmp_path, ARM.format(axis=axis))
    with input_error("axis") as caught:
        robot.joint(robot.above["hand"], UnitSystem())
    assert len(str(caught.value)) < 500 + len(str(tmp_path))


def test_lists_of_names_and_texts_of_files_have_room_in_a_line() -> None:
    assert len(close_matches("zzz" * 1000, [f"name{k}" for k in range(20_000)])) < 1200
    assert close_matches("zzz", ["a", "b"]) == "known: a, b"
    assert cut("a\nb\x1b[31m c" + "d" * 10_000, 20) == "a b [31m c" + "d" * 10 + "..."
    assert cut("a b" * 5, 15) == "a b" * 5
    assert cut("a b" * 5, 14) == ("a b" * 5)[:14] + "..."
