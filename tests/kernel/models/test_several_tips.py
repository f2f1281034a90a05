"""Several tips: a tree of two arms against two chains composed in numpy, and the weight that one arm is for the other."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support import two_arms
from support.two_arms import (
    BASE,
    FRAMES,
    LEFT,
    MECHANISM,
    RIGHT,
    RIGHT_TOOL,
    TARGETS,
    TOOL,
    chain,
    pose,
)
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.load import load_machine
from truepose.models.machine.assembly import Statics
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.sensor import TOOL_IN_WORLD, View

RNG = np.random.default_rng(5)
ANGLES = [dict(zip(two_arms.JOINTS, q, strict=True)) for q in RNG.uniform(-1.4, 1.4, (5, 7)).tolist()]


def seen(path: Path, view: View, q: dict[str, float]) -> Array:
    """(4, 4) the model's pose of a view, with the file's constants."""
    model = symbolic_model(load_machine(path))
    at = ca.Function("at", [model.q, model.p], [model.worlds[view]])
    return np.array(at([q[name] for name in model.readings], model.p_home))


def test_the_tips_of_a_tree_stand_where_two_separate_chains_put_them(tmp_path: Path) -> None:
    path = two_arms.write(tmp_path, MECHANISM + FRAMES + TARGETS)
    for q in ANGLES:
        left = pose(*BASE) @ chain(LEFT, q) @ pose(*TOOL)
        right = pose(*BASE) @ chain(RIGHT, q) @ pose(*RIGHT_TOOL)
        np.testing.assert_allclose(seen(path, TOOL_IN_WORLD, q), left, atol=1e-9)
        np.testing.assert_allclose(seen(path, View("right"), q), right, atol=1e-9)


def test_a_sensor_that_rides_on_one_arm_reads_the_other_in_its_own_frame(tmp_path: Path) -> None:
    sensor = "sensor: {type: position, sigma: {xyz: 0.02}, in: right}\n"
    path = two_arms.write(tmp_path, MECHANISM + FRAMES + sensor)
    for q in ANGLES:
        right = chain(RIGHT, q) @ pose(*RIGHT_TOOL)
        expected = np.linalg.inv(right) @ chain(LEFT, q) @ pose(*TOOL)
        np.testing.assert_allclose(seen(path, View(frame="right"), q), expected, atol=1e-9)


def test_a_further_frame_of_the_world_is_a_second_instrument(tmp_path: Path) -> None:
    frames = FRAMES + "  tracker: {in: world, xyz: [1000, 0, 300], rpy: [0, 0, 90]}\n"
    sensor = "sensor:\n  - {type: position, sigma: {xyz: 0.02}}\n" + (
        "  - {type: position, name: second, sigma: {xyz: 0.02}, in: tracker, tip: right}\n"
    )
    path = two_arms.write(tmp_path, MECHANISM + frames + sensor)
    tracker = pose((1000, 0, 300), np.radians([0, 0, 90]))
    for q in ANGLES:
        right = pose(*BASE) @ chain(RIGHT, q) @ pose(*RIGHT_TOOL)
        np.testing.assert_allclose(
            seen(path, View("right", "tracker"), q), np.linalg.inv(tracker) @ right, atol=1e-9
        )
    assert load_machine(path).sensors[1].columns == {"second.x": "mm", "second.y": "mm", "second.z": "mm"}


def test_the_torque_at_the_torso_is_that_of_both_arms(tmp_path: Path) -> None:
    """Loads against differences of a potential energy in numpy; the waist leans, so that both arms turn it."""
    machine = load_machine(two_arms.write(tmp_path, MECHANISM + FRAMES + TARGETS))
    model = symbolic_model(machine)
    named = dict(zip(model.readings, ca.vertsplit(model.q), strict=True))
    values = dict(zip(model.names, ca.vertsplit(model.p), strict=True))
    values |= {name: ca.SX(0) for name in machine.ports}
    loads = Statics.of(machine, values, named, {}, model.x).loads(values)
    torque = ca.Function(
        "torque", [model.q, model.p], [loads[f"{name}.displacement"] for name in ("waist", "r2")]
    )
    step = 1e-5
    for q in ANGLES:
        found = torque([q[name] for name in model.readings], model.p_home)
        for name, value in zip(("waist", "r2"), found, strict=True):
            up, down = (two_arms.energy(q | {name: q[name] + s}) for s in (step, -step))
            assert float(value) == pytest.approx(-(up - down) / (2 * step), abs=1e-6)
    other = [torque([*q.values()], model.p_home)[0] for q in (ANGLES[0], ANGLES[0] | {"r2": 0.5})]
    assert abs(float(other[0] - other[1])) > 0.1  # N m: the right arm is no constant load


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (("in: r_hand", "in: r_hnad"), "frames.right.in: found 'r_hnad'"),
        (("tip: right", "tip: rihgt"), "sensor[1].tip: found 'rihgt'"),
        (("right: {in: r_hand,", "right: {"), "frames.right: unknown field"),
        (("right: {in", "l3: {in"), "frames.l3: found the name of a body or joint"),
        ((", tip: right", ""), "frames.right: found a frame that no sensor reads"),
        (("[l_hand, r_hand]", "[l_hand, r_hnad]"), "tip_link: found 'r_hnad'"),
        (("[l_hand, r_hand]", "[]"), "mechanism.tip_link"),
        (("tool: {in: flange", "tool: {in: r_hand"), "frames.tool.in: found 'r_hand'"),
    ],
)
def test_a_wrong_word_is_refused_where_it_stands(tmp_path: Path, change: tuple[str, str], found: str) -> None:
    text = MECHANISM + FRAMES + TARGETS
    assert change[0] in text
    tip = "l3" if change[1] == "l3: {in" else "right"
    with pytest.raises(InputError) as told:
        load_machine(two_arms.write(tmp_path, text.replace(*change).replace("tip: right", f"tip: {tip}")))
    assert found in str(told.value)


def test_two_tips_need_columns_of_their_own(tmp_path: Path) -> None:
    one = "  - {type: position, sigma: {xyz: 0.02}}\n"
    text = MECHANISM + FRAMES + "sensor:\n" + one + one.replace("}}", "}, tip: right}")
    with pytest.raises(InputError, match="two sensors of different frames that read the column 'x'"):
        load_machine(two_arms.write(tmp_path, text))


VIEWED = """schema: truepose/machine/1
name: arm
mechanism: {type: serial, joints: [{name: q1, kind: revolute, r: 300}, {name: q2, kind: revolute, alpha: 90, d: 200}]}
frames:
  base: {in: world, xyz: [10, 20, 30], rpy: [1, 2, 3]}
  tool: {in: flange, xyz: [50, 0, 10], rpy: [0, 20, 0]}
  mark: {in: world, xyz: [400, 100, 200], rpy: [10, 0, 40]}
sensor: {type: pose, tip: TIP, in: FRAME, sigma: {xyz: 0.01, rot: 0.01}}
"""


def test_a_camera_on_the_tool_sees_a_mark_where_the_mark_would_see_the_tool(tmp_path: Path) -> None:
    """The one pose is the inverse of the other."""
    poses = []
    for tip, frame in (("mark", "tool"), ("tool", "mark")):
        file = tmp_path / f"{tip}.yaml"
        file.write_text(VIEWED.replace("TIP", tip).replace("FRAME", frame), encoding="utf-8")
        poses.append(seen(file, View(tip, frame), {"q1": 0.4, "q2": -0.7}))
    np.testing.assert_allclose(poses[0] @ poses[1], np.eye(4), atol=1e-9)
    assert np.linalg.norm(poses[0][:3, 3]) > 100.0
