"""Joints that follow others: poses against numpy, derivatives by ratios, loops, the fit of a ratio, C and URDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from support import two_arms
from support.command import input_error, refused, run
from support.described_machines import urdf_machine
from support.generated_c import built_of, needs_compiler
from support.machine_texts import machine_from
from support.two_arms import pose
from truepose.api import calibrate
from truepose.arrays import Array
from truepose.identification.fit.write_machine import write_calibrated
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.velocities import gap_derivative, twists

GRIP = """<robot name="grip">
  <link name="palm"/> <link name="arm"/> <link name="slide"/> <link name="finger"/>
  <joint name="a" type="revolute"> <parent link="palm"/> <child link="arm"/> <origin xyz="0 0 0.1" rpy="0.2 0 0"/>
    <axis xyz="0 1 0"/> <limit lower="-1" upper="1"/> </joint>
  <joint name="s" type="prismatic"> <parent link="arm"/> <child link="slide"/> <origin xyz="0.2 0 0"/>
    <axis xyz="0 0 1"/> <mimic joint="a" multiplier="0.05" offset="0.01"/> </joint>
  <joint name="f" type="revolute"> <parent link="slide"/> <child link="finger"/> <origin xyz="0 0.05 0"/>
    <axis xyz="1 0 0"/> <mimic joint="a" multiplier="-2"/> </joint>
</robot>"""
LEADS = st.integers(2, 6).flatmap(
    lambda n: st.tuples(st.permutations(range(n)), *(st.integers(0, max(k - 1, 0)) for k in range(n)))
)
SENSOR = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.01}}\n"


def grip(folder: Path, more: str = "", head: str = "") -> Machine:
    mechanism = "mechanism: {type: urdf, file: arm.urdf, base_link: palm, tip_link: finger}"
    return urdf_machine(folder, GRIP, f"{head}{mechanism}", more, sensor=SENSOR)


def turned(axis: int, angle: float) -> Array:
    return pose((0, 0, 0), angle * np.eye(3)[axis])


def expected(a: float, ratio: float = -2.0) -> Array:
    """(4, 4) of the finger: mm; a in rad."""
    slide = pose((200, 0, 10 + 50 * a), (0, 0, 0))
    arm = pose((0, 0, 100), (0.2, 0, 0)) @ turned(1, a)
    return arm @ slide @ pose((0, 50, 0), (0, 0, 0)) @ turned(0, ratio * a)


@pytest.mark.parametrize(
    "head", ["", "units: {length: m, angle: rad}\n", "units: {length: in, angle: arcmin}\n"]
)
def test_a_urdf_s_mimic_joints_follow(tmp_path: Path, head: str) -> None:
    machine = grip(tmp_path, head=head)
    assert machine.mechanism.readings == ("a",)
    assert not machine.mechanism.passive
    model = symbolic_model(machine)
    at = ca.Function("at", [model.q, model.p], [model.pose])
    for a in (-0.9, 0.0, 0.4):
        np.testing.assert_allclose(np.array(at(a, model.p_home)), expected(a), atol=1e-9)


def chained(order: Sequence[int], leads: Sequence[int]) -> str:
    """Return the URDF of a chain whose joint 0 is driven; each other one, k, follows one before it in number, not in place."""
    text = "".join(f'<link name="l{k}"/>' for k in range(len(order) + 1))
    for at, k in enumerate(order):
        follows = f'<mimic joint="j{leads[k]}" multiplier="{0.5 + k}" offset="{0.1 * k}"/>' if k else ""
        text += f'<joint name="j{k}" type="revolute"><parent link="l{at}"/><child link="l{at + 1}"/>'
        text += f'<origin xyz="0.1 0 0.05"/><axis xyz="{k % 2} 1 0"/>{follows}</joint>'
    return f'<robot name="r">{text}</robot>'


@settings(max_examples=10)
@given(LEADS, st.floats(-1.0, 1.0))
def test_a_joint_may_follow_one_that_follows(
    tmp_path_factory: pytest.TempPathFactory, drawn: tuple[Any, ...], q: float
) -> None:
    """Whatever leads: each joint is where multiplier and offset put it, one after the other."""
    order, *leads = drawn
    folder = tmp_path_factory.mktemp("chained")
    (folder / "r.urdf").write_text(chained(order, leads), encoding="utf-8")
    run("init", "--urdf", folder / "r.urdf", "-o", folder / "r.yaml")
    machine = load_machine(folder / "r.yaml")
    assert machine.mechanism.readings == ("j0",)
    values, at = [q], np.eye(4)
    for k in range(1, len(order)):
        values.append((0.5 + k) * values[leads[k]] + 0.1 * k)
    for k in order:
        axis = np.array([k % 2, 1.0, 0.0]) / np.hypot(k % 2, 1.0)
        motion = np.eye(4)
        motion[:3, :3] = Rotation.from_rotvec(values[k] * axis).as_matrix()
        at = at @ pose((100, 0, 50), (0, 0, 0)) @ motion
    model = symbolic_model(machine)
    found = ca.Function("at", [model.q, model.p], [model.pose])(q, model.p_home)
    np.testing.assert_allclose(np.array(found), at, atol=1e-8)


@pytest.mark.parametrize(
    ("leads", "message"),
    [
        ({"j1": "j2", "j2": "j1"}, "joint 'j1': mimic: found 'j1', by way of j2, expected a joint that moves"),
        ({"j1": "j1"}, "joint 'j1': mimic: found 'j1', expected a joint that moves"),
        ({"j1": "j9", "j2": "j0"}, "joint 'j1': mimic: found 'j9', expected a joint that moves"),
    ],
)  # fmt: skip
def test_what_follows_itself_or_nothing_is_refused(
    tmp_path: Path, leads: Mapping[str, str], message: str
) -> None:
    text = chained((0, 1, 2), (0, 0, 0))
    for k, (joint, lead) in enumerate(leads.items(), start=1):
        assert joint == f"j{k}"
        text = text.replace(f'<mimic joint="j0" multiplier="{0.5 + k}"', f'<mimic joint="{lead}"')
    (tmp_path / "r.urdf").write_text(text, encoding="utf-8")
    refused("init", "--urdf", tmp_path / "r.urdf", "-o", tmp_path / "r.yaml", said=message)


def test_a_ratio_is_found_and_written_back(tmp_path: Path) -> None:
    """A finger that turns 2.02 times as far as the arm."""
    machine = grip(tmp_path, "tolerances: {f.ratio.a: 0.05, s.ratio.a: 0.01}\n")
    rows = []
    for k, a in enumerate(np.linspace(-0.9, 0.9, 15)):
        at = expected(a, -2.02)
        turn = Rotation.from_matrix(at[:3, :3]).as_rotvec(degrees=True)
        noise = 0.001 * np.sin(np.arange(6) + 7.0 * k)
        values = np.concatenate([at[:3, 3], turn]) + noise
        rows.append({"a": np.degrees(a), **dict(zip(("x", "y", "z", "rx", "ry", "rz"), values, strict=True))})
    done = calibrate(machine, pd.DataFrame(rows))
    found = dict(zip(done.fit.prior.names, done.fit.p, strict=True))
    assert found["f.ratio.a"] == pytest.approx(-2.02, abs=1e-3)
    assert found["s.ratio.a"] == pytest.approx(50.0, abs=0.05)  # mm/rad
    write_calibrated(tmp_path / "out.yaml", done.fit, done.recording)
    again = {p.name: p.nominal for p in load_machine(tmp_path / "out.yaml").parameters}
    for name in ("f.ratio.a", "s.ratio.a", "f.offset"):
        assert again[name] == pytest.approx(found[name], rel=1e-12)


LOOP = """schema: truepose/machine/1
name: loop
mechanism:
  type: graph
  bodies: [base, a, b, c, d]
  joints:
    - {name: q1, kind: revolute, parent: base, child: a, axis: [0, 0, 1], actuated: true}
    - {name: q2, kind: revolute, parent: a, child: b, xyz: [100, 0, 0], rpy: [20, 0, 0], axis: [0, 0, 1], actuated: true}
    - {name: m, kind: prismatic, parent: b, child: c, xyz: [50, 0, 10], axis: [1, 0, 0],
       mimic: [{joint: q1, ratio: 0.4}, {joint: q2, ratio: -0.2}], offset: 3}
    - {name: e, kind: revolute, parent: c, child: d, xyz: [40, 0, 0], mimic: {joint: q2, ratio: 0.5}}
    - {name: p, kind: universal, parent: base, child: w, xyz: [150, 200, 20]}
    - {name: r, kind: prismatic, parent: w, child: v, axis: [0, 0, 1]}
    - {name: close, kind: spherical, parent: d, child: v, xyz: [30, 0, 0]}
  home: {p: [90, 20], r: 210}
  flange: d
"""


def test_a_sum_of_several_joints(tmp_path: Path) -> None:
    """In the file's mm/deg; the derivative by each ratio is the other's displacement along the slide."""
    text = LOOP.replace(", c, d]", ", c]").split("    - {name: e,")[0] + "  flange: c\n"
    model = symbolic_model(machine_from(tmp_path, text, "loop"))
    at = ca.Function("at", [model.q, model.p], [model.pose])
    q1, q2 = 0.3, -0.7
    slide = 50 + 3 + 0.4 * np.degrees(q1) - 0.2 * np.degrees(q2)
    second = turned(2, q1) @ pose((100, 0, 0), np.radians([20, 0, 0])) @ turned(2, q2)
    wanted = second @ pose((slide, 0, 10), (0, 0, 0))
    np.testing.assert_allclose(np.array(at([q1, q2], model.p_home)), wanted, atol=1e-9)
    slope = ca.Function("slope", [model.q, model.p], [ca.jacobian(model.pose[:3, 3], model.p)])
    along = np.array(slope([q1, q2], model.p_home))[:, model.names.index("m.ratio.q1")]
    np.testing.assert_allclose(along, q1 * wanted[:3, 0], atol=1e-9)


def test_loops_know_that_one_reading_moves_several_joints(tmp_path: Path) -> None:
    """Derivatives by screws against those of the expressions."""
    model = symbolic_model(machine_from(tmp_path, LOOP.replace("c, d]", "c, d, w, v]"), "loop"))
    told, y = gap_derivative(model), ca.vertcat(model.q, model.x)
    assert told is not None
    plain = ca.vertcat(twists(model.pose, y), ca.jacobian(model.gap, y))
    both = ca.Function("both", [model.q, model.x, model.p], [ca.densify(told), ca.densify(plain)])
    rng = np.random.default_rng(3)
    for _ in range(3):
        x = model.home + 0.2 * rng.standard_normal(len(model.home))
        screws, slopes = (np.array(v) for v in both(rng.uniform(-1, 1, 2), x, model.p_home))
        np.testing.assert_allclose(screws, slopes, rtol=0, atol=1e-12 * np.abs(slopes).max())


@needs_compiler
@pytest.mark.parametrize("name", ["arm", "pair"])
def test_the_c_has_the_same_poses(tmp_path: Path, name: str) -> None:
    """Followers move with their readings, and the other arm's joints stay where the guess has them."""
    text = two_arms.MECHANISM + two_arms.FRAMES + two_arms.TARGETS
    machine = grip(tmp_path) if name == "arm" else load_machine(two_arms.write(tmp_path, text))
    built, model = built_of(machine, tmp_path / "c", "double"), symbolic_model(machine)
    at = ca.Function("at", [model.q, model.p], [model.pose])
    q = np.linspace(0.2, 0.7, len(model.readings))
    code, moved = built.fk(q)
    assert code == 0
    np.testing.assert_allclose(moved.reshape(3, 4), np.array(at(q, model.p_home))[:3], atol=1e-9)
    code, out = built.ik(moved, q + 0.02)
    assert code == 0
    ours = np.array([not joint.startswith("r") for joint in model.readings])
    np.testing.assert_allclose(out[ours], q[ours], atol=1e-8)
    np.testing.assert_allclose(out[~ours], (q + 0.02)[~ours], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("mimic: {joint: q2, ratio: 0.5}", "mimic: {joint: m}", "joints[3].mimic.joint: found 'm'"),
        ("{joint: q2, ratio: -0.2}", "{joint: q1}", "joints[2].mimic[1].joint: found 'q1' a second time"),
        ("offset: 3}", "offset: 3, actuated: true}", "mimic on a revolute or prismatic joint that is not actuated"),
        ("{joint: q2, ratio: 0.5}", "{joints: q2}", "joints[3].mimic"),
    ],
)  # fmt: skip
def test_what_cannot_follow_is_refused(tmp_path: Path, old: str, new: str, found: str) -> None:
    assert old in LOOP
    (tmp_path / "loop.yaml").write_text(
        LOOP.replace("c, d]", "c, d, w, v]").replace(old, new), encoding="utf-8"
    )
    with input_error(says=found):
        load_machine(tmp_path / "loop.yaml")
