"""Exported machines read back: by this package, by a few lines of numpy, and what the formats cannot hold."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from typer.testing import CliRunner

import truepose
from support.exported import BRANCHED, EXTRA, MOUNTED, frame, mujoco_module, urdf_pose
from support.generated_machines import BODIES, HEAD, machine_of
from truepose.cli import app
from truepose.errors import InputError
from truepose.models.leaves.export.write import Exported, render
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
SAME = 1e-9
"""mm, and mm on a reach of a metre: rounding of a dozen products is a thousandth of it."""


def written(where: Path, name: str, body: str | None = None) -> Machine:
    if body is None and name in BODIES:
        return machine_of(where, name)
    file = where / f"{name}.yaml"
    file.write_text(HEAD.format(name=name) + (body or EXTRA[name]))
    return load_machine(file)


def readings_of(machine: Machine, count: int = 20) -> list[dict[str, float]]:
    """Random readings, mm and rad: within ranges where there are some."""
    rng = np.random.default_rng(4)
    actuators = machine.mechanism.actuators
    limits = [a.range or ((-3.0, 3.0) if a.unit == "rad" else (-200.0, 200.0)) for a in actuators]
    low, high = np.transpose(limits)
    rows = rng.uniform(low, high, (count, len(low))).tolist()
    return [dict(zip(machine.mechanism.readings, row, strict=True)) for row in rows]


def pose_of(
    machine: Machine, *, world: bool = False, effects: bool = False
) -> Callable[[dict[str, float]], Array]:
    """Tool in the base's or the sensor's frame, from the machine's own expressions, drivers at their defaults."""
    model = symbolic_model(machine, machine.effects if effects else ())
    at = ca.Function("pose", [model.q, model.z, model.p], [model.world if world else model.pose])
    fixed = (model.z_home, model.p_home)
    return lambda readings: np.array(at([readings[name] for name in model.readings], *fixed))


def same(a: Array, b: Array) -> None:
    np.testing.assert_allclose(a[:3, 3], b[:3, 3], rtol=0, atol=SAME)
    np.testing.assert_allclose(a[:3, :3], b[:3, :3], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["arm", *EXTRA])
def test_a_urdf_read_by_others_puts_the_tool_where_the_machine_does(tmp_path: Path, name: str) -> None:
    machine = written(tmp_path, name)
    urdf = render(machine, "urdf").text
    own, seen = pose_of(machine), pose_of(machine, world=True)
    for readings in readings_of(machine):
        same(urdf_pose(urdf, readings, "tool", "base"), own(readings))
        if '"world"' in urdf:
            same(urdf_pose(urdf, readings, "tool", "world"), seen(readings))
    assert ('"world"' in urdf) == (name in EXTRA)


def test_an_arm_as_drawn_has_the_numbers_of_the_robots_own_description(tmp_path: Path) -> None:
    """UR10: ``config/ur10/default_kinematics.yaml`` of ur_description, whose wrist_3 is written (pi/2, pi, pi)."""
    rows = [(0, 0, 127.3), (90, 0, 0), (0, -612, 0), (0, -572.3, 163.941), (90, 0, 115.7), (-90, 0, 92.2)]
    joints = "".join(
        f"    - {{name: q{k}, kind: revolute, alpha: {a}, d: {d}, r: {r}}}\n"
        for k, (a, d, r) in enumerate(rows, 1)
    )
    machine = written(tmp_path, "ur10", f"  type: serial\n  joints:\n{joints}")
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
    machine = written(tmp_path, "branched")
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
    model = mujoco_module().MjModel.from_xml_string(render(written(tmp_path, "branched"), "mjcf").text)
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
    machine = written(tmp_path, "shifted", body + effects)
    done = render(machine, "urdf")
    assert done.left_out == {} and done.lost == 0.0
    assert [next(iter(drivers)) for drivers in done.frozen.values()] == 3 * ["session.after.1"]
    own = pose_of(machine, effects=True)
    for readings in readings_of(machine):
        same(urdf_pose(done.text, readings, "tool", "base"), own(readings))
    if name == "arm":
        assert "Not held: wrist_3 to tool" in render(machine, "ur-kinematics").text


def test_what_is_left_out_is_said_with_its_size(tmp_path: Path) -> None:
    machine = written(tmp_path, "arm")
    done = render(machine, "urdf")
    assert set(done.left_out) == {"actuator-scale@q4", "joint-compliance@q2"}
    assert done.frozen == {"thermal-expansion@link3": {"temperature.link3": 20.0}}
    own = pose_of(machine, effects=True)
    moved = [
        own(r)[:3, 3] - urdf_pose(done.text, r, "tool", "base")[:3, 3] for r in readings_of(machine, 200)
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
    done = render(written(tmp_path, "tools", body + own), format)
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
        return render(written(tmp_path, "late", f"{body}effects:\n  - {{{entry}}}\n"), format)

    begun, later = drifting(0), drifting(1.8e9)
    assert [*later.frozen.values()] == [{"time": 1.8e9}]
    text = begun.text.replace("(time = 0)", "(time = 1800000000)").replace("start=0", "start=1.8e+09")
    assert later.text == text


def test_a_note_names_the_largest_and_the_file_all(tmp_path: Path) -> None:
    entries = [
        f"  - {{effect: transmission-error, place: [q{k}], order: {n}, parameters: "
        f"{{a: {{value: {0.0001 * k * n}, unit: rad}}}}}}\n"
        for k in (1, 2, 3, 4)
        for n in (1, 2)
    ]
    body = BODIES["arm"].split("masses")[0] + "effects:\n" + "".join(entries)
    done = render(written(tmp_path, "many", body), "urdf")
    assert len(done.left_out) == 8
    (note,) = done.notes
    assert "and 3 more; together" in note
    sizes = [float(size) for size in re.findall(r"\(([\d.]+) mm\)", note)]
    assert len(sizes) == 5 and sizes == sorted(sizes, reverse=True)
    assert all(label in done.text for label in done.left_out)


def test_names_that_are_taken_are_not_taken_again(tmp_path: Path) -> None:
    names = {"hand": "tool", "camera": "flange", "column": "world", "mount": "tool_joint"}
    body = EXTRA["branched"].split("masses")[0] + MOUNTED
    for old, new in names.items():
        body = re.sub(rf"\b{old}\b", new, body)
    machine = written(tmp_path, "taken", body)
    urdf = render(machine, "urdf").text
    robot = ElementTree.fromstring(urdf)
    for kind in ("link", "joint"):
        found = [element.get("name") for element in robot.findall(kind)]
        assert len(set(found)) == len(found)
    own = pose_of(machine)
    for readings in readings_of(machine, 3):
        same(urdf_pose(urdf, readings, "tool_", "base"), own(readings))


def test_the_same_machine_gives_the_same_bytes(tmp_path: Path) -> None:
    machine = written(tmp_path, "arm")
    for file in ("a.urdf", "a.yaml"):
        truepose.export(machine, tmp_path / file)
        first = (tmp_path / file).read_bytes()
        truepose.export(load_machine(tmp_path / "arm.yaml"), tmp_path / file)
        assert (tmp_path / file).read_bytes() == first
    one = yaml.safe_load(render(machine, "ur-kinematics").text)["kinematics"]["hash"]
    assert re.fullmatch(r"calib_\d+", one)
    other = written(tmp_path, "arm2", BODIES["arm"].replace("128.1", "128.2"))
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
    machine = written(tmp_path, name, body)
    before = sorted(path.read_bytes() for path in tmp_path.iterdir())
    with pytest.raises(InputError, match=message):
        truepose.export(machine, tmp_path / file)
    assert sorted(path.read_bytes() for path in tmp_path.iterdir()) == before


def test_the_command_writes_says_and_refuses(tmp_path: Path) -> None:
    written(tmp_path, "arm")
    source, out = str(tmp_path / "arm.yaml"), tmp_path / "arm.xml"
    done = CliRunner().invoke(app, ["export", source, "-o", str(out), "--format", "urdf"])
    assert done.exit_code == 0
    assert done.stdout == f"{out}\n"
    assert [line.split(":")[0] for line in done.stderr.splitlines()] == ["note", "note"]
    assert out.read_text() == render(load_machine(source), "urdf").text
    spoken = CliRunner().invoke(app, ["export", source, "-o", str(tmp_path / "k.yaml"), "--json"])
    said = json.loads(spoken.stdout)
    assert said["format"] == "ur-kinematics" and said["left_out"]["joint-compliance@q2"]["unit"] == "mm"
    assert len(said["notes"]) == 2 and spoken.stderr == ""
    wrong = CliRunner().invoke(app, ["export", source, "-o", str(tmp_path / "k.mdh")])
    assert wrong.exit_code == 2
    assert wrong.stderr.startswith("error: ") and len(wrong.stderr.splitlines()) == 1
