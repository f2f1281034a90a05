"""``truepose init``, from bundled machines and URDFs: files that load and accept filled recordings, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from support.command import refused, run
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.leaves.check.run import check_files
from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.models.file.names import SCHEMA_LINE
from truepose.models.leaves.starting.start import bundled_names
from truepose.models.leaves.starting.written import PRESETS
from truepose.models.load import load_machine


def filled(path: Path, rows: int = 4) -> Path:
    """The recording beside a machine file, with joints in the middle of their ranges and no readings."""
    machine, recording = load_machine(path), path.with_name(f"{path.stem}_recording.csv")
    header = recording.read_text().splitlines()[-1].split(",")
    rng = np.random.default_rng(0)
    middle = {a.reading: sum(a.range) / 2 if a.range else 0.0 for a in machine.mechanism.actuators}
    turn = {a.reading: 180 / np.pi if a.unit == "rad" else 1.0 for a in machine.mechanism.actuators}
    data = {n: turn[n] * (v + rng.uniform(-0.2, 0.2, rows)) for n, v in middle.items()}
    labels = {"placement": "A", "socket": ["1", "2"] * (rows // 2), "pose": range(1, rows + 1), "from": 1}
    frame = pd.DataFrame({**data, **{n: v for n, v in labels.items() if n in header}})
    frame.to_csv(recording, index=False)
    return recording


@pytest.mark.parametrize("name", bundled_names())
def test_what_it_writes_loads_and_its_recording_is_read_once_filled(tmp_path: Path, name: str) -> None:
    path = tmp_path / "m.yaml"
    run("init", "--arm", name, "-o", path)
    assert path.read_text().splitlines()[0] == SCHEMA_LINE
    machine = load_machine(path)
    lines = (tmp_path / "m_recording.csv").read_text().splitlines()
    expected = [*machine.mechanism.readings, *(c for s in machine.sensors for c in s.columns)]
    assert lines[-1].split(",") == expected
    assert all(line.startswith("# ") for line in lines[:-1])
    rows = load_recording(machine, [filled(path)], need_observations=False)
    made = pd.concat([pd.read_csv(tmp_path / "m_recording.csv"), simulate(machine, rows, seed=None)], axis=1)
    made[expected].to_csv(tmp_path / "full.csv", index=False)
    assert load_recording(machine, [tmp_path / "full.csv"]).n_sessions == 1


@pytest.mark.parametrize("sensor", PRESETS)
def test_every_sensor_can_be_chosen(tmp_path: Path, sensor: str) -> None:
    path = tmp_path / "m.yaml"
    run("init", "--arm", "ur5e", "--sensor", sensor, "-o", path)
    machine = load_machine(path)
    assert [s.type for s in machine.sensors] == [sensor]
    header = (tmp_path / "m_recording.csv").read_text().splitlines()[-1].split(",")
    wanted = {*machine.mechanism.readings, *machine.sensors[0].columns, *machine.sensors[0].label_columns}
    assert wanted <= set(header)
    load_recording(machine, [filled(path)], need_observations=False)
    tool = machine.geometry["tool.rx"].tolerance
    # unknown where readings show it, else as it stands
    assert np.isinf(tool) == (sensor in ("pose", "targets", "tilt"))


def test_encoders_stand_beside_a_tracker(tmp_path: Path) -> None:
    run("init", "--arm", "gantry", "--sensor", "position,angle", "-o", tmp_path / "m.yaml")
    machine = load_machine(tmp_path / "m.yaml")
    assert [s.type for s in machine.sensors] == ["position", "angle"]
    assert list(machine.sensors[1].joints.values()) == list(machine.mechanism.readings)
    assert np.isinf(machine.geometry["base.x"].tolerance)
    load_recording(machine, [filled(tmp_path / "m.yaml")], need_observations=False)
    refused(f"init --arm kr6 --sensor angle,angle -o {tmp_path}/b.yaml", said="found 'angle' twice")


@pytest.mark.parametrize(("arm", "axes"), [("equatorial", ("ha", "dec")), ("Alt-Az", ("az", "alt"))])
def test_a_mount_is_told_by_stars(tmp_path: Path, arm: str, axes: tuple[str, str]) -> None:
    """Stars of a mount whose axis is half a degree off, and whose encoders have their zeros elsewhere: check lets it pass."""
    path = tmp_path / "m.yaml"
    run("init", "--arm", arm, "-o", path)
    lines = (tmp_path / "m_recording.csv").read_text().splitlines()
    assert lines[-1] == ",".join([*axes, *(f"star.{axis}" for axis in axes)])
    machine = load_machine(path)
    rng = np.random.default_rng(1)
    q = np.column_stack([rng.uniform(-150, 150, 30), rng.uniform(0, 80, 30)])
    a, e = np.radians(q + np.array([3.0, -7.0])).T
    tube = np.column_stack([np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)])
    star = Rotation.from_euler("x", 0.5, degrees=True).apply(tube) + np.radians(
        5 / 3600
    ) * rng.standard_normal((30, 3))
    seen = {f"star.{axes[0]}": np.arctan2(-star[:, 1], star[:, 0]), f"star.{axes[1]}": np.arcsin(star[:, 2])}
    rows = pd.DataFrame(dict(zip(axes, q.T, strict=True)) | {name: np.degrees(v) for name, v in seen.items()})
    rows.to_csv(tmp_path / "stars.csv", index=False)
    assert check_files(path, [tmp_path / "stars.csv"])[0].verdict == "ok"
    fit = calibrate(machine, load_recording(machine, rows)).fit
    found = dict(zip(fit.prior.names, np.degrees(fit.p), strict=True))
    assert found["base.rx"] == pytest.approx(0.5, abs=0.01)
    assert [found[f"{axis}.offset"] for axis in axes] == pytest.approx([3.0, -7.0], abs=0.02)
    refused(f"init --arm kr6 --sensor star -o {tmp_path}/b.yaml", said="the two axes of a mount")


def test_base_and_tool_are_unknown_unless_told(tmp_path: Path) -> None:
    run("init", "--arm", "kr6", "-o", tmp_path / "a.yaml")
    run(f"init --arm kr6 --base 100,-20,5.5 --tool 0,0,120,0,90,0 -o {tmp_path}/b.yaml")
    unknown, told = load_machine(tmp_path / "a.yaml"), load_machine(tmp_path / "b.yaml")
    assert all(np.isinf(p.tolerance) for p in unknown.frames)
    assert not any(np.isinf(p.tolerance) for p in told.frames)
    geometry = {name: p.nominal for name, p in told.geometry.items()}
    assert [geometry[f"base.{axis}"] for axis in "xyz"] == [100, -20, 5.5]
    assert geometry["tool.ry"] == pytest.approx(np.pi / 2)


def test_a_gough_platform_stands_at_home(tmp_path: Path) -> None:
    run("init", "--arm", "gough", "-o", tmp_path / "m.yaml")
    machine = load_machine(tmp_path / "m.yaml")
    leg = np.sqrt((160.697 - 492.404) ** 2 + (191.511 - 86.824) ** 2 + 700.0**2)
    pd.DataFrame({f"q{k}": [leg] for k in range(1, 7)}).to_csv(tmp_path / "q.csv", index=False)
    rows = load_recording(machine, [tmp_path / "q.csv"], need_observations=False)
    read = simulate(machine, rows, seed=None).loc[0, ["x", "y", "z"]]
    np.testing.assert_allclose(read.to_numpy(float), [0, 0, 700], atol=1e-3)  # b to 1e-3 mm


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "found no source of the mechanism, expected --table, --urdf, --mjcf or --arm"),
        (("--arm", "ur5e", "--table", "a.csv"), "found --table and --arm, expected one of them"),
        (("--arm", "ur5e", "--convention", "standard"), "--convention: found it without --table"),
        (("--arm", "ur5e", "--sensor", "radar"), "--sensor: found 'radar', expected one of pose, position"),
        (("--arm", "ur5e", "--base", "1,2"), "--base: found '1,2', expected X,Y,Z or X,Y,Z,R,P,Y"),
        (("--arm", "ur5e", "--tool", "a,b,c"), "--tool: found 'a,b,c'"),
        (("--table", "nowhere.csv", "--convention", "standard"), "nowhere.csv: cannot read the table: No such file"),
        (("--urdf", "nowhere.urdf"), "nowhere.urdf: cannot read the URDF"),
    ],
)  # fmt: skip
def test_what_it_cannot_do_is_said_and_nothing_is_written(
    tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    refused("init", *words, "-o", tmp_path / "m.yaml", said=message)
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_there_are_kept(tmp_path: Path) -> None:
    path, recording = tmp_path / "m.yaml", tmp_path / "m_recording.csv"
    path.write_text("mine")
    recording.write_text("measured")
    refused("init", "--arm", "ur5e", "-o", path, said="found a file that is there already")
    assert path.read_text() == "mine"
    done = run("init", "--arm", "ur5e", "--force", "-o", path)
    assert "m_recording.csv: left as it stands" in done.output
    assert recording.read_text() == "measured"
    assert path.read_text().startswith(SCHEMA_LINE)
    refused(f"init --arm ur5e -o {tmp_path}/m.csv", said="expected a machine file that ends in .yaml")
    refused("init", "--arm", "ur5e", said="found no file to write")


def test_json_and_the_list(tmp_path: Path) -> None:
    listed = json.loads(run("init", "--list", "--json").output)["arms"]
    assert listed["panda"].startswith("Franka Emika Panda")
    assert "ur5e" in run("init", "--list").output
    said = json.loads(run("init", "--arm", "panda", "-o", tmp_path / "m.yaml", "--json").output)
    assert said["columns"][:2] == ["q1", "q2"]
    assert said["files"] == [str(tmp_path / "m.yaml"), str(tmp_path / "m_recording.csv")]


URDF = """<robot name="arm">
  <link name="floor"/> <link name="post"/> <link name="boom"/> <link name="tool0"/> <link name="camera"/>
  <joint name="q1" type="revolute"> <parent link="floor"/> <child link="post"/> <origin xyz="0 0 0.3"/>
    <axis xyz="0 0 1"/> <limit lower="-3" upper="3"/> </joint>
  <joint name="q2" type="prismatic"> <parent link="post"/> <child link="boom"/> <origin xyz="0.1 0 0" rpy="0 1.2 0"/>
    <axis xyz="0 0 1"/> <limit lower="0" upper="0.5"/> </joint>
  <joint name="plate" type="fixed"> <parent link="boom"/> <child link="tool0"/> <origin xyz="0 0 0.05"/> </joint>
</robot>
""".replace(' <link name="camera"/>', "")
HEAVY = URDF.replace('<link name="boom"/>', '<link name="boom"><inertial><mass value="3"/></inertial></link>')


def begun(folder: Path, urdf: str, *options: str) -> str:
    """Begin a machine file from a URDF; return what is said."""
    (folder / "arm.urdf").write_text(urdf)
    return run("init", "--urdf", folder / "arm.urdf", "-o", folder / "m.yaml", *options).output


def test_a_urdf_is_named_from_where_the_machine_file_stands(tmp_path: Path) -> None:
    (tmp_path / "urdf").mkdir()
    (tmp_path / "cell").mkdir()
    (tmp_path / "urdf" / "arm.urdf").write_text(HEAVY)
    path = tmp_path / "cell" / "m.yaml"
    run("init", "--urdf", tmp_path / "urdf" / "arm.urdf", "-o", path)
    assert "file: ../urdf/arm.urdf" in path.read_text()
    machine = load_machine(path)
    assert machine.mechanism.flange == "tool0"
    assert [mass.kg for mass in machine.masses] == [3.0]
    assert (tmp_path / "cell" / "m_recording.csv").read_text().splitlines()[-1] == "q1,q2,x,y,z,rx,ry,rz"


def test_a_urdf_written_out_is_the_same_machine(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(HEAVY)
    run("init", "--urdf", tmp_path / "arm.urdf", "-o", tmp_path / "a.yaml")
    run("init", "--urdf", tmp_path / "arm.urdf", "--expand", "-o", tmp_path / "b.yaml")
    named, out = load_machine(tmp_path / "a.yaml"), load_machine(tmp_path / "b.yaml")
    assert "mechanism:\n  type: graph\n" in (tmp_path / "b.yaml").read_text()
    assert named.masses == out.masses
    assert named.gravity == out.gravity
    for name, parameter in named.geometry.items():
        assert out.geometry[name].nominal == pytest.approx(parameter.nominal, abs=1e-9)


@pytest.mark.parametrize(
    ("urdf", "options", "message"),
    [
        (
            URDF.replace('type="prismatic"', 'type="fixed"').replace('type="revolute"', 'type="fixed"'),
            (),
            "no joint that moves",
        ),
        (URDF.replace('<link name="floor"/>', '<link name="floor"/><link name="sky"/>'), (), "root links floor, sky"),
        (URDF, ("--tip-link", "tol0"), "--urdf.tip_link: found 'tol0'"),
        ("<robot", (), "broken XML"),
    ],
)  # fmt: skip
def test_a_urdf_that_does_not_say_which_chain_is_refused(
    tmp_path: Path, urdf: str, options: tuple[str, ...], message: str
) -> None:
    (tmp_path / "arm.urdf").write_text(urdf)
    refused("init", "--urdf", tmp_path / "arm.urdf", *options, "-o", tmp_path / "m.yaml", said=message)
    assert not (tmp_path / "m.yaml").exists()


def extended(*more: str) -> str:
    """Return the URDF with further joints: ``parent child type``, and what a mimic joint follows."""
    text = ""
    for line in more:
        parent, child, kind, *led = line.split()
        follows = f'<mimic joint="{led[0]}"/>' if led else ""
        text += f'<link name="{child}"/><joint name="to_{child}" type="{kind}"><parent link="{parent}"/>'
        text += f'<child link="{child}"/>{follows}</joint>'
    return URDF.replace("</robot>", f"{text}</robot>")


@pytest.mark.parametrize(
    ("more", "ends"),
    [
        (("floor camera fixed",), ""),
        (("tool0 l prismatic", "tool0 r prismatic to_l"), ""),
        (("tool0 l prismatic", "tool0 r prismatic"), "l, r"),
        (("boom tcp fixed",), "tcp, tool0"),
        (("floor l revolute",), "l, tool0"),
        (("floor box floating", "box lid fixed"), ""),
    ],
)
def test_where_a_chain_ends_is_asked_and_never_guessed(
    tmp_path: Path, more: tuple[str, ...], ends: str
) -> None:
    """Links without joints beyond are ends where a driven joint leads to them and nothing that they follow stands aside."""
    (tmp_path / "arm.urdf").write_text(extended(*more))
    asked: tuple[object, ...] = ("init", "--urdf", tmp_path / "arm.urdf", "-o", tmp_path / "m.yaml")
    if ends:
        said = (
            f"found several ends of the chain from 'floor': {ends}, expected one: say which with --tip-link"
        )
        refused(*asked, said=said)
        asked = (*asked, "--tip-link", "tool0")
    run(*asked)
    assert load_machine(tmp_path / "m.yaml").mechanism.readings[:2] == ("q1", "q2")


@pytest.mark.parametrize("kind", ["floating", "planar"])
@pytest.mark.parametrize("base", ["floor", "base"])
def test_a_joint_of_no_chain_is_refused_by_its_name_and_kind(tmp_path: Path, kind: str, base: str) -> None:
    text = URDF.replace('link="floor"', f'link="{base}"').replace('name="floor"', f'name="{base}"')
    root = f'<link name="world"/><joint name="root" type="{kind}"><parent link="world"/><child link="{base}"/></joint>'
    (tmp_path / "arm.urdf").write_text(text.replace("</robot>", f"{root}</robot>"))
    asked = ("init", "--urdf", tmp_path / "arm.urdf", "-o", tmp_path / "m.yaml")
    said = refused(*asked, said=f"joint 'root': type: found '{kind}', expected revolute")
    assert f"at the link '{base}' (base_link, --base-link)" in said
    run(*asked, "--base-link", base)


def test_what_a_urdf_has_beyond_the_machine_is_listed(tmp_path: Path) -> None:
    """A base that the root carries fixed is the base."""
    text = extended("floor camera fixed").replace('"floor"', '"base"')
    root = '<link name="world"/><joint name="root" type="fixed"><parent link="world"/><child link="base"/></joint>'
    said = begun(tmp_path, text.replace("</robot>", f"<transmission/>{root}</robot>"))
    for words in (
        "links that are not on the way to the tip: camera, world",
        "elements that nothing reads: transmission",
    ):
        assert f"note: left out: {words}\n" in said
        assert f"# Left out: {words}\n" in (tmp_path / "m.yaml").read_text()
    assert load_machine(tmp_path / "m.yaml").mechanism.readings == ("q1", "q2")


@pytest.mark.parametrize("limit", ['<limit lower="-3" upper="3"/>', '<limit effort="1"/>', ""])
def test_joints_without_limits_are_read_and_listed(tmp_path: Path, limit: str) -> None:
    begun(tmp_path, URDF.replace('<limit lower="-3" upper="3"/>', limit))
    ranges = [actuator.range for actuator in load_machine(tmp_path / "m.yaml").mechanism.actuators]
    assert (ranges[0] is None) == ("lower" not in limit)
    listed = (
        "# CHECK joints without a range, which `plan` asks for: q1.\n" in (tmp_path / "m.yaml").read_text()
    )
    assert listed == ("lower" not in limit)


def test_a_urdf_without_masses_states_gravity(tmp_path: Path) -> None:
    begun(tmp_path, URDF)
    assert load_machine(tmp_path / "m.yaml").gravity == (0.0, 0.0, -9.80665)


def test_an_arm_is_fitted_with_a_base_and_a_tool_that_nobody_told(tmp_path: Path) -> None:
    """Readings of an arm that stands elsewhere, with another tool: the file as written finds both."""
    where = ("--base", "900,-400,150,5,-10,140", "--tool", "20,-30,140,0,0,0")
    run("init", "--arm", "irb120", "--sensor", "position", *where, "-o", tmp_path / "true.yaml")
    run("init", "--arm", "irb120", "--sensor", "position", "-o", tmp_path / "m.yaml")
    true, machine = load_machine(tmp_path / "true.yaml"), load_machine(tmp_path / "m.yaml")
    ranges = np.degrees([a.range or (-3, 3) for a in machine.mechanism.actuators])
    q = np.random.default_rng(2).uniform(0.8 * ranges[:, 0], 0.8 * ranges[:, 1], (60, 6))
    frame = pd.DataFrame(q, columns=list(machine.mechanism.readings))
    frame.to_csv(tmp_path / "q.csv", index=False)
    read = simulate(true, load_recording(true, [tmp_path / "q.csv"], need_observations=False), seed=1)
    pd.concat([frame, read], axis=1).to_csv(tmp_path / "rows.csv", index=False)
    fit = calibrate(machine, load_recording(machine, [tmp_path / "rows.csv"])).fit
    assert 0.7 < fit.chi2_per_dof < 1.3  # 2.6 sigma of 180 readings less 36 parameters
    found = dict(zip(fit.prior.names, fit.p, strict=True))
    assert abs(found["base.x"] - 900) < 1.5  # the first row's tolerances of 0.3 mm trade with it
