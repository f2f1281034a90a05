"""Volumetric tables read by a few lines of numpy: the rigid-body model of ISO 230-1 with them puts the tool where the
machine's own kinematics do, and what they leave is as large as they say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.command import input_error
from support.exported import TableReader, machine_named, pose_of, read_table, readings_of
from support.generated_machines import HEAD
from support.machine_texts import machine_from
from truepose.arrays import Array
from truepose.models.leaves.export.write import export, render
from truepose.models.machine.machine import Machine

MILL = """  type: graph
  bodies: [base, saddle, column, ram, head]
  joints:
    - {name: X1, kind: prismatic, parent: base, child: saddle, xyz: [10, 20, 400], rpy: [0, 0.01, 0.02],
       axis: [1, 0.0002, -0.0001], actuated: true, range: [-400, 400]}
    - {name: Y1, kind: prismatic, parent: saddle, child: column, xyz: [0, 100, 0], rpy: [0.01, 0, 0.03],
       axis: [0.0003, 1, 0], actuated: true, range: [100, 500]}
    - {name: Z1, kind: prismatic, parent: column, child: ram, xyz: [0, 0, 200], axis: [0, 0.0001, -1],
       actuated: true, range: [0, 300]}
"""
HEADED = """    - {name: C1, kind: revolute, parent: ram, child: head, xyz: [0.01, 50.02, 30], axis: [0.0002, 0, 1],
       actuated: true, range: [-180, 180]}
"""
TOOL = (
    "frames: {base: {in: world, xyz: [1, 2, 3]}, tool: {in: flange, xyz: [80, 0, -150], rpy: [0, 10, 0]}}\n"
)
OWN = """effects:
  - {effect: actuator-scale, place: [X1], parameters: {s: {value: 8.0e-5, unit: "1"}}}
  - {effect: axis-straightness, place: [Y1], parameters: {z2: {value: 0.02, unit: mm}, rx1: {value: 3.0e-5, unit: rad}}}
"""
COUPLED = "  - {effect: axis-coupling, place: [C1, X1], parameters: {k: {value: 1.0e-6, unit: rad/mm}}}\n"


def mill(where: Path, *, head: bool = False, effects: str = "") -> Machine:
    bodies = MILL if head else MILL.replace(", head]", "]")
    return machine_from(where, HEAD.format(name="mill") + bodies + HEADED * head + TOOL + effects, "mill")


def scale_of(machine: Machine) -> Array:
    """Return what mm and deg of a table are in mm and rad."""
    return np.array([1.0 if a.unit == "mm" else np.pi / 180 for a in machine.mechanism.actuators])


def nodes(reader: TableReader, count: int, rng: np.random.Generator) -> Array:
    return np.array([[rng.choice(reader.rows[a][:, 0]) for a in reader.axes] for _ in range(count)])


@pytest.mark.parametrize("head", [False, True])
@pytest.mark.parametrize("effects", ["", OWN])
def test_at_its_positions_a_table_is_the_machine(tmp_path: Path, head: bool, effects: str) -> None:
    """Errors of single axes, straight or not, are held exactly, with the arms that the others give them."""
    machine = mill(tmp_path, head=head, effects=effects)
    export(machine, tmp_path / "mill.csv")
    reader, own_pose = read_table((tmp_path / "mill.csv").read_text()), pose_of(machine, effects=True)
    assert reader.axes == ["X", "Y", "Z", "C"][: 3 + head] and reader.reversed == {"Z"}
    assert reader.reference["Y"] == 300.0  # its range does not reach 0
    for readings in nodes(reader, 30, np.random.default_rng(2)):
        found, own = reader.pose(readings), own_pose(readings * scale_of(machine))
        # six decimals of um and urad on arms of a metre
        np.testing.assert_allclose(found[:3, 3], own[:3, 3], rtol=0, atol=5e-9)
        np.testing.assert_allclose(found[:3, :3], own[:3, :3], rtol=0, atol=5e-12)


def test_axes_are_moved_by_amounts_that_matter(tmp_path: Path) -> None:
    """The test above would not see an empty table otherwise."""
    reader = read_table(render(mill(tmp_path, effects=OWN), "iso230").text)
    assert np.ptp(reader.rows["X"][:, 1]) > 50.0  # um: 8e-5 of 800 mm
    assert np.ptp(reader.rows["Y"][:, 3]) > 10.0 and np.ptp(reader.rows["Y"][:, 4]) > 10.0


@pytest.mark.parametrize(("head", "effects"), [(True, OWN + COUPLED), (True, OWN), (True, "")])
def test_what_a_table_leaves_is_as_large_as_it_says(tmp_path: Path, head: bool, effects: str) -> None:
    machine = mill(tmp_path, head=head, effects=effects)
    done = render(machine, "iso230")
    reader, own_pose = read_table(done.text), pose_of(machine, effects=True)
    apart = [
        np.linalg.norm(reader.pose(q / scale_of(machine))[:3, 3] - own_pose(q)[:3, 3])
        for q in readings_of(machine, 300, seed=7)
    ]
    # the largest of 256 places is near that of 300 others, as both cover the same ranges
    assert done.lost == pytest.approx(np.max(apart), rel=0.25, abs=1e-9)
    assert f"leaves up to {done.lost:.3g} mm" in done.notes[0] and done.notes[0] in done.text
    if "axis-coupling" in effects:
        # the table turns about where axis C stands at the reference, the machine about where it is: 4e-4 rad over 200 mm of Y
        assert done.left_out["axis-coupling@C1+X1"] == pytest.approx(0.08, rel=0.1)
        assert "axis-coupling@C1+X1 (0.0" in done.notes[0]
    else:
        assert "axis-coupling" not in done.text


def test_squareness_is_the_angle_between_the_axes(tmp_path: Path) -> None:
    text = render(mill(tmp_path), "iso230").text
    told = {m[0]: float(m[1]) for m in re.findall(r"([ABC]0[XYZ]) \([XYZ] to [XYZ]\) (\S+) urad", text)}
    x = Rotation.from_euler("xyz", [0, 0.01, 0.02], degrees=True)
    y = x * Rotation.from_euler("xyz", [0.01, 0, 0.03], degrees=True)
    along = [
        r.apply(v) / np.linalg.norm(v)
        for r, v in ((x, [1, 2e-4, -1e-4]), (y, [3e-4, 1, 0]), (y, [0, -1e-4, 1]))
    ]
    expected = {"C0Y": -along[0] @ along[1], "B0Z": along[0] @ along[2], "A0Z": -along[1] @ along[2]}
    for name, value in expected.items():
        assert told[name] == pytest.approx(1e6 * value, abs=0.2)  # to the first order in angles of 1e-4


LINEAR = MILL.replace(", head]", "]").replace("\n       ", " ")
ACROSS = LINEAR.replace("axis: [0, 0.0001, -1]", "axis: [0, 0.5, -1]")
TWICE = LINEAR.replace("axis: [0.0003, 1, 0]", "axis: [1, 0, 0]")
OPEN = LINEAR.replace(", range: [0, 300]", "")


@pytest.mark.parametrize(
    ("name", "body", "message"),
    [
        ("arm", None, r"arm: found no linear axis \(joints q1, .*q6 all turn\), expected linear axes"),
        ("turns", None, r"found a mechanism with loops, expected one chain"),
        ("slanted", ACROSS, r"joint 'Z1': found the direction \(.*\) with all axes at their reference, expected one along"),
        ("twice", TWICE, r"found several axes X \(X1, Y1\), expected one of each letter"),
        ("open", OPEN, r"joint 'Z1': found no range"),
    ],
)  # fmt: skip
def test_machines_without_a_volumetric_table_are_refused(
    tmp_path: Path, name: str, body: str | None, message: str
) -> None:
    machine = machine_named(tmp_path, name, body and body + TOOL)
    with input_error(message):
        export(machine, tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()
