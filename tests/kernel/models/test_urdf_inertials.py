"""What the links of a URDF weigh becomes the machine's masses and gravity, and what a file states wins."""

from __future__ import annotations

import math
from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.spatial.transform import Rotation

from support.described_machines import urdf_machine
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.assembly import Statics
from truepose.models.machine.effect import effects
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="world"/>
  <link name="stand"><inertial><mass value="50"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0 0.1 0.05"/><mass value="4"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.2 0 0" rpy="1 2 3"/><mass value="2"/></inertial></link>
  <link name="motor"><inertial><origin xyz="0 0 0.1"/><mass value="1"/></inertial></link>
  <link name="hand"/>
  <link name="finger"><inertial><origin xyz="0.01 0 0"/><mass value="0.5"/></inertial></link>
  <joint name="foot" type="fixed">
    <parent link="world"/> <child link="stand"/> <origin xyz="0 0 0.2" rpy="1.5707963267948966 0 0"/>
  </joint>
  <joint name="q1" type="revolute">
    <parent link="stand"/> <child link="upper"/> <axis xyz="0 0 1"/> <limit lower="-2" upper="2"/>
  </joint>
  <joint name="q2" type="revolute">
    <parent link="upper"/> <child link="fore"/> <origin xyz="0 0 0.3"/> <axis xyz="1 0 0"/>
    <limit lower="-2" upper="2"/>
  </joint>
  <joint name="screws" type="fixed">
    <parent link="fore"/> <child link="motor"/> <origin xyz="0.4 0 0" rpy="0 1.5707963267948966 0"/>
  </joint>
  <joint name="wrist" type="fixed"> <parent link="fore"/> <child link="hand"/> <origin xyz="0.5 0 0"/> </joint>
  <joint name="grip" type="prismatic">
    <parent link="hand"/> <child link="finger"/> <origin xyz="0 0.02 0"/> <axis xyz="0 1 0"/>
  </joint>
</robot>
"""
MECHANISM = "mechanism: {type: urdf, file: arm.urdf, base_link: world, tip_link: hand}"


def machine_of(folder: Path, more: str = "", urdf: str = URDF, mechanism: str = MECHANISM) -> Machine:
    return urdf_machine(folder, urdf, mechanism, more)


def test_links_weigh_on_the_bodies_that_carry_them(tmp_path: Path) -> None:
    """Also those off the chain: screwed on, or held by joints at zero. The stand moves with no joint but is a body."""
    machine = machine_of(tmp_path)
    masses = {mass.body: mass for mass in machine.masses}
    assert {name: mass.kg for name, mass in masses.items()} == {
        "stand": 50,
        "upper": 4,
        "fore": 3,
        "hand": 0.5,
    }
    np.testing.assert_allclose(masses["upper"].com, [0, 100, 50])
    motor = 400 + 100  # its z points along x of the forearm
    np.testing.assert_allclose(masses["fore"].com, [(2 * 200 + motor) / 3, 0, 0], atol=1e-9)
    np.testing.assert_allclose(masses["hand"].com, [10, 20, 0])
    assert machine.gravity == (0.0, 0.0, -9.80665)
    assert machine.loaded


def test_gravity_follows_the_root_link(tmp_path: Path) -> None:
    """The chain from ``stand`` on, which lies on its back: its y axis points up."""
    machine = machine_of(tmp_path, mechanism=MECHANISM.replace("world", "stand"))
    np.testing.assert_allclose(np.array(machine.gravity), [0, -9.80665, 0], atol=1e-12)
    assert "stand" not in {mass.name for mass in machine.masses}


@pytest.mark.parametrize(
    ("more", "kilograms", "gravity"),
    [
        ("gravity: [0, 9.8, 0]\n", [50, 4, 3, 0.5], (0.0, 9.8, 0.0)),
        ("masses: {lump: {kg: 7, in: fore}}\n", [7], None),
        ("masses: {lump: {kg: 7, in: fore}}\ngravity: [0, 0, -9]\n", [7], (0.0, 0.0, -9.0)),
        ("masses: {}\n", [], None),
        ("masses: {payload: {kg: 0, in: tool}}\n", [50, 4, 3, 0.5, 0], (0.0, 0.0, -9.80665)),
    ],
)
def test_what_the_file_states_wins(
    tmp_path: Path, more: str, kilograms: list[float], gravity: tuple[float, float, float] | None
) -> None:
    """A payload alone says nothing of the links."""
    machine = machine_of(tmp_path, more)
    assert [mass.kg for mass in machine.masses] == kilograms
    assert machine.gravity == gravity


def test_a_urdf_without_inertials_says_nothing_of_gravity(tmp_path: Path) -> None:
    bare = machine_of(tmp_path, urdf=URDF.replace("<mass ", "<lump "))
    assert bare.masses == ()
    assert bare.gravity is None
    assert bare.notes == ()


def test_joints_can_be_compliant_where_nobody_stated_a_mass(tmp_path: Path) -> None:
    places = effects.get("joint-compliance", "test")().places(machine_of(tmp_path))
    assert ("q2",) in {tuple(place) for place in places}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('mass value="4"', 'mass value="-4"', "link 'upper': inertial.mass: found -4, expected a number >= 0"),
        ('mass value="4"', 'mass value="four"', "link 'upper': inertial.mass: found 'four'"),
        ('xyz="0 0.1 0.05"', 'xyz="0 0.1"', "link 'upper': inertial.origin.xyz: found '0 0.1', expected 3 numbers"),
    ],
)  # fmt: skip
def test_inertials_that_are_none_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine_of(tmp_path, urdf=URDF.replace(old, new))


def test_loads_are_those_of_the_urdfs_own_links(tmp_path: Path) -> None:
    """Gravity's torque about q2 is minus the slope of the weights' energy by q2, from centres in the world."""
    machine, pan, lift = machine_of(tmp_path), 0.3, 0.7
    upper = Rotation.from_euler("x", 90, degrees=True) * Rotation.from_rotvec([0, 0, pan])

    def energy(angle: float) -> float:
        fore = upper * Rotation.from_rotvec([angle, 0, 0])
        return math.fsum(
            9.80665 * kg * fore.apply(com)[2] / 1000.0 for kg, com in ((3, [300, 0, 0]), (0.5, [510, 20, 0]))
        )

    model = symbolic_model(machine)
    q = dict(zip(model.readings, ca.vertsplit(model.q), strict=True))
    nominal = {p.name: ca.SX(p.nominal) for p in machine.parameters} | {
        port: ca.SX(0) for port in machine.ports
    }
    load = Statics.of(machine, nominal, q, {}, model.x).loads(nominal)["q2.displacement"]
    torque = float(ca.Function("load", [model.q], [load])([pan, lift]))
    step = 1e-5
    assert torque == pytest.approx((energy(lift - step) - energy(lift + step)) / (2 * step), rel=1e-7)


def test_a_calibrated_file_keeps_masses_and_gravity(tmp_path: Path) -> None:
    """It needs no URDF, so that both are written out, in the file's units."""
    tolerances = "tolerances: {length: 0.3, angle: 0.1}\nunits: {length: m, angle: rad}\n"
    machine = machine_of(tmp_path, tolerances)
    rng = np.random.default_rng(3)
    q = rng.uniform(-1.5, 1.5, (40, 2))
    model = symbolic_model(machine)
    pose = ca.Function("pose", [model.q, model.p], [model.pose])
    at = np.array([np.array(pose(row, model.p_home))[:3, 3] for row in q]) / 1000.0
    frame = pd.DataFrame(np.column_stack([q, at]), columns=["q1", "q2", *"xyz"])
    frame.to_csv(tmp_path / "rows.csv", index=False)
    recording = load_recording(machine, [tmp_path / "rows.csv"])
    write_calibrated(tmp_path / "calibrated.yaml", estimate(machine, recording), recording)
    (tmp_path / "arm.urdf").unlink()
    read = load_machine(tmp_path / "calibrated.yaml")
    assert yaml.safe_load((tmp_path / "calibrated.yaml").read_text())["mechanism"]["type"] == "graph"
    assert read.gravity == machine.gravity
    assert [(m.kg, m.body) for m in read.masses] == [(m.kg, m.body) for m in machine.masses]
    np.testing.assert_allclose([m.com for m in read.masses], [m.com for m in machine.masses], rtol=1e-12)
