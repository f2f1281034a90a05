"""Generated C of six-joint arms against their own product of transformations: all solutions, near and far, one and many."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

import numpy as np
import pytest

from support.examples import by_day
from support.generated_c import needs_compiler
from support.six_joint_arms import ARMS, BUILT, DRAWN, BuiltArm, apart, built, counted, errors, search
from truepose.arrays import Array
from truepose.codegen.chain import ChainExpressions
from truepose.codegen.layout import layout_of
from truepose.codegen.leaves.all_solutions.solutions import branches_of
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.velocities import chain_of

pytestmark = needs_compiler
KINDS = {
    "ur": "parallel",
    "turned": "parallel",
    "puma": "wrist",
    "upside": "wrist",
    "ur_built": "parallel",
    "turned_built": "parallel",
    "puma_built": "wrist",
}
FLAGS: tuple[tuple[str, ...], ...] = ((), ("-march=native",), ("-DTRUEPOSE_SCALAR",))
SIZES = (0, 1, 2, 3, 4, 5, 7, 8, 9, 15, 17, 33)
"""Rows of a call: about one vector of 2, 4, 8 or 16 lanes, and several."""


def meets(made: BuiltArm, q: Array, wanted: Array) -> None:
    """Poses at q (n, 6) are those wanted (n, 12), as promised in double precision."""
    error = errors(made.arm.poses(q), wanted)
    assert np.linalg.norm(error[:, :3], axis=1).max(initial=0.0) < 1e-6
    assert np.linalg.norm(error[:, 3:], axis=1).max(initial=0.0) < 1e-9
    low, high = made.arm.limits
    assert (q >= low - 1e-9).all()
    assert (q <= high + 1e-9).all()


@pytest.mark.parametrize("name", ARMS)
def test_the_closed_form_next_to_an_arm_is_recognised(tmp_path: Path, name: str) -> None:
    machine = ARMS[name].machine(tmp_path)
    model = symbolic_model(machine, machine.effects)
    layout, chain = layout_of(model, "double"), chain_of(model)
    assert chain is not None
    found = branches_of(model, ChainExpressions.of(model, chain), layout.reach, layout.turns)
    assert (found.kind if found else None) == KINDS.get(name)
    for k in range(6):  # a joint that does not repeat after a turn
        turns = (True,) * k + (False,) + (True,) * (5 - k)
        assert branches_of(model, ChainExpressions.of(model, chain), layout.reach, turns) is None


@pytest.mark.parametrize("name", DRAWN)
def test_every_start_is_a_solution_of_the_drawn_arm(root_directory: Path, name: str) -> None:
    made = built(root_directory, name)
    numbers = []
    q = made.arm.readings(200, seed=5)
    for readings, pose in zip(q, made.arm.poses(q), strict=True):
        starts = made.starts(pose)
        error = errors(made.arm.poses(starts), np.tile(pose, (len(starts), 1)))
        assert np.linalg.norm(error[:, :3], axis=1).max() < 1e-6
        assert np.linalg.norm(error[:, 3:], axis=1).max() < 1e-9
        assert apart(starts, readings).min() < 1e-6
        numbers.append(len(starts))
    assert set(numbers) <= {2, 4, 6, 8}
    assert numbers.count(8) > 20


@pytest.mark.parametrize("name", by_day(BUILT, "ur_built"))
def test_all_solutions_are_found(root_directory: Path, name: str) -> None:
    made = built(root_directory, name)
    low, high = made.arm.limits
    middle = 0.5 * (low + high)
    rng = np.random.default_rng(11)
    total = 0
    q = made.arm.readings(30, seed=7)
    for readings, pose in zip(q, made.arm.poses(q), strict=True):
        code, rows = made.ik_all(pose)
        assert code == 0
        meets(made, rows, np.tile(pose, (len(rows), 1)))
        pairs = apart(rows[:, None], rows[None]) + 9.0 * np.eye(len(rows))
        assert pairs.min() > 1e-6  # distinct
        starts = np.vstack([readings, rng.uniform(-np.pi, np.pi, (120, 6))])
        others = search(made.arm, pose, starts)
        others = middle + np.mod(others - middle + np.pi, 2 * np.pi) - np.pi
        inside = others[((others > low + 1e-6) & (others < high - 1e-6)).all(axis=1)]
        total += len(inside)
        for other in inside:
            assert apart(rows, other).min() < 1e-5, (readings, other)
    assert total > 300


def test_a_wrist_may_pass_closer_to_the_first_axis_than_the_drawn_one(root_directory: Path) -> None:
    """There the drawn arm has no solution: its offset is longer than the way that is left."""
    made = built(root_directory, "ur_built")
    readings = np.array(
        [5.875893791186119, 2.761048319722798, 4.112426436670084, -2.72481, 3.355784, -2.099565]
    )
    pose = made.arm.poses(readings[None])[0]
    code, rows = made.ik_all(pose)
    assert code == 0
    meets(made, rows, np.tile(pose, (len(rows), 1)))


@pytest.mark.parametrize("name", by_day(BUILT, "ur_built"))
def test_any_pose_is_reached_from_any_guess(root_directory: Path, name: str) -> None:
    made = built(root_directory, name)
    q, guesses = made.arm.readings(2000, seed=1), made.arm.readings(2000, seed=2)
    poses = made.arm.poses(q)
    found = [made.ik(pose, guess) for pose, guess in zip(poses, guesses, strict=True)]
    assert {code for code, _ in found} == {0}
    meets(made, np.array([joints for _, joints in found]), poses)


@pytest.mark.parametrize("name", by_day(BUILT, "ur_built"))
def test_no_inverse_takes_more_evaluations_than_it_says(root_directory: Path, name: str) -> None:
    """Poses out of reach by little and by much, and in reach; the bound is spent, and not more than spent."""
    made = counted(root_directory, name)
    header = (made.directory / f"{name}_kin.h").read_text()
    limit = int(re.findall(rf"#define {name}_MAX_ITER (\d+)", header)[0])
    count = ctypes.c_int.in_dll(made.library, "evaluations")
    poses, guesses = made.arm.poses(made.arm.readings(60, seed=3)), made.arm.readings(60, seed=4)
    poses[:, [3, 7, 11]] *= np.linspace(0.9, 3.0, 60)[:, None]
    spent = []
    for pose, guess in zip(poses, guesses, strict=True):
        count.value = 0
        made.ik(pose, guess)
        spent.append(count.value)
    assert 0.9 * limit < max(spent) <= limit


@pytest.mark.parametrize("name", by_day(BUILT, "ur_built"))
def test_a_path_of_small_steps_stays_on_its_branch(root_directory: Path, name: str) -> None:
    made = built(root_directory, name)
    low, high = made.arm.limits
    rng = np.random.default_rng(4)
    centre, width = 0.5 * (low + high), np.minimum(high - low, 4.0)
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 6))
    way = np.linspace(0.0, 6.0, 1500)[:, None]
    path = centre + 0.4 * width * np.sin(phase + rate * way)
    sizes = np.linalg.svd(made.arm.jacobians(path) / [[[300]] * 3 + [[1]] * 3], compute_uv=False)
    clear = sizes[:, -1] > 0.03  # a singular configuration joins branches: nothing is promised there
    assert clear.mean() > 0.5
    at = path[0]
    for wanted, pose, far in zip(path, made.arm.poses(path), clear, strict=True):
        code, at = made.ik(pose, at)
        assert code == 0
        if far:
            assert np.abs(at - wanted).max() < 1e-6
        at = wanted.copy()


@pytest.mark.parametrize("flags", FLAGS, ids=["plain", "native", "one-lane"])
@pytest.mark.parametrize("name", by_day(["ur_built", "puma_built"], "ur_built"))
def test_many_rows_are_each_row(root_directory: Path, name: str, flags: tuple[str, ...]) -> None:
    made = built(root_directory, name, flags)
    q, others = made.arm.readings(33, seed=21), made.arm.readings(33, seed=22)
    poses = made.arm.poses(q)
    poses[5, 3] += 9000.0  # out of reach
    poses[11, 0] = np.nan
    guesses = np.where(np.arange(33)[:, None] % 3 == 0, others, q + 0.01)
    guesses[19, 2] = np.inf
    low, high = made.arm.limits
    guesses = np.clip(guesses, low - 1, high + 1)
    guesses[19, 2] = np.inf
    alone = [made.ik(pose, guess) for pose, guess in zip(poses, guesses, strict=True)]
    codes = np.array([code for code, _ in alone])
    assert set(codes) == {0, 1, 4}
    for n in SIZES:
        failed, joints, found = made.many("ik_n", poses[:n], guesses[:n])
        np.testing.assert_array_equal(found, codes[:n])
        assert failed == np.count_nonzero(codes[:n])
        np.testing.assert_allclose(
            joints, np.array([v for _, v in alone[:n]]).reshape(n, 6), rtol=0, atol=1e-7
        )
        meets(made, joints[found == 0], poses[:n][found == 0])
        failed, tools, found = made.many("fk_n", q[:n], width=12)
        assert failed == 0
        np.testing.assert_allclose(tools, made.arm.poses(q[:n]), rtol=0, atol=1e-9)
    order = np.random.default_rng(0).permutation(33)
    _, joints, found = made.many("ik_n", poses[order], guesses[order])
    np.testing.assert_array_equal(found, codes[order])
    np.testing.assert_allclose(joints, np.array([v for _, v in alone])[order], rtol=0, atol=1e-7)


@pytest.mark.parametrize("name", by_day(["ur_built", "puma_built"], "ur_built"))
def test_other_constants_are_another_machine(root_directory: Path, name: str, tmp_path: Path) -> None:
    """The C of one calibration with the constants of the drawing, and of that drawing."""
    made, drawn = built(root_directory, name), built(root_directory, name.removesuffix("_built"))
    machine = drawn.arm.machine(tmp_path)
    p = np.array(symbolic_model(machine, machine.effects).p_home)
    q, guesses = drawn.arm.readings(40, seed=31), drawn.arm.readings(40, seed=32)
    poses = drawn.arm.poses(q)
    failed, tools, _ = made.many("fk_n", q, p=p, width=12)
    assert failed == 0
    np.testing.assert_allclose(tools, poses, rtol=0, atol=1e-9)
    for readings, guess, pose in zip(q, guesses, poses, strict=True):
        code, joints = made.ik(pose, guess, p)
        assert code == 0
        meets(drawn, joints[None], pose[None])
        (code, rows), (_, own) = made.ik_all(pose, p), drawn.ik_all(pose)
        assert code == 0
        assert len(rows) == len(own), readings
        assert apart(rows[:, None], own[None]).min(axis=1).max() < 1e-5
