"""Programs of robots with fewer than six joints: their poses are met in what the joints can hold. mm, rad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.command import input_error
from support.partial_machines import as_built, partial_machine, readings
from support.program_robots import numbers_of
from truepose.identification.compensation.inverse import PoseSolver
from truepose.identification.leaves.programs.correct import correct
from truepose.identification.leaves.programs.dialects import DIALECTS
from truepose.identification.leaves.programs.frames import Cell
from truepose.identification.leaves.programs.robot import Robot


@pytest.mark.parametrize("dialect", ["kuka", "rapid"])
@pytest.mark.parametrize("name", ["scara", "pallets", "gantry", "mill"])
def test_the_nominal_controller_is_told_where_the_real_tool_is_right(
    name: str, dialect: str, tmp_path: Path
) -> None:
    """The controller solves the drawing for what is written; the numbers of a configuration, which are an arm's, stay."""
    drawn = partial_machine(tmp_path, name)
    machine = as_built(drawn, 9, length=0.1, angle=3e-4)
    robot, solver = Robot(machine, {}), PoseSolver(drawn)
    home = solver.model.q_home
    near = home + 0.1 * (readings(drawn, 6, 10) - home) + [0.0, 0.4, *[0.1] * 9][: len(home)]
    robot.nominal(None)
    goals = robot.solver.forward(near)[0]
    inside = np.linalg.inv(robot.base) @ goals
    if dialect == "kuka":
        lines = [f"LIN {numbers_of(pose, 'kuka')[:-1]},S 2,T 35}}" for pose in inside]
    else:
        lines = [
            f"MoveL [{numbers_of(pose, 'rapid')[1:-1]},[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;"
            for pose in inside
        ]
    program = DIALECTS[dialect].read("\n".join(lines) + "\n", machine)
    done = correct(machine, program, Cell())
    assert len(done.done) == len(lines), done.left
    for one in done.done:
        assert np.max(np.abs(one.before)) > 1e-3
        assert np.max(np.abs(one.after[:3])) < 1e-3  # digits that a program has
        assert np.max(np.abs(one.after[3:])) < 1e-5
        assert not one.reconfigured
    assert ",S 2,T 35}" in done.text or dialect == "rapid"


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        ("kuka", "PTP {{{}}}\n"),
        ("kuka", "PTP {{{},A5 0,A6 0.0,E1 0}}\n"),
        ("kuka", "E6AXIS P={{{},A5 0,A6 0}}\nPTP P\n"),
        ("rapid", "MoveAbsJ [[{},0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n"),
        (
            "rapid",
            "CONST jointtarget p:=[[{},9E9,9E9],[9E9,9E9,9E9,9E9,9E9,9E9]];\nMoveAbsJ p,v100,fine,tool0;\n",
        ),
    ],
)
def test_axis_targets_of_four_axes_have_four_values(tmp_path: Path, dialect: str, text: str) -> None:
    """The nominal machine at the corrected axes stands where the program's axes would put the drawing."""
    drawn = partial_machine(tmp_path, "scara")
    machine = as_built(drawn, 9, length=0.1, angle=3e-4)
    q = readings(drawn, 6, 10)[0]
    units = [a.reading_unit for a in drawn.mechanism.actuators]
    values = [float(np.degrees(v)) if unit == "rad" else float(v) for v, unit in zip(q, units, strict=True)]
    names = [f"A{k + 1} " if dialect == "kuka" else "" for k in range(4)]
    written = ",".join(f"{name}{v:.6f}" for name, v in zip(names, values, strict=True))
    (done,) = correct(machine, DIALECTS[dialect].read(text.format(written), machine), Cell()).done
    assert len(done.numbers) == 4 and np.max(np.abs(done.before[:3])) > 1e-3
    assert np.max(np.abs(done.after[:3])) < 1e-3


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        ("kuka", "PTP {A1 1,A2 2,A3 3,A4 4,A5 5,A6 0}\n"),
        ("rapid", "MoveAbsJ [[1,2,3,4,0,5],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n"),
    ],
)
def test_axes_that_the_robot_has_not_are_refused(tmp_path: Path, dialect: str, text: str) -> None:
    machine = partial_machine(tmp_path, "scara")
    with input_error("found 4 joints, expected 6 joints"):
        correct(machine, DIALECTS[dialect].read(text, machine), Cell())
