"""Which frames a motion goes by: followed through the text of KRL and RAPID, and stated by the user."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.program_robots import arms, joints, machine_file, shape, status_turn
from truepose.errors import InputError
from truepose.identification.compensation.inverse import PoseSolver
from truepose.identification.leaves.programs.kuka import Stand, fdats, frames, motions
from truepose.identification.leaves.programs.meaning import ArmShape, Branches, flipped
from truepose.identification.leaves.programs.program import (
    BASE_ITSELF,
    Cell,
    Euler,
    Frames,
    Number,
    Program,
    Quaternion,
    StatusTurn,
    Target,
    Told,
    shown_name,
)
from truepose.identification.leaves.programs.rapid import Move, cell_of, moves
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

DRAWN, REAL = arms()


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return load_machine(machine_file(tmp_path_factory.mktemp("arm"), DRAWN))


def uses(text: str, taught: dict[str, Stand], file: str) -> dict[str, dict[Stand, bool]]:
    """Frames by the names of points that motions go to, and by the place of constants; and whether one is point to point."""
    out: dict[str, dict[Stand, bool]] = {}
    for motion in motions(text, taught, file):
        start, end = motion.factors[-1]
        key = f"{file}@{start}" if text[start] == "{" else text[start:end].partition("[")[0].upper()
        held = out.setdefault(key, {})
        held[motion.stand] = held.get(motion.stand, False) or motion.checked
    return out


@pytest.mark.parametrize(
    ("text", "stand"),
    [
        ("LIN P1", Stand(None, None)),
        ("$BASE = BASE_DATA[ 2 ]\n$TOOL=TOOL_DATA[1]\nLIN P1", Stand("BASE_DATA[2]", "TOOL_DATA[1]")),
        ("$tool=$NullFrame\n$base=$WORLD\nlin p1", Stand(BASE_ITSELF, BASE_ITSELF)),
        ("$BASE=$ROBROOT\nSPTP P1", Stand(BASE_ITSELF, None)),
        ("BAS(#BASE,3)\nBAS (#TOOL, 0)\nLIN P1", Stand("BASE_DATA[3]", BASE_ITSELF)),
        ("$BASE=B\n$BASE=C\nLIN P1 C_DIS", Stand("C", None)),
        ("LIN P1\n$BASE=B", Stand(None, None)),  # in the order of the text
        ("$IPO_MODE=#TCP\nLIN P1", Stand(None, None, fixed=True)),
        ("$IPO_MODE=#TCP\n$IPO_MODE=#BASE\nLIN P1", Stand(None, None)),
        ("$BASE=B\nFDAT_ACT=FP7\nLIN P1", Stand("BASE_DATA[1]", "TOOL_DATA[2]")),
        ("$BASE=B\nFDAT_ACT=FQ\nLIN P1", Stand(None, None)),  # of which nothing is known
        ("LIN P1[2] WITH $VEL.CP=1", Stand(None, None)),
    ],
)
def test_a_krl_motion_goes_by_what_was_set_before_it(text: str, stand: Stand) -> None:
    taught = fdats("FDAT FP7={TOOL_NO 2,BASE_NO 1,IPO_FRAME #BASE}")
    assert uses(text, taught, "") == {"P1": {stand: "PTP" in text.upper()}}


def test_a_point_between_motions_of_several_frames_has_all_of_them() -> None:
    text = "LIN P1\n$BASE=B\nLIN P1\nPTP P1\nCIRC P2, {X 1}, CA 90\nLIN_REL P3\nP4=P1\n"
    found = uses(text, {}, "file:")
    assert found["P1"] == {Stand(None, None): False, Stand("B", None): True}
    assert found["P2"] == found[f"file:@{text.index('{')}"] == {Stand("B", None): False}
    assert set(found) == {"P1", "P2", f"file:@{text.index('{')}"}


def test_frames_of_taught_points() -> None:
    text = "FDAT FP1={TOOL_NO 0,BASE_NO 12}\nDECL FDAT FP2 = {BASE_NO -1,IPO_FRAME #TCP}\n"
    assert fdats(text) == {
        **dict.fromkeys(("XP1", "P1"), Stand("BASE_DATA[12]", BASE_ITSELF)),
        **dict.fromkeys(("XP2", "P2"), Stand(None, None, fixed=True)),
    }


def test_frames_that_a_krl_text_states() -> None:
    text = "BASE_DATA[ 3 ]={x 1,Y -2.5,Z 3,A 4,B 5,C 6E1}\nODD={X 1,Y 2,Z 3,A 4,B 5}\n$BASE={X 7,Y 2,Z 3,A 4,B 5,C 6}\n"
    assert frames(text, "f") == {
        "BASE_DATA[3]": (1.0, -2.5, 3.0, 4.0, 5.0, 60.0),
        f"$BASE@f{text.index('={X 7')}": (7.0, 2.0, 3.0, 4.0, 5.0, 6.0),
    }


@pytest.mark.parametrize(
    ("motion", "name", "move"),
    [
        ("MoveL p1,v100,fine,gun", "p1", Move("wobj0", "gun")),
        ("MoveL P1,v100,fine,Gun\\WObj:=Fix", "p1", Move("fix", "gun")),
        ("MoveAbsJ\\Conc,p1\\NoEOffs,v100,fine,gun", "p1", Move("wobj0", "gun")),
        ("MoveC p0,p1,v100,fine,gun", "p1", Move("wobj0", "gun")),
        ("MoveLDO p1,v100,fine,gun,do1,1", "p1", Move("wobj0", "gun")),
        ("MoveJAO p1,v100,fine,gun,ao1,5", "p1", Move("wobj0", "gun")),
        ("MoveLSync p1,v100,fine,gun,\"proc\"", "p1", Move("wobj0", "gun")),
        ("MoveLDO p1,v100,fine,gun\\WObj:=fix,do1,1", "p1", Move("fix", "gun")),
        ("MoveL p1{3},v100,z10\\Inpos:=i,gun", "p1", Move("wobj0", "gun")),
        ("MoveL p1,v100", "p1", Move("wobj0", None)),
    ],
)  # fmt: skip
def test_a_rapid_motion_names_its_target_and_its_tool(motion: str, name: str, move: Move) -> None:
    text = f"MODULE m\n {motion};\nENDMODULE"
    found = moves(text)
    assert found.names[name] == [move] and "p9" not in found.names
    begin, end = text.index(motion.split(maxsplit=1)[0]), text.index(";")
    for place in (begin + len(motion.split(maxsplit=1)[0].partition("\\")[0]) + 1, end - 1):
        assert found.of_place(place) == [move]
    for place in (0, begin, end, len(text) - 1):
        assert found.of_place(place) == []


@pytest.mark.parametrize(
    ("head", "checked"), [("", "JL"), ("ConfL\\Off;", "J"), ("confj \\ off;", "L"), ("ConfL\\On;", "JL")]
)
def test_motions_look_at_configurations_unless_they_are_told_not_to(head: str, checked: str) -> None:
    found = moves(f"{head} MoveJ a,v,z,t; MoveAbsJ b,v,z,t; MoveL c,v,z,t; MoveC d,e,v,z,t;")
    assert {n: found.names[n][0].checked for n in "abcde"} == {
        n: ("J" if n in "ab" else "L") in checked for n in "abcde"
    }


def test_frames_that_a_rapid_module_states() -> None:
    pose, half = "[[1,2,3],[1,0,0,0]]", "[[10,0,0],[0.7071068,0,0,0.7071068]]"
    text = f"""PERS wobjdata A:=[FALSE,TRUE,"",{half},{pose}];  PERS wobjdata b:=[FALSE,FALSE,"u",{pose},{pose}];
PERS wobjdata c:=[TRUE,TRUE,"",{pose},{pose}]; ! PERS wobjdata d:=[FALSE,TRUE,"",{pose},{pose}];
PERS tooldata E:=[TRUE,{pose},[1,[0,0,1],[1,0,0,0],0,0,0]]; PERS tooldata f:=[FALSE,{pose},[1,[0,0,1],[1,0,0,0],0,0,0]];
"""
    comment = text.index("!")
    mask = text[:comment] + " " * (text.index("\n", comment) - comment) + text[text.index("\n", comment) :]
    cell = cell_of(text, mask)
    assert set(cell.frames) == {"a", "e"} and cell.frames["e"] == (1, 2, 3, 1, 0, 0, 0)
    # a quarter turn about z takes (1, 2) to (-2, 1)
    np.testing.assert_allclose(cell.frames["a"], (8, 1, 3, 0.5**0.5, 0, 0, 0.5**0.5), atol=1e-6)
    assert cell.moved == {
        "b": "a mechanical unit moves this work object",
        "c": "the robot holds this work object",
        "f": "this tool stands in the cell",
    }


def program(*names: tuple[str | None, str | None], form: Euler | Quaternion | None = None) -> Program:
    """Targets with these names of base and tool, beside a work object and a tool that are stated."""
    numbers = tuple(Number(k, k + 1, str(k)) for k in range(6))
    targets = tuple(Target(1, "p", "pose", numbers, (), base, tool) for base, tool in names)
    stated = {"Fix": (100.0, 0.0, 0.0, 0.0, 0.0, 0.0), "GUN": (0.0, 0.0, 50.0, 0.0, 0.0, 0.0)}
    return Program("", targets, (), form or Euler(), {}, stated)


def places(told: Told | str) -> tuple[list[float], list[float] | None]:
    assert isinstance(told, Told)
    assert told.base.shape == (4, 4) and (told.tool is None or told.tool.shape == (4, 4))
    return told.base[:3, 3].tolist(), None if told.tool is None else told.tool[:3, 3].tolist()


def test_frames_of_a_target_come_from_the_program_or_from_the_user() -> None:
    text = program((None, None), ("fix", "gun"), (BASE_ITSELF, BASE_ITSELF), ("cell", "pen"))
    bare = Frames(text, Cell())
    assert places(bare.of(text.targets[0])) == ([0, 0, 0], None)
    assert places(bare.of(text.targets[1])) == ([100, 0, 0], [0, 0, 50])
    assert places(bare.of(text.targets[2])) == ([0, 0, 0], [0, 0, 0])
    why = "told in cell, whose numbers are not known here: --frame 'cell=x,y,z,a,b,c in mm and deg'"
    assert bare.of(text.targets[3]) == why
    given = Frames(text, Cell("1,2,3,0,0,0", "4,5,6,0,0,0", {"Cell": "7,8,9,0,0,0", "FIX": "9,9,9,0,0,0"}))
    assert places(given.of(text.targets[0])) == ([1, 2, 3], [4, 5, 6])
    assert places(given.of(text.targets[1])) == ([9, 9, 9], [0, 0, 50])  # what the user says goes first
    assert places(given.of(text.targets[2])) == ([0, 0, 0], [0, 0, 0])
    assert places(given.of(text.targets[3])) == ([7, 8, 9], [4, 5, 6])


def test_one_tool_without_numbers_is_the_machine_files_and_of_two_nobody_knows() -> None:
    one = program((None, "pen"), (None, "PEN"), (None, "gun"))
    told = Frames(one, Cell()).of(one.targets[0])
    assert isinstance(told, Told) and told.tool is None and told.assumed == "pen"
    said = Frames(one, Cell(tool="4,5,6,0,0,0")).of(one.targets[0])
    assert isinstance(said, Told) and said.assumed is None
    two = program((None, "pen"), (None, "brush"))
    assert str(Frames(two, Cell()).of(two.targets[0])).startswith(
        "for the tool pen, whose numbers are not known"
    )
    assert shown_name("$BASE@f12") == "$BASE"


@pytest.mark.parametrize(
    ("form", "numbers", "found"),
    [
        (Euler(), "1,2,3,0,0", "expected 6 numbers"), (Euler(), "1,2,3,0,0,x", "expected 6 numbers"),
        (Euler(), "1,2,3,0,0,nan", "expected 6 numbers"), (Euler(), "1,2,1.1e9,0,0,0", "expected 6 numbers"),
        (Euler(), "1,2,1e9,0,0,0", ""), (Quaternion(), "1,2,3,1,0,0,0", ""), (Quaternion(), "1,2,3,0.996,0,0,0", ""),
        (Quaternion(), "1,2,3,0.99,0,0,0", "a quaternion of length 1"), (Quaternion(), "1,2,3,1.006,0,0,0", "of length 1"),
    ],
)  # fmt: skip
def test_numbers_of_a_frame_that_are_no_pose_are_refused(
    form: Euler | Quaternion, numbers: str, found: str
) -> None:
    text = program(("a", None), form=form)
    if not found:
        Frames(text, Cell(base=numbers))
        return
    for cell, where in (
        (Cell(base=numbers), "--base"),
        (Cell(tool=numbers), "--tool"),
        (Cell(frames={"a": numbers}), "--frame a"),
    ):
        with pytest.raises(InputError, match=f"^{where}: .*{found}"):
            Frames(text, cell)


@pytest.mark.parametrize(("number", "known"), [(1e9, True), (1.1e9, False), (-1.1e9, False)])
def test_a_stated_frame_with_a_number_beyond_all_machines_is_not_known(number: float, known: bool) -> None:
    text = replace(program(("far", None)), frames={"far": (0.0, number, 0.0, 0.0, 0.0, 0.0)})
    told = Frames(text, Cell()).of(text.targets[0])
    assert isinstance(told, Told) is known
    assert known or str(told).startswith("told in far, whose numbers are not known here")


def test_the_shape_of_an_arm_is_that_of_its_drawing(machine: Machine) -> None:
    """Against the same shapes worked out in numpy from the table."""
    q = np.random.default_rng(2).uniform(-2.5, 2.5, (200, 6))
    found = ArmShape(machine, {}).of(q)
    assert found.tolist() == [list(shape(DRAWN, row)) for row in q]
    assert all(0.1 < share < 0.9 for share in found.mean(axis=0))


def test_all_ways_to_take_a_pose_are_found_once_and_each_is_told_by_its_numbers(machine: Machine) -> None:
    solver = PoseSolver(machine)
    branches = Branches(machine, solver)
    q = joints(3, seed=11)
    poses = solver.forward(q)[0]
    found = branches.found(poses, [()] * len(q), None)
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    for row, some, pose in zip(q, found, poses, strict=True):
        assert np.min(np.max(np.abs(np.remainder(some - row + np.pi, 2 * np.pi) - np.pi), axis=1)) < 1e-6
        np.testing.assert_allclose(
            solver.forward(some)[0], np.broadcast_to(pose, (len(some), 4, 4)), atol=1e-5
        )
        assert ((some >= low - 1e-9) & (some <= high + 1e-9)).all()
        for k, one in enumerate(some):
            others = np.delete(some, k, axis=0)
            apart = np.abs(np.remainder(others - one + np.pi, 2 * np.pi) - np.pi)
            assert len(others) == 0 or np.min(np.max(apart, axis=1)) > 1e-3
            told = branches.chosen(
                some, np.zeros(6), StatusTurn(), tuple(map(float, status_turn(DRAWN, one)))
            )
            assert told.q is not None and status_turn(DRAWN, told.q) == status_turn(DRAWN, one)
        near = branches.chosen(some, row + 0.01, None, ())
        assert near.q is not None
        np.testing.assert_allclose(near.q, row, atol=1e-6)
        np.testing.assert_allclose(solver.forward(flipped(row))[0][0], pose, atol=1e-5)  # a spherical wrist
    assert "cannot take this pose" in branches.chosen(np.zeros((0, 6)), q[0], None, ()).why


def test_axis_6_is_told_by_whole_turns_next_to_where_it_was(machine: Machine) -> None:
    """It turns by 400 deg either way: of several turns of one pose the one next to the joints before."""
    branches = Branches(machine, PoseSolver(machine))
    q = joints(1)[0]
    q[5] = 0.5
    for before in (q[5] - 2 * np.pi, q[5], q[5] + 2 * np.pi):
        start = q.copy()
        start[5] = before + 0.2
        found = branches.chosen(q[None], start, None, ()).q
        assert found is not None
        assert found[5] == pytest.approx(before)
    for turn, angle in ((0, 0.5), (32, 0.5 - 2 * np.pi)):
        numbers = (float(status_turn(DRAWN, q)[0]), float(status_turn(DRAWN, q)[1] & ~32 | turn))
        told = branches.chosen(q[None], q, StatusTurn(), numbers).q
        assert told is not None
        assert told[5] == pytest.approx(angle)
    none = (0.0, float(status_turn(DRAWN, q)[1] ^ 1))
    assert "have its configuration" in branches.chosen(q[None], q, StatusTurn(), none).why


SLIDING = """schema: truepose/machine/1
name: gantry
mechanism:
  type: serial
  joints: [{name: q1, kind: prismatic, r: 10, range: [-300, 200]}, {name: q2, kind: revolute, alpha: 90, d: 40%s}]
frames: {tool: {in: flange, xyz: [0, 30, 40]}}
"""


@pytest.mark.parametrize(("more", "reach"), [("", 390.0), (", r: 30", 400.0)])
def test_a_slide_reaches_as_far_as_its_range(more: str, reach: float, tmp_path: Path) -> None:
    """300 mm of stroke, 40 (and 30, across) of a link, 50 of a tool; without a range there is no end."""
    for text, most in (
        (SLIDING % more, reach),
        ((SLIDING % more).replace(", range: [-300, 200]", ""), np.inf),
    ):
        (tmp_path / "m.yaml").write_text(text)
        assert ArmShape(load_machine(tmp_path / "m.yaml"), {}).reach()[1] == pytest.approx(most)
