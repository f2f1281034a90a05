"""Laws of machines that meet a part of the pose: a plane, a position, the direction of an axis. mm, rad."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from support.partial_machines import PARTIAL, as_built, partial_machine, readings
from support.recordings import rows_of
from truepose.arrays import Array
from truepose.identification.compensation.compensate import compensate, ideal_constants
from truepose.identification.compensation.inverse import PoseSolver, base_frame
from truepose.identification.compensation.path_table import path_rows
from truepose.identification.recording.table import read_table
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

POSITION, TURN = 1e-6, 1e-9
ROWS = 30


def left(components: tuple[str, ...], goals: Array, poses: Array, base: Array) -> tuple[float, float]:
    """Return what is left of the components, largest mm and rad, from the entries of the poses (n, 4, 4)."""
    apart = np.einsum("ji,nj->ni", base[:3, :3], poses[:, :3, 3] - goals[:, :3, 3])
    within = Rotation.from_matrix(goals[:, :3, :3].transpose(0, 2, 1) @ poses[:, :3, :3])
    vector = within.as_rotvec()
    turns = {"rx": vector[:, 0], "ry": vector[:, 1], "rz": vector[:, 2]}
    turns |= {"axis": np.linalg.norm(within.as_matrix()[:, :2, 2], axis=1)}
    turns |= {"axis.x": np.linalg.norm(within.as_matrix()[:, 1:, 0], axis=1)}
    position = [apart[:, "xyz".index(name)] for name in components if name in "xyz"]
    rotation = [turns[name] for name in components if name in turns]
    most, turned = (float(np.max(np.abs(np.array(part)), initial=0.0)) for part in (position, rotation))
    return most, turned


def tools(machine: Machine, p: Array, q: Array) -> Array:
    poses, assembled = PoseSolver(machine, p).forward(q)
    assert assembled.all()
    return poses


@pytest.mark.parametrize("name", PARTIAL)
def test_each_machine_has_the_task_that_its_joints_can_hold(name: str, tmp_path: Path) -> None:
    """The drawing and the machine as built have the same one: errors of the geometry hold nothing."""
    machine = partial_machine(tmp_path, name)
    assert PoseSolver(machine).task.components == PARTIAL[name].components
    assert PoseSolver(as_built(machine, 1)).task.components == PARTIAL[name].components


@pytest.mark.parametrize("name", PARTIAL)
def test_forward_after_inverse_meets_the_task(name: str, tmp_path: Path) -> None:
    """From a place nearby, and from home; goals of another machine of the kind, whose whole poses this one does not meet."""
    machine = partial_machine(tmp_path, name)
    built = as_built(machine, 2)
    solver, base = PoseSolver(built), base_frame(built)
    q = readings(machine, ROWS, 3)
    goals = PoseSolver(machine).forward(q)[0]
    for found in (solver.inverse(goals, q, restarts=0), solver.inverse(goals)):
        near = found.solved
        assert near.mean() > 0.8  # of a range drawn for one machine, ends are out of another's reach
        poses = solver.forward(found.q[near])[0]
        position, turn = left(PARTIAL[name].components, goals[near], poses, base)
        assert position < POSITION and turn < TURN


@pytest.mark.parametrize("name", PARTIAL)
def test_the_calibrated_tool_is_put_where_the_task_asks(name: str, tmp_path: Path) -> None:
    """``not_asked`` is the rest of the pose: the real tool is there as well."""
    machine = as_built(partial_machine(tmp_path, name), 4)
    q = readings(machine, ROWS, 5)
    path = rows_of(q, joints=machine.mechanism.readings)
    found = compensate(machine, path)
    model = symbolic_model(machine)
    goals = tools(machine, ideal_constants(machine, model), q)
    poses = tools(machine, model.p_home, found.command)
    task, base = PARTIAL[name].components, base_frame(machine)
    assert left(task, goals, poses, base)[0] < POSITION
    exact = ~found.eased
    assert left(task, goals[exact], poses[exact], base)[1] < TURN
    assert np.mean(found.eased) < 0.2
    whole = Rotation.from_matrix(poses[:, :3, :3] @ goals[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    apart = np.hstack([poses[:, :3, 3] - goals[:, :3, 3], whole])
    np.testing.assert_allclose(found.after + found.not_asked, apart, rtol=0, atol=1e-9)
    assert np.max(np.abs(found.before)) > 1e-3
    first = compensate(machine, path, method="first-order")
    assert np.median(np.abs(first.after)) < 0.1 * np.median(np.abs(first.before)[first.before != 0.0])


@given(
    st.floats(-1e-2, 1e-2),
    st.floats(-3.0, 3.0),
    st.lists(st.floats(-250, 250), min_size=3, max_size=3),
    st.integers(0, 99),
)
def test_next_to_a_singular_pose_no_axis_of_a_mill_swings(
    a: float, c: float, xyz: list[float], seed: int
) -> None:
    """The position is met, and the direction of the tool no worse than with nominal commands; a file may ask for more."""
    with TemporaryDirectory() as folder:
        drawn = partial_machine(Path(folder), "mill")
    machine = as_built(drawn, seed, length=0.03, angle=2e-4)
    q = np.array([[c, a, *xyz]])
    found = compensate(machine, rows_of(q, joints=machine.mechanism.readings))
    assert np.max(np.abs(found.after[:, :3])) < POSITION
    assert np.max(np.abs(found.command - q)[:, :2]) < 0.05
    assert np.linalg.norm(found.after[:, 3:]) < np.linalg.norm(found.before[:, 3:]) + 1e-6
    assert found.eased.all() or np.max(np.abs(found.after[:, 3:])) < TURN


def test_a_path_of_poses_says_what_of_them_is_not_met(tmp_path: Path) -> None:
    """Poses of a SCARA, all tilted by 3 deg: the joints are those of the upright poses, and the tilt is noted."""
    machine = partial_machine(tmp_path, "scara")
    q = readings(machine, 5, 14)
    poses = PoseSolver(machine).forward(q)[0]
    tilted = poses[:, :3, :3] @ Rotation.from_euler("x", 3, degrees=True).as_matrix()
    table = np.hstack([poses[:, :3, 3], Rotation.from_matrix(tilted).as_rotvec(degrees=True)])
    file = tmp_path / "path.csv"
    file.write_text(
        "\n".join(["x,y,z,rx,ry,rz", *(",".join(map(repr, row)) for row in table.tolist())]), encoding="utf-8"
    )
    _, rows = path_rows(machine, read_table(file))
    np.testing.assert_allclose(PoseSolver(machine).forward(rows.q)[0][:, :3, 3], poses[:, :3, 3], atol=1e-6)
    assert (
        "nominal joints meet x, y and z of the tool's position and the turn about the tool's z axis"
        in rows.notes[-1]
    )
    assert rows.notes[-1].endswith("the rest is off by up to 0 mm and 3 deg")
