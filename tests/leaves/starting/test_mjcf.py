"""An MJCF as a machine file: the same poses and the same weight as MuJoCo's own model has."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.command import input_error, refused
from support.described_machines import mjcf_machine
from support.exported import site_pose
from support.skips import NO_MUJOCO
from truepose.arrays import Array

if find_spec("mujoco") is None:
    pytest.skip(NO_MUJOCO, allow_module_level=True)

import mujoco

from truepose.models.leaves.starting import compiled_mjcf, mjcf
from truepose.models.machine.assembly import Statics
from truepose.models.machine.kinematics import symbolic_model

HEAD = """<mujoco model="arm"> <compiler angle="radian" autolimits="true" eulerseq="zyx"/> <option gravity="0 0 -9.7"/>
  <default> <joint axis="0 1 0"/> <default class="slide"> <joint type="slide" axis="0.6 0 0.8" range="-0.2 0.3"/> </default>
  </default> <worldbody>"""
ARM = (
    HEAD
    + """
  <body name="stand" pos="1 2 0.5" euler="0.3 0.2 -0.4"> <geom type="box" size="0.1 0.1 0.3" density="7000"/>
    <body name="base" pos="0 0 0.3" quat="0.9 0.1 0.2 0.3">
      <joint name="pan" axis="0 0 1" pos="0.02 0.01 0.1" range="-2 2"/> <geom type="sphere" size="0.08" pos="0.1 0 0"/>
      <body name="fore" pos="0.4 0 0.1" axisangle="1 1 0 0.7">
        <joint name="lift" ref="0.5" pos="0 0 -0.05"/> <joint name="roll" axis="1 0 0" pos="0.05 0 0"/>
        <inertial pos="0.1 0.02 0" mass="2.5" diaginertia="0.1 0.1 0.1"/>
        <body name="bracket" pos="0.2 0 0" euler="0 1.5707963267948966 0">
          <geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.2"/>
          <body name="hand" pos="0 0 0.3"> <joint name="reach" class="slide" pos="0.01 0.02 0.03"/>
            <geom type="cylinder" size="0.05 0.1" mass="0.7"/>
            <body name="finger" pos="0.02 0 0.05"> <geom type="box" size="0.01 0.01 0.04" mass="0.1"/> </body>
          </body> </body> </body> </body> </body> </worldbody> </mujoco>"""
)
READINGS = ("pan", "lift", "roll", "reach")
MESHES = ARM.replace("<worldbody>", '<asset><mesh name="m" file="nowhere.stl"/></asset> <worldbody>').replace(
    '<geom type="sphere" size="0.08" pos="0.1 0 0"/>', '<geom type="mesh" mesh="m"/>'
)


SITED = ARM.replace(
    '<body name="finger"', '<site name="tcp" pos="0.1 0.02 0" euler="0.2 0.3 0.4"/> <body name="finger"'
)


def simulated(xml: str, q: Array) -> mujoco.MjData:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    for name, value in zip(READINGS, q, strict=True):
        data.joint(name).qpos = value
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)  # the force of gravity at rest is the bias
    return data


def frame_of(data: mujoco.MjData, end: str) -> Array:
    """Return the frame (4, 4) mm of a body or of the site tcp."""
    return site_pose(data.site(end) if end == "tcp" else data.body(end))


@pytest.mark.parametrize(
    ("xml", "options", "end"),
    [
        (ARM, (), "finger"),
        (ARM, ("--tip", "hand"), "hand"),
        (SITED, ("--tip", "tcp"), "tcp"),
        (SITED, (), "finger"),
    ],
)
def test_the_chain_is_mujocos(tmp_path: Path, xml: str, options: tuple[str, ...], end: str) -> None:
    """Anchors off the bodies' origins, two joints on one body, a reference, a pitch of 90 deg, slides. mm and rad.

    It ends at the last body, which is fixed to the one that the last joint moves, at a site, or at another body.
    """
    machine = mjcf_machine(tmp_path, xml, *options)
    assert machine.mechanism.readings == READINGS
    model = symbolic_model(machine)
    pose = ca.Function("pose", [model.q, model.p], [model.pose])
    for q in np.random.default_rng(3).uniform([-2, -2, -2, -0.2], [2, 2, 2, 0.3], (8, 4)):
        data = simulated(xml, q)
        expected = np.linalg.inv(frame_of(data, "stand")) @ frame_of(data, end)
        found = np.array(pose([*q[:3], 1000 * q[3]], model.p_home))
        np.testing.assert_allclose(found, expected, atol=1e-9)  # 14 digits in the file


def test_weights_pull_as_mujocos_do(tmp_path: Path) -> None:
    """Torque and force of gravity about every joint, also of what hangs on the chain."""
    machine = mjcf_machine(tmp_path, ARM)
    model = symbolic_model(machine)
    readings = dict(zip(model.readings, ca.vertsplit(model.q), strict=True))
    nominal = {p.name: ca.SX(p.nominal) for p in machine.parameters} | {
        port: ca.SX(0) for port in machine.ports
    }
    loads = Statics.of(machine, nominal, readings, {}, model.x).loads(nominal)
    pulled = ca.Function("f", [model.q], [ca.vertcat(*(loads[f"{name}.displacement"] for name in READINGS))])
    for q in np.random.default_rng(4).uniform([-2, -2, -2, -0.2], [2, 2, 2, 0.3], (4, 4)):
        data = simulated(ARM, q)
        expected = [-float(data.joint(name).qfrc_bias[0]) for name in READINGS]
        found = np.array(pulled([*q[:3], 1000 * q[3]])).ravel()
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_names_ranges_and_gravity_are_the_files(tmp_path: Path) -> None:
    """A body called base further on gets another name: base is the first body everywhere else."""
    machine = mjcf_machine(tmp_path, ARM)
    assert machine.mechanism.bodies[:2] == ("base", "base_body")
    ranges = [a.range for a in machine.mechanism.actuators]
    assert ranges[0] == pytest.approx((-2, 2))
    assert ranges[1] is None
    assert ranges[3] == pytest.approx((-200, 300))
    assert np.linalg.norm(machine.gravity or (0,)) == pytest.approx(9.7)
    assert machine.geometry["lift.offset"].nominal == pytest.approx(-0.5)


def test_sites_that_are_not_the_tip_are_listed(tmp_path: Path) -> None:
    mjcf_machine(tmp_path, SITED)
    assert "# Left out: sites, each of which --tip takes: tcp\n" in (tmp_path / "m.yaml").read_text()
    mjcf_machine(tmp_path, SITED, "--tip", "tcp")
    assert "Left out" not in (tmp_path / "m.yaml").read_text().replace("Left out: bodies", "")


def test_meshes_that_are_not_there_cost_their_masses(tmp_path: Path) -> None:
    machine = mjcf_machine(tmp_path, MESHES)
    assert "base_body" not in {mass.name for mass in machine.masses}
    text = " ".join((tmp_path / "m.yaml").read_text().replace("#  ", "").split())
    assert "bodies without mass, whose meshes were not at hand: base_body. CHECK masses." in text


@pytest.mark.parametrize(
    ("xml", "tip", "message"),
    [
        ("<mujoco><worldbody><body nme='x'/></worldbody></mujoco>", "", "cannot read the MJCF: XML Error"),
        ("<mujoco><worldbody/></mujoco>", "", "found several ends of a chain: none with joints"),
        (ARM, "hnd", "--tip: found 'hnd', no body or site of .*did you mean 'hand'"),
        (ARM, "stand", "no joint on the way to 'stand'"),
        (
            ARM.replace('name="roll" axis="1 0 0" pos="0.05 0 0"', 'name="roll" type="ball"'),
            "",
            "ball or free",
        ),
    ],
)
def test_what_is_no_chain_is_refused(tmp_path: Path, xml: str, tip: str, message: str) -> None:
    (tmp_path / "arm.xml").write_text(xml)
    with input_error(message):
        mjcf.mjcf_start(tmp_path / "arm.xml", tip)


@pytest.mark.parametrize("kind", ['[<!ENTITY e "lol">]', 'SYSTEM "http://127.0.0.1:9/x"'])
def test_a_model_has_no_entities(tmp_path: Path, kind: str) -> None:
    (tmp_path / "a.xml").write_text(f"<!DOCTYPE r {kind}>{ARM}")
    with input_error(r"a\.xml: found <!DOCTYPE>"):
        mjcf.mjcf_start(tmp_path / "a.xml")


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("was", "becomes", "told"),
    [
        (
            "</worldbody>",
            '<replicate count="1000000"><body><geom/></body></replicate></worldbody>',
            "more than 1 s",
        ),
        ('pos="0 0 0.3"', 'pos="0 0 1e300"', "at most 1e+12"),
        ('pos="0 0 0.3"', 'pos="0 0 nan"', "expected 3 finite numbers"),
        ('range="-2 2"', 'range="-2 1e308"', "mechanism.joints[0].range[1]: expected a finite number"),
        ('mass="0.7"', 'mass="1e300"', "masses.hand.kg: expected a finite number"),
        ('"0 0 -9.7"', '"0 0 -1e300"', "gravity"),
    ],
)
def test_what_no_robot_is_costs_no_more_than_a_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, was: str, becomes: str, told: str
) -> None:
    """It is refused in one line, and nothing is written: MuJoCo's log is elsewhere."""
    monkeypatch.setattr(compiled_mjcf, "SECONDS_MOST", 1)
    (tmp_path / "arm.xml").write_text(ARM.replace(was, becomes))
    refused("init", "--mjcf", tmp_path / "arm.xml", "-o", tmp_path / "m.yaml", said=told)
    assert [one.name for one in tmp_path.iterdir()] == ["arm.xml"]
