"""A machine in MuJoCo's format, read back by MuJoCo: the tool's site stands where the machine's own kinematics put it."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.exported import mujoco_module
from support.generated_machines import BODIES, HEAD, machine_of
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


def written(where: Path, name: str) -> Machine:
    if name in BODIES:
        return machine_of(where, name)
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
