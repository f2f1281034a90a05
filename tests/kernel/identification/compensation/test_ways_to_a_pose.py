"""Laws of twists between poses and of the solver of poses: turns, ranges, what is no pose. mm, rad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.calibrated_machines import SIX_AXES
from support.simulated import machine_from
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.compensation.compensate import ideal_constants, twists_between
from truepose.identification.compensation.inverse import PoseSolver, Reach, inverse
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return machine_from(tmp_path_factory.mktemp("arm"), SIX_AXES, "m")


def random_poses(n: int, rng: np.random.Generator) -> Array:
    out = np.tile(np.eye(4), (n, 1, 1))
    out[:, :3, :3], out[:, :3, 3] = Rotation.random(n, rng=rng).as_matrix(), rng.uniform(-500, 500, (n, 3))
    return out


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.5, 0.53, 1.0, 1.6, 2.0, 3.0, np.pi - 1e-6])
def test_a_twist_between_poses_is_the_turn_of_one_into_the_other(angle: float) -> None:
    """From the smallest to nearly half a turn, told in the frame that both are told in."""
    rng = np.random.default_rng(1)
    targets, axes = random_poses(20, rng), rng.normal(size=(20, 3))
    turn = Rotation.from_rotvec(angle * axes / np.linalg.norm(axes, axis=1)[:, None])
    shift = rng.uniform(-5, 5, (20, 3))
    poses = targets.copy()
    poses[:, :3, :3], poses[:, :3, 3] = turn.as_matrix() @ targets[:, :3, :3], targets[:, :3, 3] + shift
    found = twists_between(targets, poses)
    np.testing.assert_allclose(found[:, :3], shift, atol=1e-9)
    # an angle next to half a turn is known to the root of rounding
    np.testing.assert_allclose(found[:, 3:], turn.as_rotvec(), rtol=1e-7, atol=1e-14 if angle < 1.0 else 1e-8)


def test_the_drawing_has_its_links_the_calibrated_frames_and_no_effect(tmp_path: Path) -> None:
    text = SIX_AXES + (
        "nominal:\n  q2.d: 30\n  tool.x: 99\n"
        "effects:\n  - {effect: actuator-scale, place: [q4], parameters: {s: {value: 0.01, unit: '1'}}}\n"
    )
    drawn = machine_from(tmp_path, text, "m")
    model = symbolic_model(drawn, drawn.effects)
    value = dict(zip(model.names, ideal_constants(drawn, model).tolist(), strict=True))
    own = {p.name: p.nominal for p in drawn.parameters}
    assert value["q2.d"] == 30.0 and value["q3.d"] == own["q3.d"] and value["tool.x"] == own["tool.x"] == 10.0
    (effect,) = set(value) - set(own)
    assert value[effect] == 0.0


def test_joints_come_back_next_to_the_middle_of_their_ranges_or_on_the_turn_of_their_start(
    machine: Machine,
) -> None:
    solver = PoseSolver(machine)
    q = np.array([0.3, -0.4, 0.5, 0.7, 0.9, 2.0])
    pose = solver.forward(q)[0]
    start = q + 2 * np.pi * np.eye(6)[5]
    near = solver.inverse(pose, start)
    assert near.solved.all() and near.saturated(0) == ()
    np.testing.assert_allclose(near.q[0], q, atol=1e-7)
    kept = solver.inverse(pose, start, restarts=0, rewind=False)
    np.testing.assert_allclose(kept.q[0], start, atol=1e-7)
    assert kept.status[0] == Reach.JOINT_RANGE and kept.saturated(0) == ("q6",) and not kept.solved.any()
    # within the range by whole turns, although the nearest one is not: a pose that needs no restart
    for shift in (-6 * np.pi, 4 * np.pi):
        far = solver.inverse(pose, q + shift * np.eye(6)[5], restarts=0)
        np.testing.assert_allclose(far.q[0], q, atol=1e-7)


def test_a_pose_out_of_reach_is_told_from_a_joint_out_of_its_range(machine: Machine) -> None:
    solver = PoseSolver(machine)
    inside, outside = np.array([0.3, -0.4, 0.5, 0.7, 0.9, 2.0]), np.array([3.05, -0.4, 0.5, 0.7, 0.9, 2.0])
    poses = solver.forward(np.array([inside, outside]))[0]
    far = poses[:1].copy()
    far[0, :3, 3] += [0, 0, 5000.0]
    found = solver.inverse(np.concatenate([poses, far]), np.array([inside, outside, outside]), restarts=0)
    assert found.status.tolist() == [Reach.SOLVED, Reach.JOINT_RANGE, found.status[2]]
    assert found.status[2] in (Reach.UNREACHABLE, Reach.ITERATION_LIMIT)
    assert found.saturated(1) == ("q1",) and not found.beyond[0].any() and not found.beyond[2].any()
    assert found.position[2] > 3000.0 and found.position[0] < 1e-5
    assert "of 3 poses: 1 solved, 1 joint range, 1 " in repr(found)
    # from elsewhere: another way to stand there has every joint in its range, or none has
    again = inverse(machine, np.concatenate([poses, far]), outside)
    assert again.solved[0] and not again.solved[2]
    assert not again.solved[1] or not again.beyond[1].any()


def test_restarts_find_what_one_start_does_not(machine: Machine) -> None:
    """Random joints of the ranges: from home alone many are missed; each one found stands where it should."""
    solver = PoseSolver(machine)
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    q = np.random.default_rng(5).uniform(0.8 * low, 0.8 * high, (40, 6))
    poses = solver.forward(q)[0]
    once, often = solver.inverse(poses, restarts=0), solver.inverse(poses)
    assert once.solved.sum() < often.solved.sum() and often.solved.mean() > 0.9
    assert (often.solved | ~once.solved).all()
    met = often.solved
    np.testing.assert_allclose(solver.forward(often.q[met])[0], poses[met], atol=1e-5)
    assert ((often.q[met] >= low) & (often.q[met] <= high)).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda p: p[0], r"found shape \(4, 4\)"),
        (lambda p: p[:, :3], r"found shape \(3, 3, 4\)"),
        (lambda p: p * np.where(np.arange(3) == 1, np.nan, 1.0)[:, None, None], r"poses\[1\]: found no rigid"),
        (lambda p: p @ np.diag([1.0, 1.0, -1.0, 1.0]), r"poses\[0\]"),
        (lambda p: p @ np.diag([1.00001, 1.0, 1.0, 1.0]), r"poses\[0\]"),
    ],
)  # fmt: skip
def test_what_is_no_pose_is_refused(change: object, says: str, machine: Machine) -> None:
    assert callable(change)
    poses = PoseSolver(machine).forward(np.zeros((3, 6)))[0]
    with pytest.raises(InputError, match=says):
        inverse(machine, change(poses))
