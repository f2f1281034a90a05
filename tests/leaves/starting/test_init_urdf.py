"""Machines begun from a URDF: which chain, what is listed, what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.command import refused, run
from truepose.models.load import load_machine

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
