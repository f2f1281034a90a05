"""How an arm stands and how far it reaches, for arms whose axes do not meet, and targets as what they mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.program_robots import arms, joints, machine_file
from truepose.identification.compensation.inverse import PoseSolver
from truepose.identification.leaves.programs.meaning import (
    Branches,
    Robot,
    by_tool,
    flipped,
    joint_units,
    joint_values,
)
from truepose.identification.leaves.programs.program import Euler, Program, RotationVector, StatusTurn, Told
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
DRAWN, REAL = arms()


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return load_machine(machine_file(tmp_path_factory.mktemp("arm"), REAL))


def test_targets_of_one_tool_are_taken_together() -> None:
    gun, pen = np.diag([1.0, 2.0, 3.0, 1.0]), np.eye(4)
    told = [Told(np.eye(4), tool) for tool in (gun, None, gun.copy(), pen, None)]
    found = by_tool(list(zip((4, 7, 1, 2, 9), told, strict=True)))
    assert [rows for _, rows in found] == [[4, 1], [7, 9], [2]]
    assert [None if tool is None else tool[0, 0] for tool, _ in found] == [1.0, None, 1.0]
    assert found[0][0] is gun


def test_joints_are_told_in_their_own_units_or_in_those_of_their_kind(machine: Machine) -> None:
    robot = Robot(machine, {})
    form = RotationVector(("mm",) * 3, ("deg",) * 3, (4,) * 6, "")
    for own, units, values in (
        ({"rad": "deg", "mm": "mm"}, ["deg"] * 6, np.radians([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])),
        ({"q2": "mrad", "rad": "deg"}, ["deg", "mrad", *["deg"] * 4], np.radians([1.0, np.degrees(2e-3), 3, 4, 5, 6])),
        ({}, ["rad"] * 6, np.arange(1.0, 7.0)),
    ):  # fmt: skip
        program = Program("", (), (), form, own)
        assert joint_units(robot, program) == [("rad", unit) for unit in units]
        np.testing.assert_allclose(joint_values(robot, program, np.arange(1.0, 7.0).tolist()), values)


def test_a_wrist_that_is_turned_over_comes_back_after_two(machine: Machine) -> None:
    q = joints(2)
    assert flipped(q[0])[:3].tolist() == q[0, :3].tolist()
    twice = flipped(flipped(q[0])) - q[0]
    np.testing.assert_allclose(twice, [0, 0, 0, 2 * np.pi, 0, 2 * np.pi], atol=1e-12)
    assert flipped(q[0, :5]).tolist() == q[0, :5].tolist()


def test_the_search_for_a_configuration_ends_where_it_was_found(machine: Machine) -> None:
    """All solutions of a pose without one; those of one with its numbers are among them."""
    solver = PoseSolver(machine)
    branches, q = Branches(machine, solver), joints(2, seed=21)
    poses = solver.forward(q)[0]
    shapes = branches.found(poses, [()] * 2, StatusTurn())
    for k in range(2):
        turns = [float(sum(1 << a for a in range(6) if row[a] < 0)) for row in shapes[k]]
        assert len(shapes[k]) >= 2 and len(set(turns)) > 1
    none = branches.found(poses, [(0.0, 64.0 + 63.0)] * 2, None)
    assert [len(one) for one in none] == [len(one) for one in shapes]
    far = poses.copy()
    far[:, 0, 3] += 1e5
    assert [one.shape for one in branches.found(far, [()] * 2, None)] == [(0, 6)] * 2
    assert branches.found(poses[:0], [], None) == []


def test_two_solutions_that_have_the_same_numbers_are_told(machine: Machine) -> None:
    """A quarter turn of axis 1 and of axis 4 apart they have the same signs: nobody knows which is meant."""
    branches = Branches(machine, PoseSolver(machine))
    q = np.array([0.4, 0.3, -0.2, 0.3, 0.9, 0.4])
    other = q + np.array([0.1, 0.0, 0.0, 0.2, 0.0, 0.0])
    status = next(
        s for s in range(8) if branches.chosen(q[None], q, StatusTurn(), (float(s), 4.0)).q is not None
    )
    both = np.array([q, other])
    found = branches.chosen(both, q, StatusTurn(), (float(status), 4.0))
    assert (
        found.q is None
        and found.why == f"several configurations of the joints have these numbers ({status}, 4)"
    )
    near = branches.chosen(both, other, None, ())
    assert near.q is not None and near.q.tolist() == other.tolist()
    none = branches.chosen(both, q, StatusTurn(), (0.0, 63.0))
    assert none.why == "no joints of the nominal machine that reach it have its configuration (0, 63)"


def test_euler_angles_go_on_beyond_half_a_turn() -> None:
    """Of no poses there are no numbers."""
    assert Euler().numbers(np.zeros((0, 4, 4)), np.zeros((0, 6))).shape == (0, 6)
    near = np.array([[1.0, 2.0, 3.0, 170.0, 20.0, -175.0]])
    pose = Euler().poses(near + np.array([0, 0, 0, 15.0, 0, -10.0]))
    np.testing.assert_allclose(Euler().numbers(pose, near), [[1, 2, 3, 185, 20, -185]], atol=1e-9)


def test_an_arm_without_ranges_is_searched_over_a_turn_of_each_joint(machine: Machine) -> None:
    actuators = tuple(replace(a, range=None) for a in machine.mechanism.actuators)
    free = replace(machine, mechanism=replace(machine.mechanism, actuators=actuators))
    solver, q = PoseSolver(free), joints(1)
    branches = Branches(free, solver)
    found = branches.found(solver.forward(q)[0], [()], None)[0]
    apart = np.abs(np.remainder(found - q[0] + np.pi, 2 * np.pi) - np.pi)
    assert np.min(np.max(apart, axis=1)) < 1e-6
    far = branches.chosen(q, q[0] + 2 * np.pi, None, ()).q
    assert far is not None
    np.testing.assert_allclose(np.abs(far), np.abs(far).clip(0.0, 2 * np.pi + 1e-9))
