"""Laws of tasks: which components may stand together, what counts of a pose, and what machine files may say. mm, rad."""

from __future__ import annotations

from itertools import chain, combinations
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.partial_machines import partial_machine
from support.simulated import machine_from
from truepose.errors import InputError
from truepose.identification.compensation.inverse import PoseSolver
from truepose.models.task import COMPONENTS, WHOLE, Task

Array = NDArray[np.float64]
NAMES = [*chain.from_iterable(combinations(COMPONENTS, k) for k in range(1, 8))]


def valid() -> list[Task]:
    out = []
    for names in NAMES:
        try:
            out.append(Task.of(names))
        except ValueError:
            continue
    return sorted(set(out), key=lambda task: task.components)


TASKS = valid()


def gap(task: Task, goal: Array, pose: Array, base: Array) -> Array:
    a, b = ca.SX.sym("goal", 4, 4), ca.SX.sym("pose", 4, 4)
    left = ca.Function("gap", [a, b], [ca.densify(task.gap(a, b, ca.SX(base)))])
    return np.array(left(goal, pose))[:, 0]


def pose_of(twist: Array) -> Array:
    out = np.eye(4)
    out[:3, 3], out[:3, :3] = twist[:3], Rotation.from_rotvec(twist[3:]).as_matrix()
    return out


numbers = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)


def test_components_in_any_order_are_one_task() -> None:
    for task in TASKS:
        assert Task.of(task.components[::-1]) == task
        assert len(task.rows) == len(set(task.rows)) == len(task.along) + len(task.about)
        assert task.is_whole == (len(task.rows) == 6) == (task == WHOLE)
    assert Task.of(("axis", "rz", "x")) == Task.of(("x", "rx", "ry", "rz"))
    assert (
        len({task.rows for task in TASKS if task.axis is None}) == 63
    )  # every set of rows that is not empty


@given(st.sampled_from(TASKS), numbers, numbers, numbers, st.floats(1e-4, 0.5))
def test_the_gap_is_what_counts_of_the_twist(
    task: Task, at: Array, way: Array, base: Array, size: float
) -> None:
    """Of a small way; of any way it is zero just where nothing that counts is left."""
    frame, goal = pose_of(base)[:3, :3], pose_of(at)
    small = 1e-6 * way
    pose = goal.copy()
    pose[:3, 3] += frame @ small[:3]
    pose[:3, :3] = goal[:3, :3] @ pose_of(small)[:3, :3]
    asked = np.array([k in task.rows for k in range(6)])
    expected = np.where(asked, small, 0.0)
    if task.is_whole:
        expected = np.concatenate([frame @ small[:3], goal[:3, :3] @ small[3:]])
    np.testing.assert_allclose(gap(task, goal, pose, frame), expected, rtol=0, atol=1e-11)
    free = size * np.where(asked, 0.0, way)
    about = free[3:] if task.axis is not None or np.count_nonzero(free[3:]) < 2 else np.zeros(3)
    pose[:3, 3], pose[:3, :3] = (
        goal[:3, 3] + frame @ free[:3],
        goal[:3, :3] @ pose_of(np.r_[0, 0, 0, about])[:3, :3],
    )
    np.testing.assert_allclose(gap(task, goal, pose, frame), 0.0, rtol=0, atol=1e-14)
    twist = np.r_[pose[:3, 3] - goal[:3, 3], goal[:3, :3] @ about][None]
    np.testing.assert_allclose(task.counted(twist, goal[None], frame), 0.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("task", [task for task in TASKS if task.about and not task.is_whole], ids=str)
def test_the_other_way_round_is_no_way_to_be_right(task: Task) -> None:
    """Half a turn about an axis that counts: sines are zero there, too."""
    for k in task.about:
        turned = pose_of(np.pi * np.eye(6)[3 + k])
        assert np.max(np.abs(gap(task, np.eye(4), turned, np.eye(3)))) > 0.1


@given(st.sampled_from(TASKS), numbers, numbers, numbers)
def test_what_counts_counts_once(task: Task, at: Array, way: Array, base: Array) -> None:
    """It is part of the twist: what is left of it counts no more, to first order of a small way."""
    frame, goal, twist = pose_of(base)[:3, :3], pose_of(at)[None], 1e-3 * way[None]
    asked = task.counted(twist, goal, frame)
    np.testing.assert_allclose(task.counted(asked, goal, frame), asked, rtol=0, atol=1e-12)
    np.testing.assert_allclose(task.counted(twist - asked, goal, frame), 0.0, rtol=0, atol=1e-5)
    assert np.linalg.norm(asked[:, :3]) <= np.linalg.norm(twist[:, :3]) + 1e-15


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        (
            "[x, y, w]",
            r"task: expected one or several of x, y, z, rx, ry, rz, axis, axis.x and axis.y, each once, found \[.*'w'\]",
        ),
        ("[]", "expected one or several of"),
        ("[x, x]", "expected one or several of"),
        ("[axis, rx]", "expected one direction of an axis, which holds both turns across it"),
        ("[axis, axis.x]", "expected one direction of an axis"),
        ("x", "expected a list of components"),
        ("[1, 2]", "expected a list of components"),
        (
            "[x, y, z, axis, rz]",
            r"task: found 6 conditions \(x, y, z, rx, ry, rz\), expected at most 4, one for each of the joints q1",
        ),
        ("[x, y, z, axis]", "task: found 5 conditions"),
    ],
)
def test_what_is_no_task_is_refused_by_name(stated: str, says: str, tmp_path: Path) -> None:
    text = partial_file(tmp_path).read_text()
    with pytest.raises(InputError, match=says):
        machine_from(tmp_path, text + f"task: {stated}\n")


def partial_file(folder: Path) -> Path:
    partial_machine(folder, "scara")
    return folder / "scara.yaml"


def test_what_the_joints_cannot_hold_is_refused(tmp_path: Path) -> None:
    """As many conditions as joints, and no joint that tilts the axis."""
    machine = machine_from(tmp_path, partial_file(tmp_path).read_text() + "task: [x, y, axis]\n")
    with pytest.raises(
        InputError, match=r"task: found \['x', 'y', 'axis'\], expected components that q1, q2, q3, q4 move"
    ):
        PoseSolver(machine)
