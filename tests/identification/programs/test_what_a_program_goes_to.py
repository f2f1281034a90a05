"""What motions go to, line by line, in each dialect: which literals are targets, in which frames, and what is left and why."""

from __future__ import annotations

from typing import Any

import pytest

from truepose.identification.leaves.programs.dialects import DIALECTS
from truepose.identification.leaves.programs.program import Program, Target

POSE, JOINTS = "{X 1,Y 2,Z 3,A 4,B 5,C 6}", "{A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}"
P, Q = "p[1,2,3,4,5,6]", "[1,2,3,4,5,6]"
ROB, JNT = (
    "[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]",
    "[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]]",
)


def read(dialect: str, text: str, beside: str | None = None) -> Program:
    machine: Any = None  # no text but a table's asks it
    return DIALECTS[dialect].read(text, machine, beside)


def told(target: Target) -> str:
    """In a few words: name, frames, where the configuration is not looked at, and whether motions get copies."""
    base, tool = (
        "" if name is None else f"{mark}{name.partition('@')[0]}"
        for name, mark in ((target.base, " in "), (target.tool, " with "))
    )
    inside = "".join(f" in {name.partition('@')[0]}" for name in target.within)
    return (
        f"{target.name}{base}{inside}{tool}{' loose' * target.loose}{' copied' * (target.copies is not None)}"
    )


RELATIVE, FUNCTION = "a relative motion: it starts where", "a function gives the point"
CHANGED = "the program changes a coordinate while it runs"
STAY, NUMBERS = "of it stay what they are", "not all of its coordinates are plain numbers"
NOWHERE, ELSEWHERE = "no motion here goes to it", "its value is in neither this text nor"


@pytest.mark.parametrize(
    ("text", "targets", "left"),
    [
        (f"PTP {POSE}\nSLIN {POSE} C_DIS\nSPTP {JOINTS}", ["PTP", "SLIN loose", "SPTP"], {}),
        (f"\nLIN {POSE}\rPTP {POSE}\r\nPOS P={POSE}", ["LIN loose", "PTP", "P"], {}),
        (f"CIRC {POSE},{POSE},CA 90\nSCIRC P1,{POSE}\nSPL {POSE}", ["CIRC loose"] * 2 + ["SCIRC loose", "SPL loose"],
         {2: ELSEWHERE}),
        (f"PTP {{E6POS: {POSE[1:]}\nptp {{e6axis:{JOINTS[1:].lower()}", ["PTP", "PTP"], {}),
        ("PTP {A1 1,A2 2,A3 3,A4 4}\nLIN {Z 5}", [], {1: f"A5, A6 {STAY}", 2: f"X, Y, A, B, C {STAY}"}),
        (f"LIN_REL {POSE}\nSPTP_REL {JOINTS}", [], {1: RELATIVE, 2: RELATIVE}),
        ("PTP {X N,Y 2,Z 3,A 4,B 5,C 6}\nPTP {N 3}\nPOS P={X N,Y 1}\nP={X N,Y 1}", [], {1: NUMBERS, 3: NUMBERS}),
        ("PTP {X 1,Y 2,Z 3,A 4,B 5,C 6,E1 7,E2 0,E6 -0.5}", [], {1: "external axes are in use (E1 7, E6 -0.5)"}),
        (f"PTP F(3)\nLIN P:{POSE}\nLIN P : Q\nPTP {{POS:{POSE[1:]}", ["PTP"],
         {1: FUNCTION, 2: "worked out by `:` while", 3: "worked out by `:` while"}),
        ("P.X=1\nQ[2].A6 = Q[2].A6+1\nP.Q=3\nP.XY=3", [], {1: CHANGED, 2: CHANGED}),
        (f"DECL POS P={POSE}\nQ={POSE}\nLIN R\nR={POSE}\nPTP R", ["P", "R"], {2: NOWHERE}),
        ("P={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2}\nQ={X 1,Y 2,Z 3,A 4,B 5,C 6,T 2}", ["P", "Q"], {}),
        (f"DECL E6POS A1,B[3]\nA1={POSE}\nB[2]={POSE}\nC={POSE}", ["A1", "B[2]"], {4: NOWHERE}),
        (f"FRAME F={POSE}\nDECL FRAME G\nG={POSE}\nFRAME H={POSE}\nLIN H", ["H loose"], {}),
        (f"$BASE={POSE}\n$TOOL={POSE}\nBASE_DATA[3]={POSE}\nMACHINE_FRAME={POSE}\n$WORLD={POSE}", [], {}),
        (f"$BASE=B\nLIN P\n$BASE=C\nLIN P\nPTP Q\nP={POSE}\nAXIS Q={JOINTS}",
         ["P in B loose copied", "P in C loose copied", "Q in C"], {}),
        (f"P={POSE}\nLIN P:{POSE}\nLIN P\nR=P:{POSE}\nLIN R\nLIN P:Q\nPTP P:{POSE}",
         ["P loose copied", "LIN in P loose", "PTP in P", "R copied"], {6: "worked out by `:` while"}),
        (f"P={POSE}\n$BASE=P\nLIN P\nP={POSE}\n$BASE=P\nLIN P", ["P in P loose copied", "P in P loose copied"], {}),
        (f"$BASE=B\nPTP Q\n$BASE=C\nPTP Q\nAXIS Q={JOINTS}", ["Q in B"], {}),
        (f"$IPO_MODE=#TCP\nLIN {POSE}\nPTP {JOINTS}", ["PTP"], {2: "the tool is fixed in the cell"}),
        (f"; PTP {POSE}\n&PARAM {POSE}\nWAIT FOR {POSE}\nPTP {{X 1,Y\n", [], {}),
        (f"BAS(#TOOL,4)\nBAS(#BASE,0)\nLIN {POSE}", ["LIN in  with TOOL_DATA[4] loose"], {}),
    ],
)  # fmt: skip
def test_krl(text: str, targets: list[str], left: dict[int, str]) -> None:
    found = read("kuka", text)
    assert [told(target) for target in found.targets] == targets
    assert {one.line: one.why[: len(left.get(one.line, ""))] for one in found.left} == left
    computed = [one.line for one in found.left if one.computed]
    assert computed == [line for line, why in left.items() if why.startswith((CHANGED, "worked out"))]


def test_a_krl_configuration_is_told_by_status_and_turn_together() -> None:
    numbers = POSE[:-1]
    for more, count in (("", 0), (",S 2", 0), (",T 3", 0), (",S 2,T 3", 2), (",T 3,S 2,E1 0.0", 2)):
        (target,) = read("kuka", f"PTP {numbers}{more}}}").targets
        assert [n.text for n in target.configuration] == ["2", "3"][:count]
        assert [n.text for n in target.numbers] == ["1", "2", "3", "4", "5", "6"]
    (joints,) = read("kuka", f"PTP {JOINTS[:-1]},S 2,T 3}}").targets
    assert joints.kind == "joints" and joints.configuration == ()


@pytest.mark.parametrize(
    ("here", "there", "expected"),
    [
        (f"POS XP1={POSE}\n", "LIN XP1", "XP1 loose"),
        (f"POS XP1={POSE}\nLIN XP1", "PTP XP1", "XP1"),
        (f"POS XP1={POSE}\nPTP XP1", "LIN XP1", "XP1"),
        (f"POS XP1={POSE}\nFDAT FP1={{TOOL_NO 1,BASE_NO 2}}", "LIN XP1", "XP1 in BASE_DATA[2] with TOOL_DATA[1] loose"),
        (f"POS XP1={POSE}", "FDAT FP1={TOOL_NO 1,BASE_NO 2}", "XP1 in BASE_DATA[2] with TOOL_DATA[1]"),
        (f"POS XP1={POSE}\nFDAT FP1={{TOOL_NO 1,BASE_NO 2}}", "FDAT FP1={TOOL_NO 3,BASE_NO 4}",
         "XP1 in BASE_DATA[2] with TOOL_DATA[1]"),
        (f"POS P1={POSE}", "$BASE=B\nLIN P1", "P1 in B loose"),
        (f"P1={POSE}", "DECL POS P1", "P1"),
    ],
)  # fmt: skip
def test_krl_points_are_gone_to_from_either_file(here: str, there: str, expected: str) -> None:
    assert [told(target) for target in read("kuka", here, there).targets] == [expected]


def test_krl_frames_of_both_files_have_places_of_their_own() -> None:
    base = "$BASE={X 7,Y 0,Z 0,A 0,B 0,C 0}"
    found = read("kuka", f"{base}\nPTP {POSE}\n", f"$BASE={POSE}\nPTP XP1\nF={POSE}")
    assert sorted(numbers[0] for numbers in found.frames.values()) == [1.0, 1.0, 7.0]
    assert found.frames["F"] == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert found.frames[found.targets[0].base or ""][0] == 7.0


RUNS, SEVERAL = "worked out while the program runs", "motions go to it in several ways"
MANY, NOT_HERE = "its feature may have several values there", "its value is not in this text"
WRITES = "the program changes a target while it runs"


@pytest.mark.parametrize(
    ("text", "targets", "left"),
    [
        (f"movej({Q})\nmovel({P}, a=1)\nmovep({P})\nservoj({Q}, 0, 0)\nservoc({P})", ["literal"] * 5, {}),
        (f"movec({P}, {P}, {P})\nmovel({P}, {P})", ["literal"] * 3, {}),  # no motion has a third place
        (f"a={P}\nmovel(a)\nb = {Q}\n  movej( b )\nglobal c={P}\nlocal d={P}\nmovel(c)\nmovec(c,d)", ["a", "b", "c", "d"], {}),
        (f"set_tcp(t)\nmovel({P})\nset_tcp({P})\nmovel({P})", ["literal with t", "literal with set_tcp"], {}),
        (f"movel({P})\nset_tcp(t)", ["literal"], {}),
        (f"a={P}\nmovel(a)\nset_tcp(t)\nmovel(a)\nb={Q}\nmovej(b)\nset_tcp(s)\nmovej(b)",
         ["a copied", "a with t copied", "b with t"], {}),
        (f"a={P}\nmovel(a)\nmovel(a)", ["a"], {}),
        (f"\na={P}\r\r\nb={Q}\rmovel(a)\nmovej(b)", ["a", "b"], {}),
        (f"f={P}\na={P}\nmovel(pose_trans(f, a))\nmovel(pose_trans(f,{P}))", ["a in f", "literal in f"], {}),
        (f"f={P}\nmovel(pose_trans(f, pose_trans(f, {P})))\nmovel(pose_trans({P}, {P}))",
         ["literal in f in f", "literal in p[1,2,3,4,5,6]"], {}),
        (f"f={P}\nmovel(f)\nmovel(pose_trans(f,{P}))\nset_tcp(f)", ["f copied", "literal in f"], {}),
        (f"f={P}\na={P}\nb=pose_trans(f,a)\nmovel(a)\nmovel(b)\nmovel(pose_trans(f,b))",
         ["b copied", "b in f copied", "a copied"], {}),
        (f"a={P}\nmovel(a)\na={P}\nmovel(a)\nwhile c:\n movel(pose_trans(a,{P}))\n a={P}\n movel(a)\nend",
         ["a", "a copied", "a copied"], {6: MANY}),
        (f"a={P}\nif c:\n a={P}\nend\nmovel(a)\nset_tcp(t)\nmovel(a)", [], {5: SEVERAL, 7: SEVERAL}),
        (f"a={P}\ndef f():\n a={P}\nend\nf()\nmovel(a)\nmovel(b)\nmovel(pose_trans(a,{P}))", [],
         {6: SEVERAL, 7: NOT_HERE, 8: MANY}),
        (f"a=pose_trans(get_f(),{P})\nmovel(a)\nq=get_inverse_kin({P})\nmovej(q)", ["literal"], {2: f"its value is {RUNS}"}),
        (f"a={P}\nmovel(pose_add(a, {P}))\nmovel(get_target())\nmovel(pose_trans(a))", [],
         {1: "motions go to what is worked out of it", 2: RUNS, 3: RUNS, 4: RUNS}),
        (f"a={P}\nb={Q}\nc=[{P}]\nx={P}+y", [], {1: NOWHERE, 4: NOWHERE}),
        (f"a={Q}\nmovej(a)\na[0]=1\na [ 1 ] = 2\nb[0]=1\na[0]==1", ["a"], {3: WRITES, 4: WRITES}),
        (f"movel({P}\nmovej(get_inverse_kin({P}))", ["literal"], {}),
        (f"# movel({P})\ntextmsg('movel({P})')\ntextmsg(\"{P}\")\nxmovel({P})", [], {}),
        (f"movej(get_inverse_kin(pose_trans(f, {P})))", ["literal in f"], {}),
    ],
)  # fmt: skip
def test_urscript(text: str, targets: list[str], left: dict[int, str]) -> None:
    found = read("urscript", text)
    assert [told(target) for target in found.targets] == targets
    assert {one.line: one.why[: len(left.get(one.line, ""))] for one in found.left} == left
    assert all(one.computed == (one.why == RUNS or one.why.startswith(WRITES)) for one in found.left)


@pytest.mark.parametrize(
    ("call", "near"),
    [
        (f"get_inverse_kin({P}, {Q})", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        (f"get_inverse_kin({P}, qnear={Q})", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        (f"get_inverse_kin({P}, qnear = here)", (6.0, 5.0, 4.0, 3.0, 2.0, 1.0)),
        (f"get_inverse_kin({P}, here)", (6.0, 5.0, 4.0, 3.0, 2.0, 1.0)),
        (f"get_inverse_kin({P}, there)", None),
        (f"get_inverse_kin({P}, pose)", None),
        (f"get_inverse_kin({P})", None),
        (f"movel({P}, {Q})", None),
    ],
)
def test_inverse_kinematics_is_asked_next_to_joints(call: str, near: tuple[float, ...] | None) -> None:
    (target,) = read("urscript", f"here=[6,5,4,3,2,1]\npose={P}\nmovej({call}, {Q})\n").targets[:1]
    assert target.near == near and target.place > 0


def test_urscript_frames_are_the_poses_of_its_variables_and_tools() -> None:
    text = f"f=p[1,0,0,0,0,0]\nq={Q}\nset_tcp(p[2,0,0,0,0,0])\nset_tcp(f)\nmovel({P})"
    found = read("urscript", text)
    tool = f"set_tcp@{text.index('p[2')}"
    assert found.frames == {"f": (1, 0, 0, 0, 0, 0), tool: (2, 0, 0, 0, 0, 0)}
    assert found.targets[0].tool == "f"


def test_each_dialect_has_units_and_decimals_of_its_own() -> None:
    kuka, rapid, script = (
        read("kuka", f"PTP {POSE}"),
        read("rapid", f"MoveL {ROB},v,z,t;"),
        read("urscript", f"movel({P})"),
    )
    assert [one.form.decimals for one in (kuka, rapid, script)] == [
        (4, 4, 4, 6, 6, 6), (4, 4, 4, 8, 8, 8, 8), (7, 7, 7, 8, 8, 8),
    ]  # fmt: skip
    assert [dict(one.joint_units) for one in (kuka, rapid, script)] == [
        {"rad": "deg", "mm": "mm"}, {"rad": "deg", "mm": "mm"}, {"rad": "rad", "mm": "m"},
    ]  # fmt: skip
    assert script.configuration is None and kuka.configuration is not None and rapid.configuration is not None


OFFSET, ASSIGNED = "worked out while the program runs", "the program changes"


@pytest.mark.parametrize(
    ("text", "targets", "left"),
    [
        (f"MoveL {ROB},v,z,t;\nMoveAbsJ {JNT},v,z,t;\nCONST robtarget a:={ROB};", ["literal in  with t"] * 2 + ["a"], {}),
        (f"ConfL\\Off;\nMoveL {ROB},v,z,t;\nMoveJ {ROB},v,z,tool0;\nVAR robtarget a:={ROB};",
         ["literal in  with t loose", "literal in  with ", "a"], {}),
        (f"ConfL\\Off;\nPERS robtarget a:={ROB};\nMoveL a,v,z,t;\nMoveJ a,v,z,t;", ["a in  with t"], {}),
        (f"CONST robtarget a:={ROB};\nMoveL A,v,z,t\\WObj:=w;\nMoveL a,v,z,t\\WObj:=W;", ["a in w with t"], {}),
        (f"CONST robtarget a:={ROB};\nMoveL a,v,z,t\\WObj:=w;\nMoveL a,v,z,s;",
         ["a in w with t copied", "a in  with s copied"], {}),
        (f"CONST robtarget a:={ROB};\nCONST robtarget b:=Offs(a,1,2,3);\nMoveL b,v,z,t;\n"
         "MoveL RelTool(a,1,2,3\\Rz:=90),v,z,t;\nMoveL Offs(a,i,2,3),v,z,t;",
         ["a", "b in  with t copied", "RelTool(a,1,2,3\\Rz:=90) in  with t copied"], {5: OFFSET}),
        (f"VAR robtarget a:={ROB};\nPROC p()\nMoveL a,v,z,t;\na:={ROB};\nMoveL Offs(a,1,2,3),v,z,t;\nENDPROC",
         ["a in  with t", "a in  with t"], {5: OFFSET}),
        (f"CONST jointtarget a:={JNT};\nMoveAbsJ a,v,z,t\\WObj:=w;\nMoveAbsJ a,v,z,s;", ["a in w with t"], {}),
        ("CONST robtarget a:=[[1,2,3],[1,0,0,0],[0,0,0,0],[0,9E9,7,9E9,9E9,-2]];\n"
         "CONST jointtarget b:=[[1,2,3,4,5,6],[9E9,9E9,9E9,1,0,9E9]];", [],
         {1: "external axes are in use (7, -2)", 2: "external axes are in use (1)"}),
        ("CONST robtarget a:=[[1,2,3],[1.004,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
         "CONST robtarget b:=[[1,2,3],[1.006,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];", ["a"],
         {2: "its quaternion's square is 1.012, not 1"}),
        ("CONST robtarget a:=[[1,2,3],[1E308,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];", [],
         {1: "its quaternion's square is inf, not 1"}),
        ("CONST robtarget a:=Offs(b,1,2,3);\nMoveL RelTool(a,1,2,3),v,z,t;\na.trans.x:=5;\nb{3}.rot := c;\nMoveL Offs(", [],
         {1: "its value is no list of plain numbers", 2: OFFSET, 3: ASSIGNED, 4: ASSIGNED, 5: OFFSET}),
        (f"! MoveL {ROB},v,z,t;\nTPWrite \"{ROB}\";\nx:=5;", [], {}),
        (f"CONST robtarget a{{2}}:=[{ROB},\n{ROB}];\nMoveL a{{1}},v,z,t;", ["a in  with t", "a in  with t"], {}),
    ],
)  # fmt: skip
def test_rapid(text: str, targets: list[str], left: dict[int, str]) -> None:
    found = read("rapid", text)
    assert [told(target) for target in sorted(found.targets, key=lambda t: t.place)] == targets
    assert {one.line: one.why[: len(left.get(one.line, ""))] for one in found.left} == left
    assert all(len(t.numbers) == (7 if t.kind == "pose" else 6) for t in found.targets)
    assert all(len(t.configuration) == (4 if t.kind == "pose" else 0) for t in found.targets)
