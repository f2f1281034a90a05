"""What is found in programs as people and controllers write them, what is left as it is, and why."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from support.command import input_error
from support.program_robots import RAPID_MODULE, arms
from truepose.errors import InputError
from truepose.identification.leaves.programs.dialects import DIALECTS
from truepose.identification.leaves.programs.program import Program
from truepose.models.machine.machine import Machine

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
    assert [line for line, _ in sorted(left(program).items())] == [7, 8, 9, 10, 11, 12, 15, 19]
    assert left(program)[9] == "X, Y, A, B, C of it stay what they are when the robot comes there"
    assert left(program)[12] == "not all of its coordinates are plain numbers"
    points = DIALECTS["kuka"].read(
        beside.replace("P5=", "P7=").replace("ENDDAT", "DECL POS P6={X 1,Y 2,Z 3,A 0,B 0,C 0}"), machine, SRC
    )
    assert told(points) == [(3, "P6", "", None)]
    assert left(points) == {2: "used with several frames, or as a frame: its motions get copies"}


def test_a_tool_that_is_fixed_in_the_cell_is_refused(machine: Machine) -> None:
    with input_error(r"line 1: found \$IPO_MODE=#TCP, expected tools that the robot holds"):
        DIALECTS["kuka"].read("$IPO_MODE=#TCP\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\n", machine)


def test_targets_of_a_rapid_module_and_the_frames_they_go_by(machine: Machine) -> None:
    program = DIALECTS["rapid"].read(RAPID_MODULE, machine)
    assert told(program) == [
        (27, "Offs(p10,0,0,50)", "fix", "gun"),
        (6, "p10", "fix", "gun"),
        (9, "many", "", "gun"),
        (10, "many", "", "gun"),
        (28, "twice", "fix", "gun"),
        (29, "twice", "", "gun"),
        (17, "arc", "fix", "gun"),
        (18, "sets", "", "gun"),
        (19, "home", None, None),
        (32, "literal", "cell", "gun"),
    ]
    assert [n.text for n in program.targets[1].numbers] == ["400", "1.5", "2E2", "1", "0", "0", "0"]
    # a quarter turn about z, 50 mm along y of the user frame
    np.testing.assert_allclose(program.frames["fix"], (100, 50, 0, 0.5**0.5, 0, 0, 0.5**0.5), atol=1e-7)
    assert left(program) == {
        11: "external axes are in use (1500)",
        30: "held: the robot holds this work object",
        31: "turning: a mechanical unit moves this work object",
        16: "its quaternion's square is 0.25, not 1",
        33: "the program changes a target while it runs; what it writes is not corrected",
    }


def test_motions_of_a_script_and_what_they_go_to(machine: Machine) -> None:
    program = DIALECTS["urscript"].read(SCRIPT, machine)
    assert told(program) == [
        (3, "Waypoint_1_p", None, "set_tcp"),
        (7, "home", None, None),
        (10, "literal", "", "set_tcp"),
        (11, "literal", None, "set_tcp"),
        (11, "literal", None, "set_tcp"),
    ]
    assert program.targets[2].within == ("Plane_1",)
    assert program.targets[0].near == (-0.1, -1.2, 1.3, -1.4, -1.5, 0.1)
    assert program.frames["Plane_1"] == (0.4, 0.0, 0.0, 0.0, 0.0, 0.0)
    computed = (
        "worked out while the program runs: it gets the correction of what it starts from, if that has one"
    )
    assert left(program) == {
        12: computed,
        13: computed,
        16: "the program changes a target while it runs; what it writes is not corrected",
        17: "no motion here goes to it",
    }


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
    written = [target for target in program.targets if target.copies is None]
    for target in written:
        for number in (*target.numbers, *target.configuration):
            assert text[number.start : number.end] == number.text and np.isfinite(number.value)
    spans = sorted((n.start, n.end) for t in written for n in (*t.numbers, *t.configuration))
    assert all(a[1] <= b[0] for a, b in pairwise(spans))
