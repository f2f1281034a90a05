"""A machine in MuJoCo's format, read back by MuJoCo: the tool's site stands where the machine's own kinematics put it."""

from __future__ import annotations

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.exported import closed_in_mujoco, mujoco_module, site_pose
from support.generated_machines import BODIES, HEAD, machine_of
from truepose.identification.compensation.inverse import PoseSolver
from truepose.models.leaves.export.write import export, render
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

mujoco = mujoco_module()
MOUNTED = """frames:
  base: {in: world, xyz: [40, -3, 700], rpy: [1, 2, 30]}
  tool: {in: flange, xyz: [3, 4, 50], rpy: [9, 90, 2]}
"""
FOLLOWING = """  type: graph
  bodies: [base, column, boom, hand]
  joints:
    - {name: lift, kind: prismatic, parent: base, child: column, xyz: [1, 2, 300], rpy: [0.1, 0.2, 0.3],
       axis: [0.1, -0.2, 0.97], offset: 3, actuated: true, range: [-100, 250]}
    - {name: swing, kind: revolute, parent: column, child: boom, xyz: [50, 0, 0], axis: [0, 1, 0],
       mimic: {joint: lift, ratio: 0.2}}
    - {name: turn, kind: revolute, parent: boom, child: hand, xyz: [0, 120, 3], rpy: [0, -90, 0.02], offset: 10, actuated: true}
masses:
  boom: {kg: 3.0, com: [10, 20, 30], in: boom}
  motor: {kg: 1.0, com: [-30, 0, 0], in: boom}
  gripper: {kg: 0.5, com: [0, 0, 40], in: tool}
gravity: [0, 0, -9.80665]
"""


STEWART = re.sub(r", gain: [\d.]+|, range: \[-1.5, 1.5\]|units: .*", "", BODIES["turns"])
FLAT = re.sub(
    r", rpy: \[0(\.1)?, 0(\.05)?, 0\]|(?<=, )0\.[12](?=\])",
    lambda m: "" if "rpy" in m[0] else "0",
    BODIES["planar"],
)
HEXAPOD = STEWART + "masses: {payload: {kg: 30, com: [20, 0, 90], in: platform}}\n"


def written(where: Path, name: str) -> Machine:
    if name in BODIES:
        return machine_of(where, name)
    if name in ("hexapod", "flat"):
        body = HEXAPOD if name == "hexapod" else FLAT
        (where / f"{name}.yaml").write_text(HEAD.format(name=name) + body)
        return load_machine(where / f"{name}.yaml")
    body = {"mounted": BODIES["nano"].split("frames")[0] + MOUNTED, "following": FOLLOWING + MOUNTED}[name]
    head = HEAD.replace("gravity: [0, 0, -9.80665]\n", "") if name == "following" else HEAD
    if name == "following":
        mechanism, gravity = body.split("gravity:")
        body = mechanism + "gravity:" + gravity
    (where / f"{name}.yaml").write_text(head.format(name=name) + body)
    return load_machine(where / f"{name}.yaml")


@pytest.mark.parametrize("name", ["arm", "nano", "scara", "redundant", "mounted", "following"])
def test_mujoco_puts_the_tool_where_the_machine_does(tmp_path: Path, name: str) -> None:
    machine = written(tmp_path, name)
    export(machine, tmp_path / "out.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    data = mujoco.MjData(model)
    own = symbolic_model(machine, ())
    at = ca.Function("pose", [own.q, own.z, own.p], [own.world])
    rng = np.random.default_rng(4)
    for _ in range(20):
        q = []
        for actuator in machine.mechanism.actuators:
            low, high = actuator.range or ((-3.0, 3.0) if actuator.unit == "rad" else (-200.0, 200.0))
            value = rng.uniform(low, high)
            q.append(value)
            scale = 1000.0 if actuator.unit == "mm" else 1.0
            data.qpos[model.joint(actuator.reading).qposadr[0]] = value / scale
            if actuator.range is not None:
                np.testing.assert_allclose(
                    model.joint(actuator.reading).range * scale, (low, high), rtol=1e-12
                )
        if name == "following":  # a constraint that forces would enforce; kinematics alone is told
            (row,) = model.eq_data[: model.neq]
            lead = data.qpos[model.joint("lift").qposadr[0]]
            data.qpos[model.joint("swing").qposadr[0]] = row[0] + row[1] * lead
        mujoco.mj_forward(model, data)
        pose = np.array(at(q, own.z_home, own.p_home))
        assert np.max(np.abs(data.site("tool").xpos - pose[:3, 3] / 1000.0)) < 1e-9
        assert np.max(np.abs(data.site("tool").xmat.reshape(3, 3) - pose[:3, :3])) < 1e-12


@pytest.mark.parametrize("name", ["rails", "hybrid", "flat", "hexapod"])
def test_loops_that_mujoco_closes_put_the_tool_where_the_machine_does(tmp_path: Path, name: str) -> None:
    """Driven joints stand at readings; the others are moved by Newton's method until MuJoCo's own constraints hold."""
    machine = written(tmp_path, name)
    export(machine, tmp_path / "out.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    solver = PoseSolver(machine.with_effects(()))
    home = solver.model.q_home
    ranges = [a.range or (h - 40.0, h + 40.0) for a, h in zip(machine.mechanism.actuators, home, strict=True)]
    low, high = np.transpose(ranges)
    rows = [home, *(home + 0.3 * (np.random.default_rng(4).uniform(low, high, (6, len(low))) - home))]
    poses, good = solver.forward(np.array(rows))
    assert good.all()
    for q, pose in zip(rows, poses, strict=True):
        data = closed_in_mujoco(model, machine, q)
        apart = np.abs(site_pose(data.site("tool")) - pose)
        assert np.max(apart / [1.0, 1.0, 1.0, 1000.0]) < 1e-9
    assert np.ptp(poses[:, :3, 3], axis=0).max() > 1.0  # mm


def test_loops_that_cannot_close_are_said_to_be_strained(tmp_path: Path) -> None:
    """The planar machine as built: its axes are a little askew, and its loops have more equations than coordinates."""
    done = render(machine_of(tmp_path, "planar"), "mjcf")
    (note,) = done.notes
    assert re.match(r"loops are strained: at home [\d.]+ mm are left", note) and note in done.text
    assert render(written(tmp_path, "flat"), "mjcf").notes == ()
    mujoco.MjModel.from_xml_string(done.text)


def test_a_machine_with_loops_says_what_it_leaves_out(tmp_path: Path) -> None:
    done = render(machine_of(tmp_path, "hybrid"), "mjcf")
    assert set(done.left_out) == {"actuator-scale@q3"}
    assert done.frozen == {"thermal-expansion@leg2": {"temperature.leg2": 20.0}}
    # 8e-4 of a limb of 740 mm
    assert 0.1 < done.lost < 3.0 and f"together up to {done.lost:.3g} mm" in done.text


def test_masses_and_gravity_are_the_machines(tmp_path: Path) -> None:
    """MuJoCo's potential energy is that of the points: what falls by a height gives up its weight times it."""
    machine = written(tmp_path, "following")
    model = mujoco.MjModel.from_xml_string(render(machine, "mjcf").text)
    assert float(np.sum(model.body_mass)) == pytest.approx(4.5, abs=1e-5)
    np.testing.assert_allclose(np.linalg.norm(model.opt.gravity), 9.80665, rtol=1e-12)
    # gravity is told in the base's frame, which is tilted by 1 and 2 deg
    assert abs(model.opt.gravity[0]) > 0.1
    assert model.body("boom").mass[0] == pytest.approx(4.0, abs=1e-6)
    np.testing.assert_allclose(model.body("boom").ipos, [0.0, 0.015, 0.0225], atol=1e-12)


def test_what_is_left_out_stands_in_a_comment(tmp_path: Path) -> None:
    done = render(machine_of(tmp_path, "arm"), "mjcf")
    assert re.search(
        r"<!-- MJCF cannot hold, and leaves out: .*joint-compliance@q2 \([\d.]+ mm\).* mm at the tool",
        done.text,
    )
    assert done.notes[0].startswith("MJCF cannot hold")
