"""Samples of a probe between the rows of a log: what is between, beside, held, thinned; and where all joints stand still."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.command import input_error
from truepose.arrays import Array, Mask
from truepose.identification.leaves.readers.probe import Clock, Pairing, clock_of
from truepose.identification.leaves.readers.probe_clock import trend
from truepose.identification.leaves.readers.settled import BAND, SECONDS, Stream, average, stretches
from truepose.identification.recording.table import Table, table_in_memory

TIME = np.arange(0.0, 10.05, 0.1)
SAMPLES = np.arange(0.55, 9.0, 0.5)


def log(more: Mapping[str, object] | None = None, kept: Mask | None = None) -> Table:
    """One joint turns evenly and one slides ever faster, in the units of their columns."""
    columns: dict[str, Any] = {
        "time": TIME,
        "q1 [deg]": 10.0 * TIME,
        "d2 [mm]": 2.0 * TIME**2,
        **(more or {}),
    }
    chosen = np.ones(len(TIME), dtype=bool) if kept is None else kept
    return table_in_memory({name: np.asarray(v)[chosen] for name, v in columns.items()}, "robot")


def probe(time: Array = SAMPLES, **more: object) -> Table:
    return table_in_memory({"t": time, "x": 3.0 * time, "y": time, "z": 0.0 * time, **more}, "probe")


def test_joints_and_their_velocities_are_those_between_the_rows_of_the_log() -> None:
    found = Pairing.of(probe(label=list(map(str, range(len(SAMPLES))))), log()).rows(Clock(0.25))
    at = SAMPLES + 0.25
    assert found.names == ("time", "q1", "velocity.q1", "d2", "velocity.d2", "x", "y", "z", "label")
    units = {column.name: column.unit for column in found.columns}
    assert units["q1"] == "deg" and units["velocity.q1"] == "deg/s" and units["velocity.d2"] == "mm/s"
    for name, values in (("time", at), ("q1", 10.0 * at), ("d2", 2.0 * at**2), ("x", 3.0 * SAMPLES)):
        np.testing.assert_allclose(found.numbers(name), values, rtol=1e-12)
    np.testing.assert_allclose(found.numbers("velocity.q1"), 10.0, rtol=1e-9)
    np.testing.assert_allclose(found.numbers("velocity.d2"), 4.0 * at, rtol=1e-9)
    assert found.texts("label")[-1] == str(len(SAMPLES) - 1) and found.notes == ()


@pytest.mark.parametrize(("gap", "known"), [(0.4, True), (0.6, False)])
def test_nobody_knows_the_joints_in_a_pause_of_more_than_five_steps(gap: float, known: bool) -> None:
    kept = (TIME < 4.001) | (TIME - gap > 3.999)
    samples = np.array([3.95, 3.99, 4.2, 4.02 + gap, 4.95])
    found = Pairing.of(probe(samples), log(kept=kept)).rows(Clock(0.0))
    assert len(found.numbers("time")) == 5 if known else 4
    assert (4.2 in found.numbers("time")) is known
    told = "probe: 1 of 5 samples are outside of robot, or in a gap of it: left out"
    assert found.notes == (() if known else (told,))


def test_samples_beyond_the_log_are_left_out_and_not_all_may_be() -> None:
    samples = np.array([-0.1, 0.0, 5.0, 10.0, 10.1])
    pairing = Pairing.of(probe(samples), log())
    assert pairing.rows(Clock(0.0)).numbers("time").tolist() == [0.0, 5.0, pytest.approx(10.0)]
    with input_error(r"from 99.9 to 110.1 s, the log is from 0 to 10 s; expected both"):
        pairing.rows(Clock(100.0))


def test_rows_are_as_far_apart_as_asked_and_those_of_a_motion() -> None:
    pairing = Pairing.of(probe(np.arange(0.0, 10.0, 0.125)), log())
    for every in (0.125, 0.25, 0.3, 1.0):
        time = pairing.rows(Clock(0.0), every).numbers("time")
        assert time[0] == 0.0 and np.diff(time).min() >= every
        assert np.diff(time).max() < every + 0.125
    rests = log({"q1 [deg]": 0.0 * TIME, "d2 [mm]": 2.0 * np.maximum(TIME - 5.0, 0.0) ** 2})
    some = Pairing.of(pairing.probe, rests).rows(Clock(0.0), most=7).numbers("time")
    assert len(some) == 7 and some[-1] == pairing.rows(Clock(0.0)).numbers("time")[-1]
    # speeds go up evenly from 5 s on: a fifth of the usual top speed is reached after about a fifth of the way
    assert 5.4 < some[0] < 6.1


def test_what_else_was_logged_comes_along() -> None:
    """Numbers as they are between two rows, sessions and roles as they were last; nothing else."""
    more = {
        "temperature.air": 20.0 + TIME,
        "session": np.where(TIME < 5.0, 1, 2),
        "role": np.where(TIME < 5.0, "calibration", "validation"),
        "velocity.q1 [deg/s]": np.full(len(TIME), 10.0),
    }
    samples = np.array([4.95, 4.0, 5.05])
    found = Pairing.of(probe(samples), log(more)).rows(Clock(0.0))
    assert "timestamp" not in found.names and found.names.count("velocity.q1") == 1
    assert found.numbers("time").tolist() == [4.0, 4.95, 5.05]  # in order of time
    np.testing.assert_allclose(found.numbers("temperature.air"), [24.0, 24.95, 25.05])
    assert found.integers("session").tolist() == [1, 1, 2]
    assert found.texts("role") == ("calibration", "calibration", "validation")


def test_joints_may_be_named_and_of_two_rows_at_one_time_the_last_counts() -> None:
    twice = table_in_memory(
        {"time": [0.0, 1.0, 2.0, 2.0, 3.0, 4.0], "q1 [deg]": [0, 1, 99, 2, 3, 4], "load": [5, 5, 5, 5, 5, 6]},
        "robot",
    )
    found = Pairing.of(probe(np.array([2.0, 2.5])), twice, ["q1"]).rows(Clock(0.0))
    assert found.names == ("time", "q1", "velocity.q1", "x", "y", "z")
    np.testing.assert_allclose(found.numbers("q1"), [2.0, 2.5])


def test_the_first_whole_point_tells_the_clocks() -> None:
    """In order of time, once for a time, and only where it was seen."""
    time = np.array([2.0, 1.0, 1.0, 3.0])
    seen = {"a.x": time, "b.x": time, "b.y": 2 * time, "b.z": [5.0, 6.0, 7.0, None]}
    found, place = Pairing.of(table_in_memory({"time": time, **seen}, "probe"), log()).place
    assert found.tolist() == [1.0, 2.0] and place.tolist() == [[1.0, 2.0, 6.0], [2.0, 4.0, 5.0]]
    with input_error("probe: found no point x y z to compare the clocks by"):
        _ = Pairing.of(table_in_memory({"time": time, "a.x": time}, "probe"), log()).place


LOGS: dict[str, tuple[dict[str, object], str]] = {
    "three times": ({"time": [0.0, 1.0, 2.0, 2.0], "q1": [1, 2, 3, 4]}, "robot: found 3 different times, expected a log"),
    "no time": ({"clock": [0.0, 1.0], "q1": [1, 2]}, "robot: found no column of time, expected one called time, timestamp"),
    "no joint": ({"time": [0.0, 1.0], "role": ["a", "b"], "payload": [1, 2]}, "robot: found no column of numbers that may"),
    "a time beyond": ({"time": [0.0, 2e12], "q1": [1, 2]}, "row 2, column 'time': found 2e\\+12, expected at most 1e\\+12"),
}  # fmt: skip


@pytest.mark.parametrize("case", LOGS)
def test_what_is_no_log_is_refused(case: str) -> None:
    columns, expected = LOGS[case]
    with input_error(expected):
        Pairing.of(probe(), table_in_memory(columns, "robot"))


def _blocks(pattern: Array) -> tuple[Array, Array]:
    """Ten blocks of ten rows with these delays, at times about 0."""
    time = np.arange(100.0)
    return time - time.mean(), np.repeat(pattern, 10)


def test_a_rate_is_found_whatever_the_clock_was_before() -> None:
    time = np.linspace(-50.0, 70.0, 120)
    for before in (Clock(2.0), Clock(2.0, 0.1, 1e-3, 30.0)):
        late = 0.01 + 2e-3 * time
        found = trend(before, time, np.ones(120), late)
        np.testing.assert_allclose(found.of_log(time), before.of_log(time) + late, atol=1e-9)


@pytest.mark.parametrize(("size", "beyond_doubt"), [(3.9, False), (4.1, True)])
def test_a_rate_is_believed_from_four_sigmas_on(size: float, beyond_doubt: bool) -> None:
    pattern = 0.01 * np.array([1, -1, -1, 1, 0, 0, 1, -1, -1, 1.0])  # neither a mean nor a trend
    time, noise = _blocks(pattern)
    when = time.reshape(10, 10).mean(axis=1)
    left = np.mean(pattern**2)
    sigma = np.sqrt(left / np.mean(when**2) / 8.0)
    late = noise + np.repeat(size * sigma * when, 10)
    found = trend(Clock(0.0), time, np.ones(100), late)
    assert found.rate == (pytest.approx(size * sigma) if beyond_doubt else 0.0)
    if beyond_doubt:
        assert found.sigma == pytest.approx(np.sqrt(left / 8.0))


def _wandering(time: Array) -> Array:
    """(k, 2) of a motion that does not repeat itself."""
    one = np.sin(0.7 * time) + 0.6 * np.sin(1.9 * time + 1.0) + 0.3 * np.sin(3.1 * time**1.01)
    return np.column_stack([one, np.sin(1.3 * time + 0.4) + 0.4 * np.sin(2.3 * time)])


@pytest.mark.parametrize("turns", [True, False])
def test_joints_that_turn_or_slide_tell_the_clocks_to_about_a_sample(turns: bool) -> None:
    """A gantry's place goes with its readings in whatever unit they are, an arm's with their sines."""
    offset, time = 1.234, np.arange(3.0, 40.0, 0.02)
    q = _wandering(time + offset)
    a, b = (np.sin(q) if turns else q).T
    place = np.column_stack([100.0 * a, 80.0 * b, 10.0 * a * b])
    stamps = np.arange(0.0, 45.0, 0.02)
    robot = table_in_memory(
        {"time": stamps, **dict(zip("ab", 500.0 * _wandering(stamps).T, strict=True))}, "robot"
    )
    read = table_in_memory({"time": time, **dict(zip("xyz", place.T, strict=True))}, "probe")
    assert clock_of(Pairing.of(read, robot)).offset == pytest.approx(offset, abs=0.04)
    few = table_in_memory({name: read.numbers(name)[:19] for name in read.names}, "probe")
    with input_error("probe and robot: found less than 20 samples"):
        clock_of(Pairing.of(few, robot))


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
