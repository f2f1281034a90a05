"""Where all joints of a stream stand still, and what the samples of such a stretch average to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.identification.leaves.readers.bags import BAND, SECONDS, Stream, average, stretches

Array = NDArray[np.float64]
STEP = 0.01


def stream(position: Callable[[Array], Array], end: float = 10.0) -> Stream:
    """One joint, a sample every 10 ms."""
    time = np.arange(0.0, end + STEP / 2, STEP)
    return Stream(time, position(time)[:, None])


def standing(start: float, end: float, speed: float = 1.0) -> Callable[[Array], Array]:
    """A joint that moves evenly but for a rest."""
    return lambda t: speed * (np.minimum(t, start) + np.maximum(t - end, 0.0))


@pytest.mark.parametrize("rest", [0.9, 1.1, 3.0])
def test_a_rest_is_what_is_left_of_it_by_half_a_window_at_both_ends(rest: float) -> None:
    """A sample stands when nothing moves in the window around it; what is shorter than the window is none."""
    found = stretches({"q1": stream(standing(4.0, 4.0 + rest))})
    if rest - SECONDS < SECONDS:
        assert found == []
    else:
        ((start, end),) = found
        assert start == pytest.approx(4.0 + SECONDS / 2, abs=1.5 * STEP)
        assert end == pytest.approx(4.0 + rest - SECONDS / 2, abs=1.5 * STEP)


@pytest.mark.parametrize(("speed", "stands"), [(0.9, True), (1.1, False)])
def test_a_joint_that_creeps_by_less_than_the_band_stands(speed: float, stands: bool) -> None:
    creep = speed * BAND / SECONDS
    found = stretches({"q1": stream(lambda t: creep * t)})
    if stands:
        ((start, end),) = found
        assert start == 0.0 and end == pytest.approx(10.0)
    else:
        assert found == []


def test_all_joints_stand_at_once() -> None:
    """Whichever is named first; a joint that never stands leaves nothing."""
    early, late = stream(standing(1.0, 5.0)), stream(standing(3.0, 8.0))
    (common,) = stretches({"q1": early, "q2": late})
    assert stretches({"q2": late, "q1": early}) == [common]
    ((start, _),), ((_, end),) = stretches({"q2": late}), stretches({"q1": early})
    assert common == (start, end)
    assert stretches({"q1": early, "q2": late, "q3": stream(lambda t: t)}) == []
    assert stretches({}) == []


def test_two_rests_of_one_joint_lie_in_one_of_another() -> None:
    def twice(t: Array) -> Array:
        return standing(1.0, 4.0)(t) + np.where(t > 5.0, standing(0.0, 3.0)(t - 5.0) - (t - 5.0), 0.0)

    both = stretches({"q1": stream(twice), "q2": stream(lambda t: 0.0 * t)})
    assert len(both) == 2 and both == stretches({"q1": stream(twice)})


@pytest.mark.parametrize(("gap", "stretch_count"), [(0.9 * SECONDS, 1), (1.1 * SECONDS, 2)])
def test_samples_far_apart_say_nothing_of_what_is_between(gap: float, stretch_count: int) -> None:
    early = np.arange(0.0, 2.0, STEP)
    time = np.concatenate([early, early[-1] + gap + early])
    assert len(stretches({"q1": Stream(time, np.zeros((len(time), 1)))})) == stretch_count


@pytest.mark.parametrize("count", [2, 5])
def test_the_mean_of_points_is_as_sure_as_they_scatter(count: int) -> None:
    values = np.random.default_rng(3).normal([1.0, 2.0, 3.0], size=(count, 3))
    mean, sigma = average(values)
    np.testing.assert_allclose(mean, values.mean(axis=0))
    np.testing.assert_allclose(sigma, values.std(axis=0, ddof=1) / np.sqrt(count))
    mean, sigma = average(values[:1])
    assert np.isnan(sigma).all() and np.isnan(average(values[:0])).all()
    np.testing.assert_array_equal(mean, values[0])


def test_the_mean_of_turns_lies_between_them_in_any_frame() -> None:
    """Also near half a turn, where rotation vectors jump from one side to the other."""
    lean = Rotation.from_rotvec([0.0, 0.0, 0.01])
    for base in (
        Rotation.identity(),
        Rotation.from_rotvec([0.0, 0.0, np.pi]),
        Rotation.from_rotvec([1, -2, 0.5]),
    ):
        turns = [(base * lean**k).as_rotvec() for k in (-1, 0, 1)]
        poses = np.column_stack([np.zeros((3, 3)), turns])
        mean, sigma = average(poses)
        off = Rotation.from_rotvec(mean[3:]).inv() * base
        assert off.magnitude() < 1e-12
        np.testing.assert_allclose(sigma, [0, 0, 0, 0, 0, 0.01 / np.sqrt(3)], atol=1e-9)
