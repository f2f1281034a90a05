"""What is found in programs as people and controllers write them, what is left as it is, and why."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner, Result

from support.program_robots import arms, joints, machine_file, quadrants, status_turn
from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.programs.dialects import DIALECTS
from truepose.identification.programs.program import Program
from truepose.models.load import load_machine
from truepose.models.machine import Machine

DRAWN, REAL = arms()
DAT = """&ACCESS RVP
DEFDAT  WELD
;FOLD EXTERNAL DECLARATIONS;%{PE}
DECL FDAT FP1={TOOL_NO 2,BASE_NO 3,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}
DECL FDAT FP2={TOOL_NO 2,BASE_NO 0,IPO_FRAME #BASE}
DECL FDAT FP3={TOOL_NO 2,BASE_NO 3,IPO_FRAME #TCP}
DECL LDAT LCPDAT1={VEL 2.0,ACC 100.0,APO_DIST 100.0}
DECL PDAT PPDAT1={VEL 100.0,ACC 100.0}
DECL LOAD L1={M 5.0,CM {X 0.0,Y 0.0,Z 100.0,A 0.0,B 0.0,C 0.0},J {X 0.1,Y 0.1,Z 0.1}}
DECL E6POS XP1={X 445.0,Y -12.5,Z 630.0,A 0.0,B 90.0,C 0.0,S 2,T 35,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}
DECL E6POS XP2={X 445.0,Y -12.5,Z 630.0,A 0.0,B 90.0,C 0.0,S 2,T 35,E1 0.0}
DECL E6POS XP3={X 445.0,Y -12.5,Z 630.0,A 0.0,B 90.0,C 0.0,S 2,T 35}
DECL E6POS XP4={X 445.0,Y -12.5,Z 630.0,A 0.0,B 90.0,C 0.0,S 2,T 35,E1 800.0}
DECL E6AXIS HOME={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 30.0,A6 0.0,E1 0.0}
DECL FRAME OFFSET={X 0.0,Y 0.0,Z 10.0,A 0.0,B 0.0,C 0.0}
ENDDAT
"""
SRC = """DEF WELD( )
$BASE=BASE_DATA[4]
PTP HOME Vel=100 % DEFAULT
LIN P5 C_DIS
CIRC {X 1,Y 2,Z 3,A 0,B 0,C 0}, {X 4,Y 5,Z 6,A 0,B 0,C 0}, CA 90
$BASE=$NULLFRAME
LIN P6
LIN P7
LIN {Z 100}
LIN_REL {X 10,Y 0,Z 0,A 0,B 0,C 0}
LIN P5:OFFSET
PTP {X A_NUMBER,Y 2,Z 3,A 0,B 0,C 0}
P6.Z = P6.Z + 10
$BASE={X 100,Y 0,Z 0,A 0,B 0,C 0}
LIN P7
BAS(#TOOL,5)
SLIN {X 7,Y 8,Z 9,A 0,B 0,C 0} WITH $VEL.CP=0.2
P8={X 7,Y 8,Z 9,A 0,B 0,C 0,S 2,T 2}
P9={X 7,Y 8,Z 9,A 0,B 0,C 0}
DECL E6POS PA, PB[4]
PB[1]={X 7,Y 8,Z 9,A 0,B 0,C 0}
END
"""
MOD = """MODULE weld
  ! CONST robtarget no:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  TASK PERS wobjdata fix:=[FALSE,TRUE,"a; b",[[100,0,0],[1,0,0,0]],[[0,50,0],[0.70710678,0,0,0.70710678]]];
  PERS wobjdata held:=[TRUE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PERS wobjdata turning:=[FALSE,FALSE,"STN1",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  LOCAL CONST robtarget p10 := [ [ 400 , 1.5 , 2E2 ],
      [ 1 , 0 , 0 , 0 ],
      [ 0 , 0 , 0 , 0 ] , [ 9E+09 , 9E9 , 9E9 , 9E9 , 9E9 , 9E9 ] ];
  CONST robtarget many{2}:=[[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[4,5,6],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]];
  CONST robtarget track:=[[1,2,3],[1,0,0,0],[0,0,0,0],[1500,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget named:=[[x0,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget twice:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget part:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget spun:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget odd:=[[1,2,3],[0.5,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget arc:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget sets:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget home:=[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    TPWrite "MoveL p10";
    MoveAbsJ home\\NoEOffs,v500,fine,tool0;
    MoveL p10,v100\\V:=50,z10,gun\\WObj:=fix;
    MoveC many{1},many{2},v100,fine,gun;
    ArcL\\On,arc,v100,seam1,weld1\\Weave:=w,fine,gun\\WObj:=fix;
    MoveLDO sets,v100,z10,gun,do1,1;
    MoveL Offs(p10,0,0,50),v100,z10,gun\\WObj:=fix;
    MoveL twice,v100,z10,gun\\WObj:=fix;
    MoveL twice,v100,z10,gun;
    MoveL part,v100,z10,gun\\WObj:=held;
    MoveL spun,v100,z10,gun\\WObj:=turning;
    MoveL [[7,8,9],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,z10,gun\\WObj:=cell;
    p10.trans.z := 5;
  ENDPROC
ENDMODULE
"""
SCRIPT = """def weld():
  set_tcp(p[0, 0, 0.1, 0, 0, 0])
  global Waypoint_1_p=p[.1, .2, .3, .4, .5, .6]
  global Waypoint_1_q=[-0.1, -1.2, 1.3, -1.4, -1.5, 0.1]
  global Plane_1=p[0.4, 0, 0, 0, 0, 0]
  global gravity=[0, 0, 9.82]
  home = [0, -1.57, 1.57, -1.57, -1.57, 0]
  movej(home, a=1.4, v=1.05)
  movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.4, v=1.05)
  movel(pose_trans(Plane_1, p[0.01, 0.02, 0.03, 0, 0, 0]), a=1.2, v=0.25)
  movec(p[1, 2, 3, 4, 5, 6], p[0.2,0.2,0.3,0,3.1,0], a=1, v=0.1, r=0)
  movel(pose_add(Waypoint_1_p, p[0, 0, 0.1, 0, 0, 0]))
  movel(get_actual_tcp_pose())
  textmsg("movel(p[1, 2, 3, 4, 5, 6])") # movel(p[1, 2, 3, 4, 5, 6])
  force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,-5,0,0,0], 2, [0.1,0.1,0.1,0.1,0.1,0.1])
  home[0] = 0.5
  spare = p[9, 9, 9, 9, 9, 9]
end
"""


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return load_machine(machine_file(tmp_path_factory.mktemp("arm"), REAL))


def told(program: Program) -> list[tuple[int, str, str | None, str | None]]:
    return [(t.line, t.name, t.base, t.tool and t.tool.partition("@")[0]) for t in program.targets]


def left(program: Program) -> dict[int, str]:
    return {one.line: one.why for one in program.left}


def test_points_that_a_kuka_was_taught(machine: Machine) -> None:
    program = DIALECTS["kuka"].read(DAT, machine)
    tool = "TOOL_DATA[2]"
    assert told(program) == [
        (10, "XP1", "BASE_DATA[3]", tool),
        (11, "XP2", "", tool),
        (14, "HOME", None, None),
    ]
    assert program.targets[0].configuration[1].text == "35"
    assert left(program) == {
        12: "the tool is fixed in the cell and the robot holds the part (#TCP)",
        13: "external axes are in use (E1 800.0)",
    }


def test_motions_of_a_krl_program_and_the_frames_they_go_by(machine: Machine) -> None:
    beside = """DEFDAT WELD
DECL POS P5={X 1,Y 2,Z 3,A 0,B 0,C 0}
ENDDAT
"""
    program = DIALECTS["kuka"].read(SRC, machine, beside)
    assert told(program) == [
        (5, "CIRC", "BASE_DATA[4]", None),
        (5, "CIRC", "BASE_DATA[4]", None),
        (17, "SLIN", program.targets[2].base, "TOOL_DATA[5]"),
        (18, "P8", None, None),
        (21, "PB[1]", None, None),
    ]
    assert program.frames[program.targets[2].base or ""] == (100.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert [line for line, _ in sorted(left(program).items())] == [9, 10, 11, 12, 13, 19]
    assert left(program)[9] == "X, Y, A, B, C of it stay what they are when the robot comes there"
    assert left(program)[12] == "not all of its coordinates are plain numbers"
    points = DIALECTS["kuka"].read(
        beside.replace("P5=", "P7=").replace("ENDDAT", "DECL POS P6={X 1,Y 2,Z 3,A 0,B 0,C 0}"), machine, SRC
    )
    assert told(points) == [(3, "P6", "", None)]
    assert re.match(
        r"used with several frames \(base \$BASE.* with tool none; base none with tool none\)",
        left(points)[2],
    )


def test_targets_of_a_rapid_module_and_the_frames_they_go_by(machine: Machine) -> None:
    program = DIALECTS["rapid"].read(MOD, machine)
    assert told(program) == [
        (6, "p10", "fix", "gun"),
        (9, "many", "", "gun"),
        (10, "many", "", "gun"),
        (17, "arc", "fix", "gun"),
        (18, "sets", "", "gun"),
        (19, "home", "", ""),
        (32, "literal", "cell", "gun"),
    ]
    assert [n.text for n in program.targets[0].numbers] == ["400", "1.5", "2E2", "1", "0", "0", "0"]
    # a quarter turn about z, 50 mm along y of the user frame
    np.testing.assert_allclose(program.frames["fix"], (100, 50, 0, 0.5**0.5, 0, 0, 0.5**0.5), atol=1e-7)
    assert left(program) == {
        11: "external axes are in use (1500)",
        12: "its value is no list of plain numbers",
        13: "used with several frames (fix with gun; wobj0 with gun)",
        14: "held: the robot holds this work object",
        15: "turning: a mechanical unit moves this work object",
        16: "its quaternion's square is 0.25, not 1",
        27: "worked out while the program runs: it gets the correction of its target",
        33: "the program changes a target while it runs; what it writes is not corrected",
    }


def test_motions_of_a_script_and_what_they_go_to(machine: Machine) -> None:
    program = DIALECTS["urscript"].read(SCRIPT, machine)
    assert told(program) == [
        (3, "Waypoint_1_p", None, "set_tcp"),
        (7, "home", None, "set_tcp"),
        (10, "literal", "Plane_1", "set_tcp"),
        (11, "literal", None, "set_tcp"),
        (11, "literal", None, "set_tcp"),
    ]
    assert program.targets[0].near == (-0.1, -1.2, 1.3, -1.4, -1.5, 0.1)
    assert program.frames["Plane_1"] == (0.4, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert left(program) == {
        12: "worked out while the program runs",
        13: "worked out while the program runs",
        16: "the program changes a target while it runs; what it writes is not corrected",
        17: "no motion here goes to it",
    }


Q = joints(1)[0]
POSITION = DRAWN.pose(Q)[:3, 3]
SPACE = st.text(alphabet=" \t", max_size=3)
_TAKEN = re.compile(r"(?i)s?(ptp|lin|circ)|[xyzabcst]$|a\d|e\d|def|end")
NAMES = st.from_regex(r"\A[A-Za-z][A-Za-z0-9_]{0,8}\Z").filter(lambda name: not _TAKEN.match(name))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    gap=SPACE, inner=SPACE, end=st.sampled_from(["\n", "\r\n"]), upper=st.booleans(), name=NAMES,
    typed=st.booleans(), comment=st.text(alphabet="{}[],;! XYZ1.9\xe9\"", max_size=20),
    numbers=st.lists(st.floats(-2000, 2000, allow_nan=False), min_size=6, max_size=6), places=st.integers(0, 9),
    extra=st.booleans(),
)  # fmt: skip
def test_a_krl_point_is_found_however_it_is_written(
    machine: Machine, gap: str, inner: str, end: str, upper: bool, name: str, typed: bool, comment: str,
    numbers: list[float], places: int, extra: bool,
) -> None:  # fmt: skip
    """Spaces, case, line ends, the type in the aggregate and comments change nothing in what is found."""
    texts = [f"{value:.{places}f}" for value in numbers]
    keys = "XYZABC" if upper else "xyzabc"
    fields = f"{inner},{inner}".join(f"{key} {inner}{value}" for key, value in zip(keys, texts, strict=True))
    words = "DECL E6POS" if upper else "decl e6pos"
    literal = f"{{{inner}{'E6POS: ' if typed else ''}{fields}{inner}{',E1 0.0' if extra else ''}}}"
    text = f"; {comment}{end}{gap}{words} {name}{gap}={gap}{literal}{gap};{comment}{end}"
    program = DIALECTS["kuka"].read(text, machine)
    (target,) = program.targets
    assert [n.text for n in target.numbers] == texts and target.line == 2
    assert all(text[n.start : n.end] == n.text for n in target.numbers)
    assert program.left == ()


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    gap=SPACE, end=st.sampled_from(["\n", "\r\n"]), comment=st.text(alphabet="[],;9E \"\xe9", max_size=20),
    numbers=st.lists(st.floats(-2000, 2000, allow_nan=False), min_size=3, max_size=3), places=st.integers(0, 9),
    split=st.booleans(),
)  # fmt: skip
def test_a_rapid_target_is_found_however_it_is_written(
    machine: Machine, gap: str, end: str, comment: str, numbers: list[float], places: int, split: bool
) -> None:
    texts = [f"{value:.{places}f}" for value in numbers]
    joint = f"{gap},{gap}"
    lists = [texts, ["1", "0", "0", "0"], ["0", "-1", "0", "0"], ["9E9"] * 6]
    between = f",{end if split else gap}"
    literal = f"[{gap}{between.join(f'[{gap}{joint.join(one)}{gap}]' for one in lists)}{gap}]"
    text = f"! {comment}{end}CONST{gap} robtarget p1{gap}:={gap}{literal}{gap};!{comment}{end}"
    (target,) = DIALECTS["rapid"].read(text, machine).targets
    assert [n.text for n in target.numbers[:3]] == texts and target.name == "p1" and target.line == 2
    assert all(text[n.start : n.end] == n.text for n in (*target.numbers, *target.configuration))


def run(
    where: Path, text: str, file: str = "job.src", *options: str, real: bool = True
) -> tuple[Result, str]:
    machine = machine_file(where, REAL if real else DRAWN)
    (where / file).write_text(text, newline="")
    out = where / f"out{Path(file).suffix}"
    done = CliRunner().invoke(
        app, ["compensate", str(machine), str(where / file), "-o", str(out), "--anyway", *options]
    )
    return done, out.read_text() if out.exists() else ""


PIECES = """{ } [ ] ( ) , ; : = ! # ' " \\ . := X 1|Y|A1 2|S|T 9|-1.5e3|\xe9|1,2,3,4,5,6|LIN|PTP|CIRC|DECL E6POS P|FDAT F|$BASE
$TOOL|BAS(#BASE,1)|CONST robtarget p|jointtarget|[1,2,3]|[1,0,0,0]|[0,0,0,0]|[9E9,9E9,9E9,9E9,9E9,9E9]|MoveL p|MoveAbsJ
\\WObj:=w|Offs(|wobjdata w|tooldata t|p[1,2,3,4,5,6]|[1,2,3,4,5,6]|movel(|movec(|get_inverse_kin(|pose_trans(|set_tcp(
p1|x,y,z,rx,ry,rz"""
TEXTS = st.lists(
    st.sampled_from(["\n", "\r\n", " ", *PIECES.split(" ", 17)[:17], *re.split(r"[|\n]", PIECES)]),
    max_size=25,
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(dialect=st.sampled_from(sorted(DIALECTS)), pieces=TEXTS)
def test_whatever_a_text_says_it_is_read_or_refused(
    machine: Machine, dialect: str, pieces: list[str]
) -> None:
    """No text ends in a traceback, and every number that is found stands where it is said to."""
    text = "".join(pieces)
    try:
        program = DIALECTS[dialect].read(text, machine, text)
    except InputError:
        return
    for target in program.targets:
        for number in (*target.numbers, *target.configuration):
            assert text[number.start : number.end] == number.text and np.isfinite(number.value)
    spans = sorted((n.start, n.end) for t in program.targets for n in (*t.numbers, *t.configuration))
    assert all(a[1] <= b[0] for a, b in pairwise(spans))


def krl(q: NDArray[np.float64]) -> str:
    pose = DRAWN.pose(q)
    x, y, z = pose[:3, 3]
    a, b, c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    s, t = status_turn(DRAWN, q)
    return f"PTP {{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a:.3f},B {b:.3f},C {c:.3f},S {s},T {t}}}\n"


def test_numbers_get_the_decimals_that_a_correction_needs_and_no_fewer_than_they_had(tmp_path: Path) -> None:
    done, out = run(tmp_path, krl(Q))
    assert done.exit_code == 0
    decimals = [len(text) for text in re.findall(r"\.(\d+)", out)]
    assert decimals[:3] and all(3 <= d <= 4 for d in decimals[:3]) and all(3 <= d <= 6 for d in decimals[3:])


def test_an_axis_that_passes_zero_takes_its_turn_bit_with_it(tmp_path: Path) -> None:
    """Axis 6 stands a hair above zero; the real arm's zero of it is off, so that its command is below."""
    q = Q.copy()
    q[5] = 1e-4
    done, out = run(tmp_path, krl(q), "job.src", "--json")
    said = json.loads(done.stdout)
    moved = re.search(r"T (\d+)", out)
    assert moved is not None
    bit = int(moved[1]) >> 5 & 1
    assert said["reconfigured"] == ([1] if bit else [])
    other = Q.copy()
    other[5] = -1e-4
    _, mirrored = run(tmp_path, krl(other), "job.src")
    assert re.search(r"T (\d+)", mirrored)[1] == moved[1]  # type: ignore[index]  # the same command, the same bit


def test_a_configuration_that_no_joints_have_is_left_and_said(tmp_path: Path) -> None:
    text = krl(Q)
    t = int(re.search(r"T (\d+)", text)[1])  # type: ignore[index]
    wrong = re.sub(r"T \d+", f"T {t ^ 2 ^ 4}", text)
    done, out = run(tmp_path, text + wrong, "job.src", "--json")
    said = json.loads(done.stdout)
    assert [one["line"] for one in said["left"]] == [2] and "configuration" in said["left"][0]["why"]
    assert out.splitlines()[1] + "\n" == wrong and said["targets"] == 1


def test_motions_that_do_not_look_at_a_configuration_need_none(tmp_path: Path) -> None:
    """LIN keeps the status that the robot has, whatever a generated program writes; so does MoveL behind ConfL\\Off."""
    taught = krl(Q)
    line = re.sub(r"S \d+,T \d+", "S 0,T 0", taught.replace("PTP", "LIN"))
    for text, count in ((taught + line, 2), (taught + line.replace("LIN", "PTP"), 1)):
        done, out = run(tmp_path, text, "job.src", "--json")
        assert json.loads(done.stdout)["targets"] == count
    assert "S 0,T 0" in out
    x, y, z, w = Rotation.from_matrix(DRAWN.pose(Q)[:3, :3]).as_quat().tolist()
    pose = f"[{POSITION.tolist()},{[w, x, y, z]}"
    first, other = (
        f"{pose},{cf},[9E9,9E9,9E9,9E9,9E9,9E9]]" for cf in (list(quadrants(DRAWN, Q)), [3, 3, 3, 0])
    )
    moves = f"MoveL {first},v100,fine,tool0x;\nMoveL {other},v100,fine,tool0x;\n"
    for head, count in (("ConfL\\Off;\n", 2), ("", 1)):
        done, _ = run(tmp_path, head + moves, "job.mod", "--json")
        assert json.loads(done.stdout)["targets"] == count


def test_points_of_a_module_s_own_offsets_are_told_how_far_off_they_are(tmp_path: Path) -> None:
    """The correction 100 mm beside a target, by numpy, differs from the target's by no more than is said."""
    x, y, z, w = Rotation.from_matrix(DRAWN.pose(Q)[:3, :3]).as_quat().tolist()
    literal = f"[{POSITION.tolist()},{[w, x, y, z]},{list(quadrants(DRAWN, Q))},[9E9,9E9,9E9,9E9,9E9,9E9]]"
    text = f"CONST robtarget p1:={literal};\nMoveL p1,v100,fine,gun;\nMoveL Offs(p1,0,0,100),v100,fine,gun;\n"
    done, _ = run(tmp_path, text, "job.mod", "--json")
    said = json.loads(done.stdout)["nearby"]
    changes = []
    for height in (0.0, 100.0):
        goal = DRAWN.pose(Q)
        goal[2, 3] += height
        command = REAL.inverse(goal, DRAWN.inverse(goal, Q))
        changes.append(DRAWN.pose(command)[:3, 3] - goal[:3, 3])
    apart = float(np.linalg.norm(changes[1] - changes[0]))
    assert 0.0 < apart <= said["value"] * (1 + 1e-6) < 20 * apart and said["distance"]["value"] == 100.0
    spoken, _ = run(tmp_path, text, "job.mod")
    assert "100 mm away it should be another by up to" in spoken.stderr


def test_a_tool_without_numbers_is_the_machine_file_s_unless_the_user_says_another(tmp_path: Path) -> None:
    text = "$TOOL=TOOL_DATA[7]\n" + krl(Q)
    done, out = run(tmp_path, text, "job.src", "--json")
    assert json.loads(done.stdout)["assumed_tools"] == ["TOOL_DATA[7]"]
    other, moved = run(tmp_path, text, "job.src", "--tool", "12,-7,94,20,-5,3", "--json")
    assert json.loads(other.stdout)["assumed_tools"] == [] and moved != out
    two = text + "$TOOL=TOOL_DATA[8]\n" + krl(Q)
    done, _ = run(tmp_path, two, "job.src")
    assert (
        done.exit_code == 2 and "for the tool TOOL_DATA[7], whose numbers are not known here" in done.stderr
    )


def test_large_corrections_are_pointed_out(tmp_path: Path) -> None:
    done, _ = run(tmp_path, krl(Q), "job.src", "--limit", "0.001", "--json")
    (one,) = json.loads(done.stdout)["beyond_limit"]
    assert one["line"] == 1 and one["position"]["value"] > 0.1
    spoken, _ = run(tmp_path, krl(Q), "job.src", "--limit", "0.001")
    assert re.search(r"note: corrections of more than 0.001 mm or 1 deg: line 1 \(PTP, ", spoken.stderr)


@pytest.mark.parametrize(
    ("file", "text", "options", "message"),
    [
        ("job.src", "DEF job()\nEND\n", (), r"job.src: found no target in the program"),
        ("job.src", "LIN {X 9000,Y 0,Z 0,A 0,B 0,C 0}\n", (), r"job.src:1: LIN: no target can be .*cannot take this pose"),
        ("job.src", krl(Q), ("--base", "1,2,3"), r"--base: found '1,2,3', expected 6 numbers x,y,z,a,b,c in mm and deg"),
        ("job.mod", MOD, ("--tool", "0,0,0,0,0,0,0"), r"--tool: found .*expected a quaternion of length 1"),
        ("job.mod", MOD, ("--frame", "nofix=0,0,0,1,0,0,0"), r"--frame: found the name 'nofix', .*: cell, fix, gun"),
        ("job.src", krl(Q), ("--frame", "x"), r"--frame: found 'x', expected NAME=VALUE"),
        ("job.src", krl(Q), ("--at", "payload=3"), r"--at: found the driver 'payload', expected one that effects have"),
        ("job.src", krl(Q), ("--method", "first-order"), r"--method: found 'first-order' with a robot program, expected exact"),
        ("job.src", "\ufeff".encode("utf-16").decode("latin-1"), (), r"found UTF-16 or binary data"),
        ("job.csv", "q1,q2,q3,q4,q5,q6\n0,0,0,0,30,0\n", ("--base", "0,0,0,0,0,0"), r"--base: found it with a table, expected"),
        ("job.txt", krl(Q), ("--dialect", "basic"), r"--dialect: found 'basic', expected kuka, rapid, urscript, csv"),
        ("job.csv", "a,b\n1,2\n", ("--dialect", "csv"), r"job.csv: table: missing column 'x'"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused_in_one_line(
    tmp_path: Path, file: str, text: str, options: tuple[str, ...], message: str
) -> None:
    machine = machine_file(tmp_path, REAL)
    (tmp_path / file).write_bytes(text.encode("latin-1"))
    out = tmp_path / f"out{Path(file).suffix}"
    done = CliRunner().invoke(
        app, ["compensate", str(machine), str(tmp_path / file), "-o", str(out), "--anyway", *options]
    )
    assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1
    assert re.search(message, done.stderr), done.stderr
    assert not out.exists()


def test_a_program_is_not_written_over_itself(tmp_path: Path) -> None:
    machine = machine_file(tmp_path, REAL)
    (tmp_path / "job.src").write_text(krl(Q))
    done = CliRunner().invoke(
        app, ["compensate", str(machine), str(tmp_path / "job.src"), "-o", str(tmp_path / "job.src"), "--anyway"]
    )  # fmt: skip
    assert done.exit_code == 2 and "found the program itself" in done.stderr
    assert (tmp_path / "job.src").read_text() == krl(Q)


def test_a_dat_that_is_a_table_stays_a_table(tmp_path: Path) -> None:
    done, out = run(tmp_path, "q1,q2,q3,q4,q5,q6\n0,0,0,0,30,0\n", "job.dat")
    assert done.exit_code == 0 and out.startswith("q1,q2,q3,q4,q5,q6\n")
