"""Loops, coupled joints, actuators and free bodies of an MJCF: the machine stands where MuJoCo's own constraints put it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.command import input_error
from support.described_machines import mjcf_machine
from support.examples import examples
from support.exported import closed_in_mujoco, mujoco_module, site_pose
from truepose.arrays import Array
from truepose.identification.compensation.inverse import PoseSolver
from truepose.models.leaves.starting.mjcf import mjcf_start
from truepose.models.machine.machine import Machine

mujoco = mujoco_module()
HEAD = '<mujoco><compiler angle="degree" autolimits="true"/><default><geom type="sphere" size="0.02"/></default><worldbody>'
LEFT = """<body name="c1" pos="-0.1 0 0.3" euler="0 0 120"> <joint name="a1" ref="30" range="-60 90"/> <geom/>
  <body name="r1" pos="0.15 0 0" euler="0 0 -75"> <joint name="e1"/> <geom/>
    <body name="pen" pos="{x:.17g} {y:.17g} 0"> <geom/> <site name="tip"/> </body> </body> </body>"""
RIGHT = """<body name="c2" pos="0.1 0 0.3" euler="0 0 60"> <joint name="a2"/> <geom/>
  <body name="r2" pos="0.15 0 0" euler="0 0 75"> <joint name="e2"/> <geom/> <site name="end" pos="0.25 0 0"/> {end}
  </body> </body>"""
DRIVES = '<actuator> <position joint="a1"/> <motor joint="a2"/> </actuator>'
END = '<body name="end" pos="0.25 0 0"> <joint name="e3" pos="0 0 0"/> <geom/> </body>'


def five_bar(equality: str, *, end: str = "", more: str = "", drives: str = DRIVES) -> str:
    """Return five bars in a plane, open at the pen, whose place on the left arm is that of the right arm's end."""
    bodies = [two_joints(-0.1, 120.0, -75.0), two_joints(0.1, 60.0, 75.0)]
    x, y = (np.linalg.inv(bodies[0]) @ bodies[1] @ [0.25, 0.0, 0.0, 1.0])[:2]
    world = LEFT.format(x=x, y=y) + RIGHT.format(end=end)
    return f"{HEAD}{world}{more}</worldbody><equality>{equality}</equality>{drives}</mujoco>"


def two_joints(x: float, first: float, second: float) -> Array:
    """Return the frame (4, 4) m of the second bar of an arm that stands at x."""
    out = np.eye(4)
    for at, turn in ((x, first), (0.15, second)):
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        step = np.array([[c, -s, 0, at], [s, c, 0, 0], [0, 0, 1, 0.3 if at == x else 0.0], [0, 0, 0, 1]])
        out = out @ step
    return out


def check_stands(machine: Machine, xml: str, base: str, tip: str, spread: float = 0.3) -> None:
    """Compare the tip in the base with MuJoCo's, at readings up to ``spread`` (rad, or hundreds of mm) from the file's pose."""
    model = mujoco.MjModel.from_xml_string(xml)
    solver = PoseSolver(machine)
    units = np.array([100.0 if a.unit == "mm" else 1.0 for a in machine.mechanism.actuators])
    home = np.array(
        [model.qpos0[model.joint(name).qposadr[0]] for name in machine.mechanism.readings], dtype=float
    ) * np.where(units > 1.0, 1000.0, 1.0)
    rows = home + spread * units * np.random.default_rng(5).uniform(-1.0, 1.0, (6, len(home)))
    poses, good = solver.forward(np.vstack([home, rows]))
    assert good.all()
    for q, pose in zip([home, *rows], poses, strict=True):
        data = closed_in_mujoco(model, machine, q)
        expected = np.linalg.inv(site_pose(data.body(base))) @ site_pose(data.body(tip))
        np.testing.assert_allclose(pose, expected, atol=1e-8)
    assert np.ptp(poses, axis=0).max() > 0.1


@pytest.mark.parametrize(
    ("equality", "end"),
    [
        ('<connect body1="r2" body2="pen" anchor="0.25 0 0"/>', ""),
        ('<connect name="a1" body1="pen" body2="r2" anchor="0 0 0"/>', ""),
        ('<connect site1="tip" site2="end"/>', ""),
        ('<weld body1="end" body2="pen"/>', END),
        ('<weld site1="tip" site2="tail"/>', END.replace("<geom/>", '<geom/> <site name="tail"/>')),
    ],
    ids=["connect", "connect from the pen", "connected sites", "weld", "welded sites"],
)
def test_a_loop_stays_closed(tmp_path: Path, equality: str, end: str) -> None:
    """Whatever constraint closes it; driven are the joints with an actuator, and the tip may be any body of the loop."""
    xml = five_bar(equality, end=end)
    for tip in ("pen", "r1", "c2"):
        machine = mjcf_machine(tmp_path, xml, "--tip", tip)
        assert machine.mechanism.readings == ("a1", "a2")
        assert machine.mechanism.closing
        check_stands(machine, xml, "world", tip)
    assert machine.mechanism.actuators[0].range == pytest.approx(np.radians([-60, 90]))


def test_a_free_body_hangs_on_its_ties(tmp_path: Path) -> None:
    """A plate that three struts carry; what nothing holds, a box on the floor, is left out and said."""
    struts = "".join(
        f'<body name="s{k}" pos="{0.3 * np.cos(2.1 * k):.6f} {0.3 * np.sin(2.1 * k):.6f} 0">'
        f'<joint name="t{k}" axis="{-np.sin(2.1 * k):.6f} {np.cos(2.1 * k):.6f} 0"/> <geom/>'
        f'<body name="u{k}" pos="0 0 0.1"> <joint name="z{k}" type="slide" axis="0 0 1"/> <geom/> </body> </body>'
        for k in range(3)
    )
    ties = "".join(f'<connect body1="u{k}" body2="plate" anchor="0 0 0.2"/>' for k in range(3))
    drives = "<actuator>" + "".join(f'<motor joint="z{k}"/>' for k in range(3)) + "</actuator>"
    free = "".join(
        f'<body name="{n}" pos="{at}"> <freejoint/> <geom/> </body>'
        for n, at in {"plate": "0 0 0.3", "box": "1 0 0"}.items()
    )
    xml = f"{HEAD}{struts}{free}</worldbody><equality>{ties}</equality>{drives}</mujoco>"
    machine = mjcf_machine(tmp_path, xml, "--tip", "plate")
    assert machine.mechanism.readings == ("z0", "z1", "z2")
    assert "# Left out: bodies that are not on the way to the tip: box\n" in (tmp_path / "m.yaml").read_text()
    check_stands(machine, xml, "world", "plate")


COUPLED = """<body name="post" pos="0 0 0.2"> <joint name="a" axis="0 1 0" ref="10"/> <geom/>
  <body name="slide" pos="0.3 0 0.1"> <joint name="b" type="{kind}" axis="1 0 0.2" ref="{ref}" pos="0.01 0 0"/> <geom/>
    <body name="hand" pos="0 0.1 0"> <joint name="c" axis="0 0 1"/> <geom/> </body> </body> </body>"""


@settings(max_examples=examples(12))
@given(
    kind=st.sampled_from(["slide", "hinge"]),
    lead=st.sampled_from(["a", "c", ""]),
    driven=st.sampled_from(["lead", "joint", "none"]),
    shift=st.floats(-0.1, 0.1),
    slope=st.floats(0.2, 2.0),
    further=st.booleans(),
)
def test_a_coupled_joint_follows(
    tmp_path_factory: pytest.TempPathFactory,
    kind: str, lead: str, driven: str, shift: float, slope: float, further: bool,
) -> None:  # fmt: skip
    """By a line of another one, whichever of both is driven; one that is held at a constant does not move at all."""
    world = COUPLED.format(kind=kind, ref=0.05 if kind == "slide" else 5.0)
    slope *= 0.1 if kind == "slide" and driven != "joint" else 1.0
    second = f'joint2="{lead}"' if lead else ""
    other = {"a": "c", "c": "a", "": "a"}[lead]
    equality = f'<joint joint1="b" {second} polycoef="{shift} {slope} 0 0 0"/>'
    chained = further and lead != ""
    equality += f'<joint joint1="{other}" joint2="b" polycoef="0.01 {0.5} 0 0 0"/>' if chained else ""
    motors = {"lead": [lead, other], "joint": ["b", other], "none": []}[driven if lead else "none"]
    drives = "".join(f'<motor joint="{name}"/>' for name in motors if not (chained and name == other))
    drives = f"<actuator>{drives}</actuator>" if drives else ""
    xml = f"{HEAD}{world}</worldbody><equality>{equality}</equality>{drives}</mujoco>"
    folder = tmp_path_factory.mktemp("coupled")
    machine = mjcf_machine(folder, xml)
    expected = {"b" if driven == "joint" and lead else lead or "c", other} - ({other} if chained else set())
    assert set(machine.mechanism.readings) == expected
    check_stands(machine, xml, "world", "hand", 0.2)


def test_a_floating_base_is_the_base(tmp_path: Path) -> None:
    """Its free joint is left out and said: where it stands is the base's frame. Gravity is that of the file's pose."""
    world = COUPLED.format(kind="hinge", ref=0)
    xml = f'{HEAD}<body name="torso" pos="1 2 3" euler="90 0 0"> <freejoint/> <geom/> {world}</body></worldbody></mujoco>'
    machine = mjcf_machine(tmp_path, xml)
    assert machine.mechanism.readings == ("a", "b", "c")
    assert machine.gravity == pytest.approx((0.0, -9.81, 0.0))
    text = " ".join((tmp_path / "m.yaml").read_text().replace("#  ", "").split())
    assert "Left out: the free joint of the body 'torso', which is the base" in text
    check_stands(machine, xml, "torso", "hand")


def test_joints_without_an_actuator_are_listed(tmp_path: Path) -> None:
    world = COUPLED.format(kind="hinge", ref=0)
    xml = f'{HEAD}{world}</worldbody><actuator><motor joint="a"/></actuator></mujoco>'
    assert mjcf_machine(tmp_path, xml).mechanism.readings == ("a", "b", "c")
    told = "# CHECK joints without an actuator and outside loops, taken as read by the recording: b, c.\n"
    assert told in (tmp_path / "m.yaml").read_text()


def test_what_no_machine_holds_is_listed(tmp_path: Path) -> None:
    """Tendons, a body that a user's hand leads, what is switched off, and what concerns other bodies."""
    more = """<body name="lead" mocap="true"/> <body name="flag"> <joint name="f"/> <geom/> </body>
      <body name="g"> <joint name="h"/> <geom/> </body>"""
    equality = """<weld body1="lead" body2="hand"/> <connect name="off" body1="hand" anchor="0 0 0" active="false"/>
      <joint name="flags" joint1="f" joint2="h"/> <tendon name="pull" tendon1="t1" tendon2="t2"/>"""
    tendons = """<tendon> <fixed name="t1"> <joint joint="a" coef="1"/> </fixed> <fixed name="t2"> <joint joint="b" coef="1"/>
      </fixed> </tendon>
      <actuator> <motor joint="a"/> <motor joint="b"/> <motor joint="c"/> <motor name="rope" tendon="t1"/> </actuator>"""
    world = COUPLED.format(kind="hinge", ref=0)
    xml = f"{HEAD}{world}{more}</worldbody><equality>{equality}</equality>{tendons}</mujoco>"
    machine = mjcf_machine(tmp_path, xml, "--tip", "hand")
    assert machine.mechanism.readings == ("a", "b", "c")
    text = " ".join((tmp_path / "m.yaml").read_text().replace("#  ", "").split())
    for told in (
        "bodies that are not on the way to the tip: lead, flag, g",
        "equality constraints that move none of these: of joint 'f'",
        "equality 'equality1', which the mocap body 'lead' leads",
        "equality 'off', which is not active",
        "equality 'pull', which is of kind tendon",
        "actuator 'rope', which drives no single joint",
    ):
        assert told in text


def coupled(equality: str) -> str:
    world = COUPLED.format(kind="hinge", ref=0)
    return f"{HEAD}{world}</worldbody><equality>{equality}</equality></mujoco>"


POLYNOMIAL = '<joint joint1="b" joint2="a" polycoef="0 1 0.3 0 0"/>'
CONNECT = '<connect body1="r2" body2="pen" anchor="0.25 0 0"/>'


@pytest.mark.parametrize(
    ("xml", "tip", "message"),
    [
        (
            coupled(POLYNOMIAL),
            "",
            "equality of joint 'b': found the polynomial 0 1 0.3 0 0 .*of 'a', expected a linear one",
        ),
        (
            coupled(POLYNOMIAL.replace("0.3", "0") + '<joint joint1="b" joint2="c"/>'),
            "",
            "equality of joint 'b': found a second one",
        ),
        (
            coupled(POLYNOMIAL.replace("0.3", "0") + '<joint joint1="a" joint2="b"/>'),
            "",
            "found that it follows '.', which follows itself",
        ),
        (five_bar(CONNECT), "", "several ends of a chain: pen, r2 .*expected one: say which with --tip"),
        (five_bar(CONNECT, drives=""), "pen", "closed by the equality constraints 'equality1', and no actuator"),
        (
            five_bar(CONNECT, drives='<actuator><motor joint="a1"/></actuator>').replace(
                "</equality>", '<joint joint1="e1" joint2="a2"/></equality>'
            ),
            "pen",
            "equality of joint 'e1': found 'a2', which no actuator drives",
        ),
    ],
)  # fmt: skip
def test_what_is_no_machine_is_refused_by_name(tmp_path: Path, xml: str, tip: str, message: str) -> None:
    (tmp_path / "m.xml").write_text(xml, encoding="utf-8")
    with input_error(message):
        mjcf_start(tmp_path / "m.xml", tip)
