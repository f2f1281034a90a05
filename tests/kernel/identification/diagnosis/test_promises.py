"""Figures that docs/topics/method.md promises: noise, its prior, alarms, outlying rows, extrapolations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from support.recordings import rows_of
from support.sensor_bench import Bench
from truepose.identification.diagnosis.alarms import replicate_noise
from truepose.identification.diagnosis.holdout import OUTERMOST, held_out_blocks
from truepose.identification.diagnosis.null_fits import bridges, outlying_rows
from truepose.identification.diagnosis.result import Alarm
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prior import noise_log_prior
from truepose.identification.recording.recording import Recording

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Estimate:
    """A fit whose residuals the tests replace."""
    bench = Bench(tmp_path_factory.mktemp("fit"), "stage")
    return estimate(bench.machine, bench.recording())


def leaving(fit: Estimate, residual: Array) -> Estimate:
    """The fit with these residuals (n, m) of rows that were all used."""
    return replace(fit, residual=residual, used=np.ones(len(residual), dtype=bool))


def anywhere(n: int) -> Recording:
    """A recording of n poses that have nothing to do with the order of rows."""
    return rows_of(np.random.default_rng(9).uniform(-1.0, 1.0, (n, 3)))


@pytest.mark.parametrize("repeats", [(2,), (2, 3, 7), (5, 1, 1)])
def test_the_variance_of_replicates_is_unbiased(fit: Estimate, repeats: tuple[int, ...]) -> None:
    """Whatever the model leaves out of a pose: its repeats share it, and each pose costs one mean a channel."""
    rng = np.random.default_rng(1)
    pose = np.repeat(np.arange(4 * len(repeats), dtype=np.int64), 4 * repeats)
    recording = rows_of(pose[:, None].astype(float), pose=pose)
    squares, dof = [], 0
    for _ in range(400):
        left_out = rng.normal(0.0, 50.0, (int(pose.max()) + 1, 2))[pose]
        noise, dof = replicate_noise(
            leaving(fit, left_out + 3.0 * rng.standard_normal(left_out.shape)), recording
        )
        squares.append(noise**2)
    assert dof == 2 * (len(pose) - len(np.unique(pose)))
    assert np.mean(squares) == pytest.approx(9.0, abs=4.0 * 9.0 * np.sqrt(2.0 / dof / len(squares)))


def test_an_alarm_without_cause_is_raised_once_in_a_hundred() -> None:
    """p of a true model is uniform."""
    p = (np.arange(5000) + 0.5) / 5000
    assert sum(Alarm(1.0, float(value)).raised for value in p) == 50


def test_stated_sigmas_are_right_to_10_per_cent_seven_times_in_ten() -> None:
    """Moments of the prior of the noise's logarithm: 0.7 of a width of 0.1, 0.3 of a width of 0.8."""
    step = np.linspace(-9.0, 9.0, 6001)
    density = np.exp(noise_log_prior(np.exp(step).tolist())) / np.sqrt(2 * np.pi)
    moments = [float(np.sum(density * step**power) * (step[1] - step[0])) for power in (0, 1, 2, 4)]
    expected = (1.0, 0.0, 0.7 * 0.1**2 + 0.3 * 0.8**2, 3.0 * (0.7 * 0.1**4 + 0.3 * 0.8**4))
    np.testing.assert_allclose(moments, expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_row_is_outlying_beyond_one_and_a_half_gaussian_limits(
    fit: Estimate, noise: float, channels: int
) -> None:
    """The limit that chance passes in one recording of a thousand, by the larger of the stated noise and the rows' own."""
    rng, n, row = np.random.default_rng(2), 400, 123
    quiet = rng.standard_normal((n, channels))
    size = np.sqrt(np.mean(quiet**2, axis=1))
    quiet *= (np.minimum(size, 2.0) / size)[:, None]  # nothing far by chance
    own = float(np.median(np.minimum(size, 2.0))) / np.sqrt(chi2.median(channels) / channels)
    limit = max(1.0, noise * own) * np.sqrt(chi2.ppf((1.0 - 1e-3) ** (1.0 / n), channels) / channels)
    for share, outlying in ((1.45, False), (1.55, True)):
        residual = noise * quiet
        residual[row] = share * limit
        found = np.flatnonzero(outlying_rows(leaving(fit, residual), anywhere(n), np.ones(n, dtype=bool)))
        assert found.tolist() == ([row] if outlying else [])


def test_many_far_rows_are_a_wrong_model_and_no_outliers(fit: Estimate) -> None:
    rng, n = np.random.default_rng(3), 200
    order = rng.permutation(n)
    for far, marked in ((20, 20), (21, 0)):  # one in ten is the most
        residual = np.clip(rng.standard_normal((n, 2)), -2.0, 2.0)
        residual[order[:far]] = 50.0
        found = outlying_rows(leaving(fit, residual), anywhere(n), np.ones(n, dtype=bool))
        assert found.sum() == found[order[:far]].sum() == marked


@pytest.mark.parametrize("where", ["time", "pose", "payload"])
def test_far_rows_that_lie_together_are_physics_and_no_outliers(fit: Estimate, where: str) -> None:
    """The heaviest loads, folded poses, a stretch of time: what is far there has a cause, and is kept."""
    rng, n = np.random.default_rng(5), 300
    order = rng.permutation(n)
    recording = rows_of(rng.uniform(-1.0, 1.0, (n, 3)), drivers={"payload": rng.uniform(0.0, 12.0, n)})
    score = {
        "time": np.arange(n, dtype=float),
        "pose": recording.q @ np.ones(3),
        "payload": np.asarray(recording.drivers["payload"]),
    }[where]
    for far, kept in ((np.argsort(score)[-12:], True), (order[:12], False)):
        residual = np.clip(rng.standard_normal((n, 2)), -2.0, 2.0)
        residual[far] = 50.0
        found = outlying_rows(leaving(fit, residual), recording, np.ones(n, dtype=bool))
        assert found.sum() == (0 if kept else 12)


@pytest.mark.parametrize(("ties", "alone"), [(1, True), (3, True), (4, False)])
def test_few_rows_that_tie_two_sessions_together_are_told_from_many(ties: int, alone: bool) -> None:
    """A shift between the sessions would stand in these few rows only; of many, one that is far is an error of its own."""
    n = 20
    origin = np.maximum(np.arange(n) - 1, 0)
    origin[10 : 10 + ties] = 9  # the first rows of the second session are read against the last of the first
    recording = replace(anywhere(n), from_row=origin, session=np.repeat([1, 2], n // 2))
    assert np.flatnonzero(bridges(recording)).tolist() == (list(range(10, 10 + ties)) if alone else [])
    part = recording.subset([0, 3, 10, 15])
    assert bridges(part).tolist() == [False, False, True, False]  # whatever rows are left out
    assert not bridges(replace(recording, from_row=None)).any()


def test_extrapolations_are_farther_heavier_and_warmer_than_what_they_are_predicted_from() -> None:
    rng, n = np.random.default_rng(4), 300
    drivers = {
        "payload": rng.choice(np.arange(12.0), n),
        "temperature.air": rng.normal(22.0, 0.1, n),
        "temperature.leg": rng.normal(30.0, 3.0, n),
    }
    recording = rows_of(rng.normal([5.0, -3.0], [1.0, 40.0], (n, 2)), drivers=drivers)
    _, blocks = held_out_blocks(recording, np.ones(n, dtype=bool))
    off = (recording.q - recording.q.mean(axis=0)) / recording.q.std(axis=0)
    scores = {
        OUTERMOST: np.hypot(*off.T),
        "heaviest loads": drivers["payload"],
        "warmest rows": drivers["temperature.leg"],
    }
    left = np.ones(n, dtype=bool)
    found = {block.name: block.rows for block in blocks}
    for name, score in scores.items():  # each leaves its rows to itself
        held = found[name]
        assert 0.1 * n < held.sum() < 0.25 * n
        assert score[held].min() > score[left & ~held].max()
        left &= ~held


def test_without_repeats_noise_is_as_stated(fit: Estimate) -> None:
    residual = np.random.default_rng(6).standard_normal((30, 2))
    for pose in (None, np.arange(30, dtype=np.int64)):
        assert replicate_noise(leaving(fit, 7.0 * residual), rows_of(residual, pose=pose)) == (1.0, 0)
