"""The tools of the study of what remains of a real recording, on data made here whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from real_recordings.hypotheses import play, weigh
from real_recordings.ladder import climb, held_out
from real_recordings.linearised import Linearised, link_frames
from real_recordings.orders import spectrum
from real_recordings.regressors import direction, hats, of_joint, share_of_path, waves
from real_recordings.repeats import moments, pairs, unreal_share

JOINTS = 6


def made(rows: int, seed: int, noise: float = 0.01) -> Linearised:
    """A recording whose residual is noise (mm; a tenth of it per 100 mm as rad), with random derivatives."""
    rng = np.random.default_rng(seed)
    joint = rng.normal(0.0, 500.0, (rows, 6, JOINTS))
    joint[:, 3:] = rng.normal(0.0, 1.0, (rows, 3, JOINTS))
    sigma = np.array([noise] * 3 + [noise / 1000.0] * 3)
    frames = link_frames([0.0, 0.3, 100.0, 0.0, 50.0] * JOINTS, rng.uniform(-1.0, 1.0, (rows, JOINTS)))
    return Linearised(
        residual=rng.normal(0.0, sigma, (rows, 6)),
        geometry=rng.normal(0.0, 0.1, (rows, 6, 4)) * np.array([1.0] * 3 + [1e-3] * 3)[:, None],
        joint=joint,
        motion={},
        q=rng.uniform(-2.0, 2.0, (rows, JOINTS)),
        held=np.arange(rows) % 3 == 0,
        position=rng.normal(0.0, 1.0, (rows, 3)),
        rotation=np.tile(np.eye(3), (rows, 1, 1)),
        body=frames,
        temperature=np.zeros(rows),
        time=None,
    )


def with_error(data: Linearised, joint: int, error: np.ndarray) -> Linearised:
    """The same with a joint that stands off its readings by (n,) rad."""
    return replace(data, residual=data.residual + data.joint[:, :, joint] * error[:, None])


def test_link_frames_are_poses_and_follow_the_convention() -> None:
    frames = link_frames([0.2, 0.5, 7.0, 0.1, 3.0], np.array([[0.4]]))[0, 0]
    assert np.allclose(frames[:3, :3] @ frames[:3, :3].T, np.eye(3), atol=1e-14)
    assert np.isclose(np.linalg.det(frames[:3, :3]), 1.0)
    cb, sb, ca, sa = np.cos(0.2), np.sin(0.2), np.cos(0.5), np.sin(0.5)
    beta = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    alpha = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    assert np.allclose(frames[:3, 3], beta @ alpha @ np.array([7.0, 0.0, 3.0]), atol=1e-13)


def test_a_ladder_finds_what_is_there_and_sets_wild_rows_aside() -> None:
    data = made(600, 1)
    error = 1e-4 * np.sin(3 * data.q[:, 1])
    data = with_error(data, 1, error)
    wild = np.array([10, 301])
    residual = data.residual.copy()
    residual[wild, :3] += 5.0
    data = replace(data, residual=residual)
    ladder = climb(data, {"geometry": [], "waves": waves(data, range(1, 6))})
    assert set(wild) <= set(np.flatnonzero(ladder.outlier).tolist())
    assert ladder.outlier.sum() < 6  # 5 robust sigmas are rarely exceeded by chance
    before, after = (held_out(data, ladder.residual(n), ladder.outlier)[0] for n in ("geometry", "waves"))
    assert before > 2.0 * after
    assert after < 1.15 * 10.0 * np.sqrt(3.0)  # 10 um per axis, 60 coefficients of 2400 readings


def test_a_cause_gains_on_held_out_rows_and_its_placebo_does_not() -> None:
    data = made(500, 2)
    sign = direction(data)
    data = with_error(data, 2, 5e-5 * sign[:, 2])
    none = np.zeros(len(data), dtype=bool)
    found = weigh(data, data.residual, none, [of_joint(data, 2, sign[:, [2]])])
    assert found.log_bayes > 20.0
    assert found.placebo < 0.0
    assert found.gain[0] > 0.0
    assert found.coefficients[0] == pytest.approx(5e-5, rel=0.1)
    other = weigh(data, data.residual, none, [of_joint(data, 4, sign[:, [4]])])
    assert other.log_bayes < 3.0


def test_scatter_splits_into_an_instrument_and_joints() -> None:
    rng, data = np.random.default_rng(3), made(4000, 3)
    joints = np.array([20e-6, 0.0, 40e-6, 0.0, 30e-6])
    jitter = rng.normal(0.0, 1.0, (len(data), 5)) * joints
    scatter = np.einsum("nij,nj->ni", data.joint[:, :3, :5], jitter) + rng.normal(0.0, 0.007, (len(data), 3))
    found = moments(scatter, data.joint[:, :3, :5])
    assert found.isotropic == pytest.approx(7.0, rel=0.15)
    assert np.allclose(found.joints[[0, 2, 4]], [20.0, 40.0, 30.0], rtol=0.15)
    assert (found.joints[[1, 3]] < 6.0).all()
    assert found.share.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("real", [True, False])
def test_a_joint_reading_that_jitters_is_told_from_an_arm_that_moves(real: bool) -> None:
    rng, data = np.random.default_rng(4), made(400, 4)
    q, joint = data.q.copy(), data.joint.copy()
    q[1::2] = q[::2] + rng.normal(0.0, 1e-4, (200, JOINTS))
    joint[1::2] = joint[::2]
    data = replace(data, q=q, joint=joint)
    change = np.zeros((400, JOINTS))
    change[1::2] = q[1::2] - q[::2]
    # prediction less reading: a reading of the joint that the arm did not follow stays in the residual
    unreal = np.zeros((400, 6)) if real else np.einsum("nij,nj->ni", joint, change)
    rows = pairs(data, np.zeros(400, dtype=bool), 0.2)
    share, sigma = unreal_share(data, data.residual + unreal, rows)
    assert len(rows) == 200
    assert (np.abs(share - (0.0 if real else 1.0)) < 5.0 * sigma).all()


def test_a_line_stands_at_its_order_and_nowhere_else() -> None:
    data = made(2000, 5)
    data = with_error(data, 0, 2e-5 * np.cos(404 * data.q[:, 0] + 0.3))
    none = np.zeros(len(data), dtype=bool)
    found = spectrum(data, data.residual, none, 0, 141.0, 700.0)
    top = int(found.peaks(1)[0])
    assert found.order[top] == 404.0
    assert found.power[top] > 3.0 * found.limit
    assert found.amplitude[top] == pytest.approx(2e-5, rel=0.2)
    other = spectrum(data, data.residual, none, 1, 141.0, 700.0)
    assert other.power[other.peaks(1)[0]] < 1.5 * other.limit


def test_motion_has_a_share_a_direction_and_a_play() -> None:
    data = made(50, 6)
    along, sign = share_of_path(data), direction(data)
    assert np.allclose(np.abs(along[1:]).max(axis=1), 1.0)
    assert (np.sign(along[1:]) == np.sign(sign[1:])).all()
    back = replace(data, q=data.q[::-1])
    assert np.allclose(share_of_path(back)[1:], -along[1:][::-1])
    centre = play(data.q, 0.5)
    assert (np.abs(centre) <= 1.0 + 1e-12).all()
    far = np.abs(np.diff(data.q, axis=0)) > 1.0  # two widths: the play is dragged to its end
    assert np.allclose(centre[1:][far], sign[1:][far])
    assert np.allclose(hats(np.arange(30.0), 7).sum(axis=1), 1.0)
