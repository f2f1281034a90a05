"""What rows of a recording owe to rows before them: origins, lags, approach; laws of their order."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from support.recordings import BASIC, read
from truepose.identification.recording.history import exponential_lag, latest_earlier_row


def test_from_is_local_to_a_file_and_survives_a_subset(tmp_path: Path) -> None:
    text = "s,r,x,rx,pose,from\n1,0,0,0,1,1\n2,0,0,0,2,1\n3,0,0,0,1,2\n4,0,0,0,3,1\n"
    recording = read(tmp_path, text, text)
    assert recording.from_row is not None
    assert recording.from_row.tolist() == [0, 0, 1, 2, 4, 4, 5, 6]
    part = recording.subset([7, 1])
    assert part.rows.tolist() == [7, 1]
    assert part.from_row is not None
    assert part.whole.subset(part.from_row).q[:, 0].tolist() == [3.0, 1.0]
    one = part.subset([0])
    assert one.from_row is not None
    assert one.whole.subset(one.from_row).source_row.tolist() == [3]
    assert read(tmp_path, BASIC).from_row is None


@st.composite
def ordered_rows(draw: st.DrawFn) -> tuple[list[int], list[int]]:
    """Pose numbers in order of time, and for each the number of an earlier row or its own."""
    pose = draw(st.lists(st.integers(1, 4), min_size=1, max_size=12))
    return pose, [draw(st.sampled_from(pose[: k + 1])) for k in range(len(pose))]


@given(ordered_rows(), st.randoms(use_true_random=False))
def test_with_a_clock_shuffled_rows_refer_to_the_same_rows(
    rows: tuple[list[int], list[int]], random: Any
) -> None:
    pose, origin = (np.array(column, dtype=np.int64) for column in rows)
    time = np.arange(len(pose), dtype=np.float64)
    plain = latest_earlier_row(pose, origin, None)
    np.testing.assert_array_equal(plain, latest_earlier_row(pose, origin, time))
    assert (plain >= 0).all()
    shuffle = np.array(random.sample(range(len(pose)), len(pose)))
    shuffled = latest_earlier_row(pose[shuffle], origin[shuffle], time[shuffle])
    np.testing.assert_array_equal(shuffle[shuffled], plain[shuffle])


@given(
    st.lists(st.tuples(st.floats(0.1, 50.0), st.floats(-10.0, 10.0)), min_size=2, max_size=15),
    st.floats(1.0, 100.0),
)
def test_a_lag_does_not_depend_on_samples_in_between(
    steps: list[tuple[float, float]], seconds: float
) -> None:
    time, values = np.cumsum([dt for dt, _ in steps]), np.array([value for _, value in steps])
    middle = (time[:-1] + time[1:]) / 2
    finer = np.sort(np.concatenate([time, middle]))
    coarse = exponential_lag(time, values, seconds)
    fine = exponential_lag(finer, np.interp(finer, time, values), seconds)
    np.testing.assert_allclose(fine[::2], coarse, rtol=1e-9, atol=1e-9)
    assert coarse.min() >= values.min() - 1e-9
    assert coarse.max() <= values.max() + 1e-9
    np.testing.assert_array_equal(exponential_lag(time, values, 0.0), values)
    np.testing.assert_allclose(exponential_lag(time, np.full_like(values, 21.0), seconds), 21.0)


def test_what_depends_on_history_is_the_same_in_a_part_and_in_any_order(tmp_path: Path) -> None:
    rows = ["1,0,0,0,0,20", "3,0,0,0,60,24", "2,0,0,0,120,30", "2,0,0,0,500,22"]
    header = "s,r,x,rx,time,temperature.air\n"
    recording = read(tmp_path, header + "\n".join(rows))
    order = [2, 0, 3, 1]
    shuffled = read(tmp_path, header + "\n".join(rows[k] for k in order))
    lagged, other = recording.driver("temperature.base~300"), shuffled.driver("temperature.base~300")
    part = recording.subset(recording.q[:, 0] == 2.0).driver("temperature.base~300")
    assert lagged is not None
    assert other is not None
    assert part is not None
    np.testing.assert_array_equal(other, lagged[order])
    np.testing.assert_array_equal(part, lagged[2:])
    side, again = recording.driver("approach.s"), shuffled.driver("approach.s")
    assert side is not None
    assert again is not None
    np.testing.assert_array_equal(side, [0, 1, -1, -1])
    np.testing.assert_array_equal(again, side[order])


def test_a_lag_follows_a_ramp_one_time_constant_behind() -> None:
    time = np.linspace(0.0, 1000.0, 11)
    lagged = exponential_lag(time, 0.1 * time, 50.0)
    np.testing.assert_allclose(lagged, 0.1 * (time - 50.0 * (1.0 - np.exp(-time / 50.0))), atol=1e-12)
