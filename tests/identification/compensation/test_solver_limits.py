"""The solver of poses by itself: what it measures a gap in, where a joint's range ends, where it begins anew. mm, rad."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support import MACHINES
from support.calibrated_machines import POLISHER, SIX_AXES, calibrated, path_file
from truepose.codegen.evaluation.compiler import NotCompiledError
from truepose.errors import InputError
from truepose.identification.compensation.compensate import Follower, compensate, joined
from truepose.identification.compensation.inverse import (
    MET,
    CompiledKinematics,
    PoseSolver,
    Reach,
    loop_scales,
    pose_gap,
    shared_out,
)
from truepose.identification.compensation.path_table import commands, csv_text, load_path
from truepose.models import lie
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.task import WHOLE

Array = NDArray[np.float64]
YIELDING = """
effects:
  - {effect: joint-compliance, place: [q5], parameters: {c: {value: 9.0e-6, unit: rad/(N*m)}}}
"""
INSIDE = np.array([0.3, -0.4, 0.5, 0.7, 0.9, 2.0])


def machine_of(folder: Path, text: str = SIX_AXES) -> Machine:
    (folder / "m.yaml").write_text(text, encoding="utf-8")
    return load_machine(folder / "m.yaml")


def test_numbers_of_an_outcome_are_those_of_the_controllers_functions() -> None:
    assert [(r.name, int(r)) for r in Reach] == [
        ("SOLVED", 0), ("UNREACHABLE", 1), ("ITERATION_LIMIT", 2), ("JOINT_RANGE", 3),
    ]  # fmt: skip


def test_a_gap_is_counted_in_parts_of_the_size_and_in_radians(tmp_path: Path) -> None:
    machine = machine_of(tmp_path)
    solver = PoseSolver(machine)
    assert solver.size == 455.0 and MET == 1e-9
    model = solver.model
    gap = pose_gap(model, WHOLE, 200.0, np.ones(0))
    q = np.array([INSIDE, 0.5 * INSIDE])
    poses, _ = solver.forward(q)
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3])
    goal = poses.copy()
    goal[:, :3, :3] = turn.as_matrix().T @ poses[:, :3, :3]
    goal[:, :3, 3] -= [20.0, 40.0, -10.0]
    flat, x = goal.transpose(0, 2, 1).reshape(2, 16), np.zeros((2, 0))
    found, slope = gap(q, x, solver.z, solver.p, flat)
    np.testing.assert_allclose(
        found[..., 0], np.tile([0.1, 0.2, -0.05, *turn.as_rotvec()], (2, 1)), atol=1e-12
    )
    for k in range(6):
        step = 1e-6 * np.eye(6)[k]
        ends = [gap(q + s * step, x, solver.z, solver.p, flat)[0][..., 0] for s in (1, -1)]
        np.testing.assert_allclose(slope[..., k], (ends[0] - ends[1]) / 2e-6, atol=1e-7)


def test_lengths_of_loops_count_in_parts_of_the_size_and_forces_in_parts_of_the_weight(
    tmp_path: Path,
) -> None:
    hexapod = load_machine(MACHINES / "ups.yaml")
    model = symbolic_model(hexapod, hexapod.effects)
    share, unit = loop_scales(hexapod, model, 400.0)
    np.testing.assert_allclose(share, 1.0 / 400.0)
    assert unit.shape == (6,) and share.shape == (6,)
    plain = load_machine(POLISHER)
    weight = sum(mass.kg for mass in plain.masses) * float(np.linalg.norm(plain.gravity or ()))
    assert weight > 9.81
    own, own_unit = loop_scales(plain, symbolic_model(plain, plain.effects), 1000.0)
    yielding = machine_of(tmp_path, POLISHER.read_text(encoding="utf-8") + YIELDING)
    share, unit = loop_scales(yielding, symbolic_model(yielding, yielding.effects), 1000.0)
    n = len(own_unit)
    np.testing.assert_allclose(unit[:n], own_unit)
    np.testing.assert_allclose(unit[n:], weight)
    np.testing.assert_allclose(share[: len(own)], own)
    np.testing.assert_allclose(share[len(own) :], own_unit / weight / 1000.0)
    # where no gravity is stated it is the earth's, and nothing weighs less than a kilogram
    for gravity, masses, force in (
        ((0.0, 0.0, -2.0), plain.masses, weight * 2.0 / 9.80665), (None, plain.masses, weight), (None, (), 9.80665),
    ):  # fmt: skip
        other = replace(yielding, gravity=gravity, masses=masses)
        found = loop_scales(other, symbolic_model(yielding, yielding.effects), 1000.0)[1]
        np.testing.assert_allclose(found[n:], force, rtol=1e-6)


@pytest.mark.parametrize("joint", [0, 4])
@pytest.mark.parametrize("end", [0, 1])
def test_a_range_ends_where_it_is_stated(joint: int, end: int, tmp_path: Path) -> None:
    """But for a billionth of it."""
    machine = machine_of(tmp_path)
    solver = PoseSolver(machine)
    limit = machine.mechanism.actuators[joint].range
    assert limit is not None
    outwards = (-1.0, 1.0)[end]
    for beyond, status in ((-1e-5, Reach.SOLVED), (0.0, Reach.SOLVED), (1e-5, Reach.JOINT_RANGE)):
        q = INSIDE.copy()
        q[joint] = limit[end] + outwards * beyond
        found = solver.inverse(solver.forward(q)[0], q, restarts=0, rewind=False)
        assert found.status.tolist() == [status]
        names = (machine.mechanism.readings[joint],) if status == Reach.JOINT_RANGE else ()
        assert found.saturated(0) == names
        np.testing.assert_allclose(found.q[0], q, atol=1e-6)
        assert found.position[0] < 455.0 * 2 * MET and found.rotation[0] < 2 * MET


def test_a_start_may_be_one_for_all_or_each_its_own(tmp_path: Path) -> None:
    solver = PoseSolver(machine_of(tmp_path))
    q = INSIDE + 0.1 * np.random.default_rng(1).standard_normal((5, 6))
    poses = solver.forward(q)[0]
    one, each = solver.inverse(poses, INSIDE), solver.inverse(poses, np.tile(INSIDE, (5, 1)))
    np.testing.assert_array_equal(one.q, each.q)
    np.testing.assert_allclose(one.q, q, atol=1e-6)
    frame = one.to_frame()
    assert list(frame.columns)[-3:] == ["status", "position", "rotation"] and len(frame) == 5
    none = solver.inverse(poses[:0])
    assert none.q.shape == (0, 6) and none.solved.shape == (0,)


def test_other_constants_are_those_of_the_caller(tmp_path: Path) -> None:
    """A longer tool stands farther out by as much, and asks for the same joints of its own poses."""
    machine = machine_of(tmp_path)
    plain = PoseSolver(machine)
    p = plain.p.copy()
    p[list(plain.model.names).index("tool.z")] += 50.0
    longer = PoseSolver(machine, p)
    both = [s.forward(INSIDE)[0][0] for s in (plain, longer)]
    assert np.linalg.norm(both[1][:3, 3] - both[0][:3, 3]) == pytest.approx(50.0)
    np.testing.assert_allclose(longer.inverse(both[1][None], INSIDE).q[0], INSIDE, atol=1e-7)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_joints_without_a_range_are_tried_over_a_turn_or_the_size(kind: str, tmp_path: Path) -> None:
    text = SIX_AXES.replace(", range: [-170, 170]", "").replace(", range: [-100, 120]", "")
    text = text.replace("{name: q1, kind: revolute, r: 400", f"{{name: q1, kind: {kind}, r: 400")
    solver = PoseSolver(machine_of(tmp_path, text))
    rng = np.random.default_rng(3)
    q = np.tile(INSIDE, (12, 1))
    q[:, 0] = rng.uniform(-3.1, 3.1, 12) if kind == "revolute" else rng.uniform(-430, 430, 12)
    q[:, 2] = rng.uniform(-3.1, 3.1, 12)
    poses = solver.forward(q)[0]
    often = solver.inverse(poses)
    assert often.solved.mean() > 0.6
    np.testing.assert_allclose(solver.forward(often.q[often.solved])[0], poses[often.solved], atol=1e-5)


def test_rows_may_be_solved_a_few_at_a_time(tmp_path: Path) -> None:
    machine = calibrated("polisher", tmp_path)
    _, path = load_path(machine, path_file(machine, tmp_path, 9))
    follower = Follower(machine, path)
    whole = compensate(machine, path)
    rows = np.array([0, 3, 4, 8])
    part = follower.by_numpy(rows, "exact")
    glued = joined([follower.by_numpy(rows[:1], "exact"), follower.by_numpy(rows[1:], "exact")])
    for name in ("nominal", "command", "target", "before", "after"):
        for some in (part, glued):
            np.testing.assert_allclose(getattr(some, name), getattr(whole, name)[rows], atol=1e-8)
    assert part.readings == whole.readings and part.solved_by == "numpy"
    np.testing.assert_allclose(follower.targets(rows), whole.target[rows], atol=1e-9)
    # what is left is what the calibrated machine does with the commands
    assert np.max(np.abs(whole.after[:, :3])) < 1e-6 and np.max(np.abs(whole.before[:, :3])) > 1e-3
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    ends = np.array([low, high, low - 1e-5 * (high - low), high + 1e-5 * (high - low), (low + high) / 2])
    assert follower.within(ends).all(axis=1).tolist() == [True, True, False, False, True]
    assert follower.within(ends).any(axis=1).tolist() == [True, True, False, False, True]


def test_a_reach_is_the_reading_of_a_radian_or_of_the_size(tmp_path: Path) -> None:
    text = SIX_AXES.replace(
        "kind: revolute, r: 400, range: [-170, 170]", "kind: prismatic, range: [-300, 300]"
    )
    machine = machine_of(tmp_path, text)
    _, path = load_path(machine, path_file(machine, tmp_path, 2))
    follower = Follower(machine, path)
    assert follower.size == 455.0
    assert follower.reach.tolist() == [455.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    legs = load_machine(MACHINES / "ups.yaml")
    _, path = load_path(legs, path_file(legs, tmp_path, 2))
    follower = Follower(legs, path)
    gains = [legs.geometry[a.gain].nominal for a in legs.mechanism.actuators if a.gain]
    assert len(gains) == 6 and min(gains) != 1.0
    np.testing.assert_allclose(follower.reach * np.abs(gains), follower.size)


@pytest.mark.parametrize(("count", "block"), [(0, 4), (1, 4), (4, 4), (9, 4), (8, 4)])
def test_every_row_is_in_one_block(count: int, block: int) -> None:
    seen = np.zeros(count, dtype=int)
    sizes = []

    def part(rows: slice) -> None:
        seen[rows] += 1
        sizes.append(rows.stop - rows.start)

    shared_out(part, count, block)
    assert (seen == 1).all() and sum(sizes) == count and max(sizes, default=0) <= block
    assert len(sizes) == -(-count // block)


def test_machines_of_more_joints_than_the_pose_has_conditions_are_left_to_numpy(tmp_path: Path) -> None:
    """Which of many solutions is taken must not hang on the way of solving."""
    text = SIX_AXES.replace(
        "frames:", "    - {name: q7, kind: revolute, d: 10, range: [-90, 90]}\nframes:", 1
    )
    with pytest.raises(NotCompiledError, match="more joints than"):
        CompiledKinematics(machine_of(tmp_path, text), WHOLE)


def poses_file(folder: Path, pose: Array) -> Path:
    row = ",".join(f"{v:.9g}" for v in (*pose[:3, 3], *lie.log_so3(pose[:3, :3])))
    units = [
        f"{name} [{'mm' if k < 3 else 'rad'}]" for k, name in enumerate(("x", "y", "z", "rx", "ry", "rz"))
    ]
    (folder / "poses.csv").write_text(f"{','.join(units)}\n{row}\n", encoding="utf-8")
    return folder / "poses.csv"


def test_a_pose_that_cannot_be_taken_says_what_is_in_the_way(tmp_path: Path) -> None:
    """Only one joint turns the tool about its axis: its range alone decides."""
    text = SIX_AXES.replace("range: [-350, 350]", "range: [-60, 60]").replace(
        "xyz: [100, 20, 5], rpy: [1, 2, 40]", "xyz: [0, 0, 0], rpy: [0, 0, 0]"
    )
    machine = machine_of(tmp_path, text)
    solver = PoseSolver(machine)
    straight = np.array([0.1, -0.3, 0.2, 0.0, 0.0, 0.0])
    fine = solver.forward(straight + np.array([0, 0, 0, 0, 0.5, 0.9]))[0][0]
    table, path = load_path(machine, poses_file(tmp_path, fine))
    np.testing.assert_allclose(solver.forward(path.q)[0][0], fine, atol=1e-5)
    frame = commands(table, machine, compensate(machine, path))
    np.testing.assert_allclose(np.radians(frame["q6"].to_numpy()), path.q[:, 5], atol=1e-6)
    narrow = machine_of(tmp_path, text.replace("[-60, 60]", "[-10, 10]"))
    with pytest.raises(
        InputError, match=r"row 1: .* cannot take \(q6 would have to leave the range\), expected"
    ):
        load_path(narrow, poses_file(tmp_path, fine))
    far = fine.copy()
    far[:3, 3] += [9000.0, 0, 0]
    with pytest.raises(
        InputError, match=r"row 1: .* \(8\.?\d*e\+03 mm and .* rad are left\), expected one within reach"
    ):
        load_path(machine, poses_file(tmp_path, far))


@pytest.mark.parametrize("cells", [["a", "b"], ["a,b", "c"], ['say "a"', "c"], [1, "b"], [None, "b"]])
def test_long_tables_are_written_as_short_ones_are(cells: list[object]) -> None:
    """By columns, whatever stands in them: numbers at full precision, texts with commas and quotes, whole numbers, gaps."""
    count = 10_001
    rng = np.random.default_rng(2)
    frame = pd.DataFrame({"q1 [rad]": rng.standard_normal(count), "n": np.arange(count)})
    frame["note"] = pd.Series((cells * count)[:count], dtype=object)
    text = csv_text(frame)
    assert text.count("\n") == count + 1 and text.endswith("\n")
    short = csv_text(frame.iloc[:100])
    lines = text.splitlines()[:101]
    assert lines[0] == "q1 [rad],n,note" == short.splitlines()[0]
    for one, other in zip(lines[1:], short.splitlines()[1:], strict=True):
        number, _, rest = one.partition(",")
        same, _, more = other.partition(",")
        assert float(number) == float(same) and rest == more
