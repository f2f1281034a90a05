"""Exported machines read back: by this package, by a few lines of numpy, and what the formats cannot hold."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import truepose
from support.command import input_error, refused, run
from support.exported import (
    BRANCHED,
    EXTRA,
    MOUNTED,
    frame,
    machine_named,
    mujoco_module,
    pose_of,
    readings_of,
    urdf_pose,
)
from support.generated_machines import BODIES
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.export.links import text, xyz_rpy
from truepose.models.leaves.export.write import Exported, format_of, formats, render
from truepose.models.load import load_machine

SAME = 1e-9
"""mm, and mm on a reach of a metre: rounding of a dozen products is a thousandth of it."""


def same(a: Array, b: Array) -> None:
    np.testing.assert_allclose(a[:3, 3], b[:3, 3], rtol=0, atol=SAME)
    np.testing.assert_allclose(a[:3, :3], b[:3, :3], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["arm", *EXTRA])
def test_a_urdf_read_by_others_puts_the_tool_where_the_machine_does(tmp_path: Path, name: str) -> None:
    machine = machine_named(tmp_path, name)
    urdf = render(machine, "urdf").text
    own, seen = pose_of(machine), pose_of(machine, world=True)
    for q in readings_of(machine):
        same(urdf_pose(urdf, machine, q, "tool"), own(q))
        if '"world"' in urdf:
            same(urdf_pose(urdf, machine, q, "tool", "world"), seen(q))
    assert ('"world"' in urdf) == (name in EXTRA)


def test_an_arm_as_drawn_has_the_numbers_of_the_robots_own_description(tmp_path: Path) -> None:
    """UR10: ``config/ur10/default_kinematics.yaml`` of ur_description, whose wrist_3 is written (pi/2, pi, pi)."""
    rows = [(0, 0, 127.3), (90, 0, 0), (0, -612, 0), (0, -572.3, 163.941), (90, 0, 115.7), (-90, 0, 92.2)]
    joints = "".join(
        f"    - {{name: q{k}, kind: revolute, alpha: {a}, d: {d}, r: {r}}}\n"
        for k, (a, d, r) in enumerate(rows, 1)
    )
    machine = machine_named(tmp_path, "ur10", f"  type: serial\n  joints:\n{joints}")
    section = yaml.safe_load(render(machine, "ur-kinematics").text)["kinematics"]
    expected = {
        "shoulder": (0, 0, 0.1273, 0, 0, 0),
        "upper_arm": (0, 0, 0, np.pi / 2, 0, 0),
        "forearm": (-0.612, 0, 0, 0, 0, 0),
        "wrist_1": (-0.5723, 0, 0.163941, 0, 0, 0),
        "wrist_2": (0, -0.1157, 0, np.pi / 2, 0, 0),
        "wrist_3": (0, 0.0922, 0, np.pi / 2, np.pi, np.pi),
    }
    for link, values in expected.items():
        found = [section[link][f] for f in ("x", "y", "z", "roll", "pitch", "yaw")]
        np.testing.assert_allclose(
            frame(found[:3], found[3:]), frame(list(values[:3]), list(values[3:])), atol=1e-12
        )


def test_masses_stand_where_the_machine_has_them(tmp_path: Path) -> None:
    machine = machine_named(tmp_path, "branched")
    robot = ElementTree.fromstring(render(machine, "urdf").text)
    links = {link.get("name"): link.find("inertial") for link in robot.findall("link")}
    assert [name for name, inertial in links.items() if inertial is not None] == ["boom", "tool"]
    inertial = links["boom"]
    assert inertial is not None
    values = {element.tag: element.attrib for element in inertial}
    assert float(values["mass"]["value"]) == 4.0
    np.testing.assert_allclose(
        [float(v) for v in values["origin"]["xyz"].split()], [0.0, 0.015, 0.0225], atol=1e-15
    )
    # two points of 3 and 1 kg, d apart: reduced mass times the square of the distance across each axis
    d = np.array([0.04, 0.02, 0.03])
    reduced = 3.0 * 1.0 / 4.0
    assert float(values["inertia"]["ixx"]) == pytest.approx(reduced * (d[1] ** 2 + d[2] ** 2))
    assert float(values["inertia"]["ixy"]) == pytest.approx(-reduced * d[0] * d[1])


def test_masses_and_gravity_are_those_that_mujoco_reads(tmp_path: Path) -> None:
    model = mujoco_module().MjModel.from_xml_string(render(machine_named(tmp_path, "branched"), "mjcf").text)
    assert float(np.sum(model.body_mass)) == pytest.approx(4.5, abs=1e-5)
    np.testing.assert_allclose(np.linalg.norm(model.opt.gravity), 9.80665, rtol=1e-12)
    assert abs(model.opt.gravity[0]) > 0.1  # stated in the base's frame, which is tilted by 1 and 2 deg
    assert model.body("boom").mass[0] == pytest.approx(4.0, abs=1e-6)
    np.testing.assert_allclose(model.body("boom").ipos, [0.0, 0.015, 0.0225], atol=1e-12)


CONSTANT = """tolerances: {length: 0.1, angle: 0.1}
effects:
  - {effect: wrong-constant, place: [q2.d], parameters: {value: {value: 7.0, unit: mm}}}
  - {effect: zero-shift, place: [q1], parameters: {zero: {value: 0.5, unit: mm}}}
  - {effect: frame-shift, place: [tool], parameters: {x: {value: 0.2, unit: mm}, rz: {value: 0.01, unit: rad}}}
  - {effect: frame-shift, place: [base], parameters: {y: {value: 0.3, unit: mm}, rx: {value: 0.02, unit: rad}}}
"""


@pytest.mark.parametrize("name", ["mounted", "arm"])
def test_effects_that_are_constants_are_held(tmp_path: Path, name: str) -> None:
    body = (EXTRA | BODIES)[name].split("masses")[0]
    effects = CONSTANT if name == "mounted" else CONSTANT.replace("0.5, unit: mm", "0.005, unit: rad")
    machine = machine_named(tmp_path, "shifted", body + effects)
    done = render(machine, "urdf")
    assert done.left_out == {} and done.lost == 0.0
    assert [next(iter(drivers)) for drivers in done.frozen.values()] == 3 * ["session.after.1"]
    own = pose_of(machine, effects=True)
    for q in readings_of(machine):
        same(urdf_pose(done.text, machine, q, "tool"), own(q))
    if name == "arm":
        assert "Not held: wrist_3 to tool" in render(machine, "ur-kinematics").text


def test_what_is_left_out_is_said_with_its_size(tmp_path: Path) -> None:
    machine = machine_named(tmp_path, "arm")
    done = render(machine, "urdf")
    assert set(done.left_out) == {"actuator-scale@q4", "joint-compliance@q2"}
    assert done.frozen == {"thermal-expansion@link3": {"temperature.link3": 20.0}}
    own = pose_of(machine, effects=True)
    moved = [
        own(q)[:3, 3] - urdf_pose(done.text, machine, q, "tool")[:3, 3] for q in readings_of(machine, 200)
    ]
    # the largest of 64 poses is near that of 200 others, as both cover the same ranges
    assert done.lost == pytest.approx(np.max(np.linalg.norm(moved, axis=1)), rel=0.2)
    assert max(done.left_out.values()) > 0.5 * done.lost
    (left, frozen) = done.notes
    assert re.search(r"leaves out: actuator-scale@q4 \([\d.]+ mm\), .* together up to [\d.]+ mm", left)
    assert "temperature.link3 = 20" in frozen
    for note in done.notes:
        assert note in done.text
    assert all(
        f"# {note}\n" in render(machine, "ur-kinematics").text
        for note in render(machine, "ur-kinematics").notes
    )


FORMATS = [("scara", "urdf"), ("arm", "ur-kinematics"), ("mounted", "iso230"), ("branched", "mjcf")]


@pytest.mark.parametrize(("name", "format"), FORMATS)
def test_tools_of_single_recordings_are_said_to_be_left_out(name: str, format: str, tmp_path: Path) -> None:
    own = "recordings: {long: {files: tues*.csv, tool: {in: tool, xyz: [0, 0, 50]}}}\n"
    body = (BODIES | EXTRA)[name].partition("drivers:")[0]
    done = render(machine_named(tmp_path, "tools", body + own), format)
    assert done.frozen == {"recordings.long.tool": {"recording.long": 0.0}}
    assert "recordings.long.tool (recording.long = 0)" in done.notes[-1] and done.notes[-1] in done.text


@pytest.mark.parametrize(("name", "format"), FORMATS)
@pytest.mark.parametrize("tau", [0.0, 1e4])
def test_a_drift_is_held_at_its_start(name: str, format: str, tau: float, tmp_path: Path) -> None:
    """Where the clock's zero lies moves no link: a rate counted from 1970 moved tools by metres, a settling without bounds."""
    body, unit = (BODIES | EXTRA)[name].partition("drivers:")[0], "mm" if tau else "mm/h"

    def drifting(start: float) -> Exported:
        entry = f"effect: mount-drift, place: [tool], tau: {tau}, start: {start:.0f}"
        entry += f", parameters: {{x: {{value: 0.1, unit: {unit}}}}}"
        return render(machine_named(tmp_path, "late", f"{body}effects:\n  - {{{entry}}}\n"), format)

    begun, later = drifting(0), drifting(1.8e9)
    assert [*later.frozen.values()] == [{"time": 1.8e9}]
    text = begun.text.replace("(time = 0)", "(time = 1800000000)").replace("start=0", "start=1.8e+09")
    assert later.text == text


def test_names_that_are_taken_are_not_taken_again(tmp_path: Path) -> None:
    names = {"hand": "tool", "camera": "flange", "column": "world", "mount": "tool_joint"}
    body = EXTRA["branched"].split("masses")[0] + MOUNTED
    for old, new in names.items():
        body = re.sub(rf"\b{old}\b", new, body)
    machine = machine_named(tmp_path, "taken", body)
    urdf = render(machine, "urdf").text
    robot = ElementTree.fromstring(urdf)
    for kind in ("link", "joint"):
        found = [element.get("name") for element in robot.findall(kind)]
        assert len(set(found)) == len(found)
    own = pose_of(machine)
    for q in readings_of(machine, 3):
        same(urdf_pose(urdf, machine, q, "tool_"), own(q))


def test_the_same_machine_gives_the_same_bytes(tmp_path: Path) -> None:
    machine = machine_named(tmp_path, "arm")
    for file in ("a.urdf", "a.yaml"):
        truepose.export(machine, tmp_path / file)
        first = (tmp_path / file).read_bytes()
        truepose.export(load_machine(tmp_path / "arm.yaml"), tmp_path / file)
        assert (tmp_path / file).read_bytes() == first
    one = yaml.safe_load(render(machine, "ur-kinematics").text)["kinematics"]["hash"]
    assert re.fullmatch(r"calib_\d+", one)
    other = machine_named(tmp_path, "arm2", BODIES["arm"].replace("128.1", "128.2"))
    assert yaml.safe_load(render(other, "ur-kinematics").text)["kinematics"]["hash"] != one


@pytest.mark.parametrize(
    ("name", "file", "message"),
    [
        ("turns", "out.urdf", r"turns: found loops, closed by leg1, .*leg6, expected an open machine: URDF holds trees"),
        ("hybrid", "out.yaml", r"expected an open machine: ur-kinematics holds trees only"),
        ("redundant", "out.yaml", r"found joints q1 \(revolute\), .*q7.*expected one chain of six revolute joints"),
        ("loose", "out.urdf", r"joint 'look': found a revolute joint that nothing drives"),
        ("formula", "out.urdf", r"joint 'look': found a joint that a formula moves"),
        ("arm", "out.txt", r"found the suffix '\.txt', expected \.csv, \.xml, \.yaml, .*--format iso230\|mjcf\|"),
        ("arm", "arm.yaml", r"found the machine file itself"),
    ],
)  # fmt: skip
def test_what_a_format_cannot_hold_is_refused(tmp_path: Path, name: str, file: str, message: str) -> None:
    led = {"loose": "", "formula": ", computed: pan * 2"}
    body = BRANCHED.replace(", actuated: true, range: [-90, 90]", led[name]) if name in led else None
    machine = machine_named(tmp_path, name, body)
    before = sorted(path.read_bytes() for path in tmp_path.iterdir())
    with input_error(message):
        truepose.export(machine, tmp_path / file)
    assert sorted(path.read_bytes() for path in tmp_path.iterdir()) == before


def test_the_command_writes_says_and_refuses(tmp_path: Path) -> None:
    machine_named(tmp_path, "arm")
    source, out = tmp_path / "arm.yaml", tmp_path / "arm.xml"
    done = run("export", source, "-o", out, "--format", "urdf")
    assert done.stdout == f"{out}\n"
    assert [line.split(":")[0] for line in done.stderr.splitlines()] == ["note", "note"]
    assert out.read_text() == render(load_machine(source), "urdf").text
    spoken = run("export", source, "-o", tmp_path / "k.yaml", "--json")
    said = json.loads(spoken.stdout)
    assert said["format"] == "ur-kinematics" and said["left_out"]["joint-compliance@q2"]["unit"] == "mm"
    assert len(said["notes"]) == 2 and spoken.stderr == ""
    refused("export", source, "-o", tmp_path / "k.mdh", said="error: ")


NUMBERS = ", ".join(f"{field} (\\S+)" for field in ("x", "y", "z", "roll", "pitch", "yaw"))


def told(text: str, what: str) -> Array | None:
    """(4, 4) mm of a frame in the comments, None where they do not name it."""
    found = re.search(f"^# Not held: {what}: {NUMBERS}$", text, re.M)
    if found is None:
        return None
    values = np.array([float(v) for v in found.groups()])
    return frame(values[:3], values[3:])


def test_flange_tool_and_world_stand_in_the_comments_if_the_file_does_not_hold_them(tmp_path: Path) -> None:
    """Where the last joint's frame cannot be the flange's, the comments lead to both: from one to the other is the tool."""
    text = render(machine_named(tmp_path, "tilted"), "ur-kinematics").text
    flange, tool, base = (
        told(text, what) for what in ("wrist_3 to flange", "wrist_3 to tool", "world to base")
    )
    assert flange is not None and tool is not None and base is not None
    np.testing.assert_allclose(tool, flange @ frame([0.003, 0.004, 0.05], [0, 0, 0]), atol=1e-9)
    np.testing.assert_allclose(base, frame([0.04, -0.003, 0.7], np.radians([1, 2, 30])), atol=1e-9)
    assert told(render(machine_named(tmp_path, "arm"), "ur-kinematics").text, "wrist_3 to flange") is None


@pytest.mark.parametrize("pitch", [90.0, -90.0, 89.99999999, 0.0, 180.0])
def test_roll_pitch_and_yaw_lose_no_digit(pitch: float) -> None:
    rng = np.random.default_rng(2)
    for roll, yaw in rng.uniform(-np.pi, np.pi, (20, 2)):
        rotation = Rotation.from_euler("xyz", [roll, np.radians(pitch), yaw]).as_matrix()
        given = np.eye(4)
        given[:3, :3] = rotation
        np.testing.assert_allclose(frame(*xyz_rpy(given))[:3, :3], rotation, rtol=0, atol=2e-15)


def test_numbers_read_back_the_same() -> None:
    values = np.random.default_rng(3).standard_normal(100) * 10.0 ** np.arange(-50, 50)
    assert [float(word) for word in text(*values.tolist()).split()] == values.tolist()
    assert text(0.0, 1.0, -2.5) == "0 1 -2.5"


def test_a_suffix_of_two_formats_is_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formats.get("mjcf", ""), "suffixes", (".csv",))
    with pytest.raises(InputError, match=r"suffix of iso230 and mjcf, expected --format"):
        format_of("arm.csv", None)
    assert format_of("arm.csv", "iso230") == "iso230"
