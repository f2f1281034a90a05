"""Programs of endless lines, brackets and numbers are read to their end: what is slow here hangs."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from truepose.errors import InputError
from truepose.identification.compensation.inverse import PoseSolver
from truepose.identification.leaves.programs.arm_shape import ArmShape
from truepose.identification.leaves.programs.correct import correct
from truepose.identification.leaves.programs.dialects import DIALECTS
from truepose.identification.leaves.programs.program import closing
from truepose.models.machine.machine import Machine

N = 10_000
WORST = {
    "kuka": ("{" * N, "{X 1" * N, "FDAT A={" * N, "$" + "a" * N + " = {", "PTP P " + " " * N + "!", "PTP P " + "C_X " * N + "!",
             "a[" + "1" * N, "PTP {X " + "9" * N + ",Y 1}", "a = {" * N, "DECL " * N + "x={X 1}", '"' * N),
    "rapid": ("[[" + "1" * N, "[[1,1," + "1" * N + " " * N, "CONST robtarget a{" * N, "Offs(" * N, "MoveL " + "," * N,
              "a" + ".b" * N + " ;", "wobjdata a:=[TRUE,FALSE," * N, "[" * N),
    "urscript": ("movej(" * N, "p[" + "1" * N, "p" + " " * N, "movej(" + "(" * N + ")" * N + ")", "set_tcp(" * N,
                 "".join(f"a{k}=p[1,2,3,4,5,6]\n" for k in range(N // 10))),
    "csv": ("x" + " " * N + "[", "x,y,z,rx,ry,rz\n" + "1," * N, "x [" * N, '"' * N),
}  # fmt: skip


@pytest.mark.parametrize(("dialect", "k"), [(d, k) for d, texts in WORST.items() for k in range(len(texts))])
def test_no_text_is_read_for_ever(machine: Machine, dialect: str, k: int) -> None:
    with contextlib.suppress(InputError):
        DIALECTS[dialect].read(WORST[dialect][k], machine)


def test_a_bracket_closes_where_its_depth_is_reached_again() -> None:
    text = ")(a[b]{c)d)]"
    assert [closing(text, k) for k in (1, 3, 6)] == [10, 5, 8]
    assert closing("((a)", 0) is None


def test_numbers_beyond_all_machines_are_left_and_told(machine: Machine) -> None:
    text = "LIN {X 1e300,Y 10,Z 500,A 0,B 90,C 0}\nPTP {A1 10,A2 -20,A3 30,A4 0,A5 40,A6 " + "9" * 400 + "}\n"
    done = correct(machine, DIALECTS["kuka"].read(text, machine))
    assert not done.done
    assert len(done.left) == 2
    assert all("beyond 1e+09" in left.why and len(left.why) < 100 for left in done.left)


def test_no_joints_bring_the_tool_farther_than_its_reach(machine: Machine) -> None:
    solver = PoseSolver(machine)
    root, most = ArmShape(machine, {}).reach()
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (5000, 6))
    away = np.linalg.norm(solver.forward(q)[0][:, :3, 3] - root, axis=1)
    assert 0.98 * most < away.max() <= most  # a bound that is loose by metres would spare nothing


def test_thousands_of_poses_out_of_reach_are_told(machine: Machine) -> None:
    """As where a program's base is wrong: each would otherwise be searched for from every start, 50 ms a pose."""
    n = 3000
    text = "".join(f"LIN {{X {9000 + k},Y 0,Z {k / 7:.3f},A {k},B 90,C 0}}\n" for k in range(n))
    done = correct(machine, DIALECTS["kuka"].read(text, machine))
    assert not done.done
    assert sum("cannot take this pose" in left.why for left in done.left) == n


OBJECTS = {
    "[[100,0,0],[0.5,0,0,0]],[[0,50,0],[1,0,0,0]]": "the square of a quaternion of it is not 1",
    "[[0,50,0],[1,0,0,0]],[[100,0,0],[1.006,0,0,0]]": "the square of a quaternion of it is not 1",
    "[[1E12,0,0],[1,0,0,0]],[[0,50,0],[1,0,0,0]]": "whose numbers are not known here",
    "[[10,0,0],[0.996,0,0,0]],[[0,50,0],[1,0,0,0]]": "",
}


@pytest.mark.parametrize("numbers", OBJECTS)
def test_a_work_object_whose_numbers_are_no_pose_is_not_taken_for_one(machine: Machine, numbers: str) -> None:
    text = f"""MODULE m
 TASK PERS wobjdata table:=[FALSE,TRUE,"",{numbers}];
 CONST robtarget p:=[[400,0,400],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
 PROC main()
  MoveL p,v100,fine,tool0\\WObj:=table;
 ENDPROC
ENDMODULE
"""
    done = correct(machine, DIALECTS["rapid"].read(text, machine))
    assert (len(done.done), len(done.left)) == ((0, 1) if OBJECTS[numbers] else (1, 0))
    assert all(OBJECTS[numbers] in left.why for left in done.left)


@pytest.mark.parametrize(("turn", "assumed"), [("[1,0,0,0]", ()), ("[0.5,0,0,0]", ("odd",))])
def test_a_tool_whose_numbers_are_no_pose_is_said_to_be_assumed(
    machine: Machine, turn: str, assumed: tuple[str, ...]
) -> None:
    text = f"""MODULE m
 PERS tooldata odd:=[TRUE,[[0,0,100],{turn}],[1,[0,0,50],[1,0,0,0],0,0,0]];
 CONST robtarget p:=[[400,0,400],[0,0,1,0],[0,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
 PROC main()
  MoveL p,v100,fine,odd;
 ENDPROC
ENDMODULE
"""
    assert correct(machine, DIALECTS["rapid"].read(text, machine)).assumed == assumed
