"""What a machine file says of a graph: its shorthand, units, homes, bodies, and what makes no sense."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.graph_machines import Document, document_of, machine_of, model_of, poses, spread, written
from truepose.errors import InputError
from truepose.models.effect_text import parse_effect
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.mechanism import looped


def test_the_shorthand_is_its_graph(tmp_path: Path) -> None:
    short = machine_of("hybrid")
    document = document_of("hybrid") | {"mechanism": dict(short.mechanism.expanded or {})}
    document["frames"] = {
        "tool": {"in": "flange", "xyz": [0, 0, 210], "tolerance": {"xyz": 0.1, "rpy": 0.05}}
    }
    graph = written(tmp_path, document)
    assert graph.mechanism.parameters == short.mechanism.parameters
    assert graph.frames == short.frames
    for field in ("joints", "actuators", "limbs", "lengths", "flange", "platform"):
        assert getattr(graph.mechanism, field) == getattr(short.mechanism, field), field
    q = spread("hybrid", 3)
    np.testing.assert_array_equal(poses(graph, tmp_path, q), poses(short, tmp_path, q))


def test_a_file_chooses_its_units(tmp_path: Path) -> None:
    document = document_of("planar")
    document["units"] = {"length": "m", "angle": "rad"}
    document["tolerances"] = {"length": 0.2e-3, "angle": float(np.radians(0.1))}
    mechanism = document["mechanism"]
    mechanism["home"] = {name: float(np.radians(value)) for name, value in mechanism["home"].items()}
    for joint in mechanism["joints"]:
        joint["xyz"] = [value / 1000 for value in joint["xyz"]]
        if "range" in joint:
            joint["range"] = [float(np.radians(value)) for value in joint["range"]]
    tool = document["frames"]["tool"]
    tool["xyz"], tool["rpy"] = [0.01, 0.005, 0.03], [0, 0, float(np.radians(20))]
    tool["tolerance"] = {"xyz": 0.5e-3, "rpy": float(np.radians(0.2))}
    document["sensor"]["sigma"] = {"xyz": 1e-5, "rot": float(np.radians(0.005))}
    for mass in document["masses"].values():
        mass["com"] = [value / 1000 for value in mass["com"]]
    metres = written(tmp_path, document)
    values = [(p.name, p.nominal, p.tolerance) for p in metres.parameters]
    usual = [(p.name, p.nominal, p.tolerance) for p in machine_of("planar").parameters]
    assert [v[0] for v in values] == [v[0] for v in usual]
    np.testing.assert_allclose([v[1:] for v in values], [v[1:] for v in usual], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(symbolic_model(metres).home, model_of("planar").home, atol=1e-9)


def test_sliding_homes_and_spherical_ones(tmp_path: Path) -> None:
    """Lengths in the file's unit; three angles of a ball joint as roll, pitch, yaw."""
    home = machine_of("hybrid").mechanism
    up3 = next(joint for joint in home.joints if joint.name == "up3")
    assert up3.home == pytest.approx((708.71,), rel=1e-4)  # half of the range, less what the limbs lean
    ball = next(joint for joint in machine_of("delta").mechanism.joints if joint.name == "s1a")
    expected = Rotation.from_euler("xyz", [-180, 43, -180], degrees=True).as_mrp()
    np.testing.assert_allclose(ball.home, expected, atol=1e-12)


def test_which_joints_stand_in_loops() -> None:
    planar, hybrid = machine_of("planar").mechanism, machine_of("hybrid").mechanism
    assert looped(planar) == {joint.name for joint in planar.joints}
    assert {joint.name for joint in hybrid.joints} - looped(hybrid) == {"q4", "q5", "q6"}
    assert looped(replace(hybrid, joints=hybrid.tree)) == set()


def joint(**fields: Any) -> Document:
    return {"name": "j", "kind": "revolute", "parent": "ground", "child": "arm", "actuated": True, **fields}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bodies": ["ground", "arm", "arm"]}, r"mechanism\.bodies: found 'arm' twice"),
        ({"bodies": []}, r"mechanism\.bodies: found none"),
        (
            {"bodies": ["ground", "arm", "base"]},
            r"mechanism\.bodies: found 'base' after 'ground', expected it first",
        ),
        (
            {"bodies": ["ground", "arm", "hand"]},
            r"mechanism\.joints: found no joints from 'ground' to body 'hand'",
        ),
        ({"joints": [joint(), joint()]}, r"mechanism\.joints: found 'j' twice"),
        (
            {"joints": [joint(child="arn")]},
            r"joints\[0\]\.child: found 'arn', expected a body; did you mean 'arm'",
        ),
        ({"joints": [joint(child="ground")]}, r"joints\[0\]: found 'j' between 'ground' and itself"),
        ({"joints": [joint(parent="arm", child="ground")]}, r"found no joints from 'ground' to body 'arm'"),
        (
            {"joints": [joint(kind="spherical")]},
            r"joints\[0\].*actuated: true on a revolute or prismatic joint only.*'spherical'",
        ),
        ({"joints": [joint(kind="screw")]}, r"joints\[0\]\.kind: expected 'revolute'"),
        ({"joints": [joint(axis=[0, 0, 0])]}, r"joints\[0\].*axis: a direction"),
        ({"joints": [joint(range=[3, -3])]}, r"joints\[0\].*range: expected \[low, high\] with low < high"),
        ({"joints": [joint(actuated=False)]}, r"mechanism\.joints: found no joint with `actuated: true`"),
        ({"joints": [joint(lenght=3)]}, r"joints\[0\]\.lenght: unknown field"),
        ({"home": {"k": 1}}, r"mechanism\.home: found joint 'k'"),
        ({"home": {"j": [1, 2, 3]}}, r"mechanism\.home\.j: found 3 numbers, expected 1 of a revolute joint"),
        ({"limbs": {"leg1": "k"}}, r"mechanism\.limbs\.leg1: found 'k', expected an actuated joint"),
        ({"flange": "hnad"}, r"mechanism\.flange: found 'hnad', expected a body"),
    ],
)
def test_graphs_that_make_no_sense_are_told(tmp_path: Path, change: Document, message: str) -> None:
    mechanism = {"type": "graph", "bodies": ["ground", "arm"], "joints": [joint()], **change}
    document = {"schema": "truepose/machine/1", "name": "m", "mechanism": mechanism}
    with pytest.raises(InputError, match=message):
        written(tmp_path, document)


def test_the_flange_is_the_body_that_the_file_names(tmp_path: Path) -> None:
    bodies = ["ground", "arm", "hand"]
    joints = [joint(), joint(name="k", parent="arm", child="hand", xyz=[100, 0, 0])]
    for more, flange in (({}, "hand"), ({"flange": "arm"}, "arm")):
        mechanism = {"type": "graph", "bodies": bodies, "joints": joints, **more}
        document = {"schema": "truepose/machine/1", "name": "m", "mechanism": mechanism}
        assert written(tmp_path, document).mechanism.flange == flange
    named = {
        "type": "graph",
        "bodies": ["ground", "flange", "hand"],
        "joints": [joint(child="flange"), {**joints[1], "parent": "flange"}],
    }
    document = {"schema": "truepose/machine/1", "name": "m", "mechanism": named}
    assert written(tmp_path, document).mechanism.flange == "flange"


@pytest.mark.parametrize(
    ("named", "place"),
    [
        ("actuator-scale@leg2:s=1e-3", "q2"),
        ("actuator-scale@q2:s=1e-3", "q2"),
        ("leg-compliance@q2:c=1e-3", "leg2"),
        ("thermal-expansion@q2:alpha=1e-5", "leg2"),
        ("joint-compliance@leg2:c=1e-3", "q2"),
    ],
)
def test_either_name_of_a_limb_is_understood(named: str, place: str) -> None:
    assert parse_effect(named, machine_of("hybrid")).place == (place,)
