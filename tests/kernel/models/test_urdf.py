"""Chains read from a URDF: against the product of its joints written out in numpy, and what is refused."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.described_machines import urdf_machine
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="world"/> <link name="stand"/> <link name="upper"/> <link name="boom"/> <link name="hand"/>
  <link name="tip"/> <link name="camera"/> <link name="finger"/> <link name="other"/>
  <joint name="foot" type="fixed">
    <origin xyz="0.1 0 0.2" rpy="0 0 0.3"/> <parent link="world"/> <child link="stand"/>
  </joint>
  <joint name="pan" type="continuous">
    <parent link="stand"/> <child link="upper"/> <origin xyz="0 0.05 0.333"/> <axis xyz="0 0 1"/>
  </joint>
  <joint name="lift" type="revolute">
    <parent link="upper"/> <child link="boom"/> <origin xyz="0.02 0 0.15" rpy="-1.2 0.4 0.1"/>
    <axis xyz="0 0.6 -0.8"/> <limit lower="-1.5" upper="2" effort="87" velocity="2"/>
  </joint>
  <joint name="reach" type="prismatic">
    <parent link="boom"/> <child link="hand"/> <origin xyz="0.4 0 0" rpy="0 1.5707963267948966 0"/>
    <limit lower="-0.05" upper="0.25" effort="1" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed"> <parent link="hand"/> <child link="tip"/> <origin xyz="0 0 0.107"/> </joint>
  <joint name="eye" type="fixed"> <parent link="upper"/> <child link="camera"/> </joint>
  <joint name="grip" type="prismatic">
    <parent link="hand"/> <child link="finger"/> <axis xyz="0 1 0"/> <limit lower="0" upper="0.04"/>
    <mimic joint="reach"/>
  </joint>
  <joint name="loose" type="floating"> <parent link="hand"/> <child link="other"/> </joint>
  <transmission name="t"> <joint name="lift"/> <actuator name="m"/> </transmission>
</robot>
"""
MECHANISM = "mechanism: {type: urdf, file: arm.urdf, base_link: world, tip_link: tip}"
TOLERANCES = "tolerances: {length: 0.3, angle: 0.1}\n"


def machine_of(folder: Path, urdf: str = URDF, mechanism: str = MECHANISM, more: str = TOLERANCES) -> Machine:
    return urdf_machine(folder, urdf, mechanism, more)


def written_out(pan: float, lift: float, reach: float) -> Array:
    """The chain of URDF above, (4, 4) in mm; joint values in rad and mm."""

    def step(xyz: tuple[float, float, float], rpy: tuple[float, float, float]) -> Array:
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), np.multiply(xyz, 1000)
        return out

    def turn(axis: tuple[float, float, float], angle: float) -> Array:
        out = np.eye(4)
        out[:3, :3] = Rotation.from_rotvec(np.multiply(axis, angle)).as_matrix()
        return out

    slide = np.eye(4)
    slide[0, 3] = reach  # along x: the axis of a joint that states none
    out: Array = np.linalg.multi_dot(
        [
            step((0.1, 0, 0.2), (0, 0, 0.3)),
            step((0, 0.05, 0.333), (0, 0, 0)) @ turn((0, 0, 1), pan),
            step((0.02, 0, 0.15), (-1.2, 0.4, 0.1)) @ turn((0, 0.6, -0.8), lift),
            step((0.4, 0, 0), (0, np.pi / 2, 0)) @ slide,
            step((0, 0, 0.107), (0, 0, 0)),
        ]
    )
    return out


@pytest.mark.parametrize("units", ["{}", "{length: m, angle: rad}", "{length: in, angle: arcmin}"])
def test_a_chain_is_the_product_of_its_joints(tmp_path: Path, units: str) -> None:
    """Whatever units the machine file is written in: inside there are mm and rad."""
    machine = machine_of(tmp_path, more=f"units: {units}\n")
    model = symbolic_model(machine)
    pose = ca.Function("pose", [model.q, model.p], [model.pose])
    for q in np.random.default_rng(1).uniform([-3, -1.5, -50], [3, 2, 250], (5, 3)):
        np.testing.assert_allclose(np.array(pose(q, model.p_home)), written_out(*q), atol=1e-9)


def test_names_kinds_and_ranges_are_the_files(tmp_path: Path) -> None:
    mechanism = machine_of(tmp_path).mechanism
    assert mechanism.bodies == ("base", "stand", "upper", "boom", "hand", "tip")
    assert mechanism.flange == "tip"
    assert mechanism.readings == ("pan", "lift", "reach")
    assert [a.unit for a in mechanism.actuators] == ["rad", "rad", "mm"]
    ranges = [a.range for a in mechanism.actuators]
    assert ranges[0] is None
    np.testing.assert_allclose(np.array(ranges[1:]), np.array([(-1.5, 2), (-50, 250)]), rtol=1e-14)
    names = [p.name for p in mechanism.parameters]
    assert {"foot.x", "pan.offset", "lift.rz", "flange.z"} <= set(names)
    assert "foot.offset" not in names


def test_joints_may_have_other_names(tmp_path: Path) -> None:
    renamed = MECHANISM.replace("tip}", "tip, joints: {pan: q1, lift: q2, reach: q3, flange: plate}}")
    mechanism = machine_of(tmp_path, mechanism=renamed).mechanism
    assert mechanism.readings == ("q1", "q2", "q3")
    assert {"q1.offset", "plate.z"} <= {p.name for p in mechanism.parameters}


def test_part_of_a_chain_and_a_body_called_flange(tmp_path: Path) -> None:
    """The tip is the flange, also where a link before it has that name."""
    urdf = URDF.replace('link="hand"', 'link="flange"').replace('link name="hand"', 'link name="flange"')
    part = machine_of(tmp_path, urdf, MECHANISM.replace("world", "upper"))
    assert part.mechanism.bodies == ("base", "boom", "flange", "tip")
    assert part.mechanism.flange == "tip"
    model = symbolic_model(part)
    pose = np.array(ca.Function("pose", [model.q, model.p], [model.pose])([0.3, 40.0], model.p_home))
    base = np.eye(4)  # of the link upper, where pan stands at zero
    base[:3, :3] = Rotation.from_euler("z", 0.3).as_matrix()
    base[:3, 3] = [100, 0, 200] + base[:3, :3] @ [0, 50, 333]
    np.testing.assert_allclose(pose, np.linalg.inv(base) @ written_out(0, 0.3, 40), atol=1e-9)


def test_a_calibrated_chain_is_a_graph_that_needs_no_urdf(tmp_path: Path) -> None:
    """Fitted to the numpy chain of an arm that is off by a few tolerances."""
    machine = machine_of(tmp_path)
    rng = np.random.default_rng(5)
    q = rng.uniform([-3, -1.5, -50], [3, 2, 250], (60, 3))
    true = q + np.array([0.002, -0.001, 0.4])  # zeros of the joints
    at = np.array([written_out(*row)[:3, 3] for row in true]) + 0.02 * rng.standard_normal((60, 3))
    frame = pd.DataFrame(
        np.column_stack([np.degrees(q[:, :2]), q[:, 2], at]), columns=["pan", "lift", "reach", *"xyz"]
    )
    frame.to_csv(tmp_path / "rows.csv", index=False)
    recording = load_recording(machine, [tmp_path / "rows.csv"])
    fit = estimate(machine, recording)
    assert 0.75 < fit.chi2_per_dof < 1.25  # 2.5 sigma of 170 degrees of freedom
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    (tmp_path / "arm.urdf").unlink()
    again = load_machine(tmp_path / "calibrated.yaml")
    assert again.file is not None
    assert again.file.mechanism["type"] == "graph"
    assert again.mechanism.flange == "tip"
    np.testing.assert_allclose([p.nominal for p in again.parameters], fit.p, rtol=1e-12, atol=1e-12)
    assert [a.range for a in again.mechanism.actuators] == [a.range for a in machine.mechanism.actuators]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<robot ", "<robt ", r"arm\.urdf: cannot read the URDF: broken XML"),
        ("robot", "model", r"arm\.urdf: found <model>, expected <robot>"),
        ('"revolute"', '"planar"', r"arm\.urdf: joint 'lift': type: found 'planar', expected revolute"),
        ('"revolute"', '"floating"', r"joint 'lift': type: found 'floating'.*type: graph"),
        ('<axis xyz="0 0.6 -0.8"/>', '<mimic joint="foot"/>', r"joint 'lift': mimic: found 'foot'"),
        ("0 0.6 -0.8", "0 0 0", r"joint 'lift': axis: found 0 0 0, expected a direction"),
        ("0 0.6 -0.8", "0 1", r"joint 'lift': axis\.xyz: found '0 1', expected 3 numbers"),
        ("-1.2 0.4 0.1", "${pi} 0 0", r"joint 'lift': origin: found '\$\{pi\}', expected finite numbers"),
        (
            'upper="2"',
            'upper="-2"',
            r"joint 'lift': limit: found lower -1\.5, upper -2, expected lower < upper",
        ),
        (
            'child link="boom"',
            'child link="bom"',
            r"joint 'lift': child: found 'bom', expected a link; did you mean 'boom'",
        ),
        ('<child link="camera"/>', "", r"joint 'eye': child: found '', expected a link"),
        (
            'child link="camera"',
            'child link="boom"',
            r"joint 'eye': child: found 'boom', which 'lift' carries already",
        ),
        ('link name="camera"', 'link name="boom"', r"arm\.urdf: link: found 'boom' twice"),
        ('joint name="eye"', 'joint name="lift"', r"arm\.urdf: joint: found 'lift' twice"),
        ('joint name="eye"', "joint", r"arm\.urdf: joint: found one without a name"),
    ],
)
def test_a_urdf_that_is_wrong_is_told(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine_of(tmp_path, URDF.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("arm.urdf", "no.urdf", r"no\.urdf: cannot read the URDF: No such file"),
        (
            "tip_link: tip",
            "tip_link: tipp",
            r"arm\.yaml: mechanism\.tip_link: found 'tipp', no link of .*did you mean 'tip'",
        ),
        ("base_link: world", "base_link: word", r"mechanism\.base_link: found 'word'.*did you mean 'world'"),
        (
            "world, tip_link: tip",
            "tip, tip_link: world",
            r"mechanism\.tip_link: found 'world', which no joint",
        ),
        (
            "world, tip_link: tip",
            "camera, tip_link: tip",
            r"mechanism\.tip_link: found 'tip', which no joint",
        ),
        ("tip_link: tip", "tip_link: world", r"mechanism\.tip_link: found 'world'"),
        (
            "tip_link: tip",
            "tip_link: stand",
            r"mechanism: found no joint that moves between 'world' and 'stand'",
        ),
        (
            "world, tip_link: tip",
            "hand, tip_link: finger",
            r"joint 'grip': mimic: found 'reach', which lies on no way to a tip",
        ),
        ("tip_link: tip", "tip_link: other", r"joint 'loose': type: found 'floating'"),
        (
            "tip}",
            "tip, joints: {pann: q1}}",
            r"mechanism\.joints: found 'pann', no joint of the chain; did you mean 'pan'",
        ),
        ("tip}", "tip, joints: {grip: q1}}", r"mechanism\.joints: found 'grip'"),
        ("tip}", "tip, joints: {pan: lift}}", r"mechanism\.joints: found 'lift' twice"),
        ("tip}", 'tip, joints: {pan: ""}}', r"mechanism\.joints\.pan: found an empty name"),
        ("tip}", "tip, tips: 3}", r"mechanism\.tips: unknown field"),
        ("file: arm.urdf, ", "", r"mechanism\.file: missing field"),
    ],
)
def test_a_section_that_is_wrong_is_told(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine_of(tmp_path, mechanism=MECHANISM.replace(old, new))


def test_a_link_called_base_further_on_is_the_base_itself(tmp_path: Path) -> None:
    urdf = URDF.replace('"stand"', '"base"')
    with pytest.raises(InputError, match=r"base_link: found 'world', with the link 'base' further on"):
        machine_of(tmp_path, urdf)
    assert machine_of(tmp_path, urdf, MECHANISM.replace("world", "base")).mechanism.bodies[0] == "base"


def test_limits_that_say_nothing_are_none(tmp_path: Path) -> None:
    urdf = URDF.replace('<limit lower="-1.5" upper="2" ', "<limit ")
    assert machine_of(tmp_path, urdf).mechanism.actuators[1].range is None
