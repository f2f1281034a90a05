"""Laws of the drivers that remember: the stop operator, the straight line of its full loop, creep, and their names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from truepose.arrays import Array
from truepose.identification.recording import history
from truepose.identification.recording.history import creep_sum, line_of_full_loop, stop_operator
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.load import tables
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.models.file.driver import Driver
from truepose.models.units import UnitSystem

WAYS = st.lists(st.floats(-10, 10), min_size=2, max_size=30).map(lambda way: np.array(way, dtype=float))
WIDTHS = st.floats(0.01, 8.0)
JOINTS = (JointColumn("s", "mm", (-50.0, 50.0)), JointColumn("r", "rad", (-3.0, 3.0)))


def stop(way: Array, width: float, approach: Array | None = None, piece: Array | None = None) -> Array:
    """One joint's way through the operator."""
    sides = np.zeros(len(way)) if approach is None else approach
    labels = np.zeros(len(way), dtype=np.int64) if piece is None else piece.astype(np.int64)
    return stop_operator(np.asarray(way, dtype=float), sides, labels, width)


def play(way: Array, width: float) -> Array:
    return np.asarray(way - stop(way, width))


@given(WAYS, WIDTHS)
def test_the_reading_never_leads_the_play_by_more_than_the_width(way: Array, width: float) -> None:
    assert np.max(np.abs(stop(way, width))) <= width
    moved = np.abs(np.diff(play(way, width)))
    assert np.all(moved <= np.abs(np.diff(way)) + 1e-12)


@given(WAYS, WIDTHS, st.integers(1, 4))
def test_only_the_turning_points_count(way: Array, width: float, between: int) -> None:
    """Rate independence: more samples on the same way change nothing."""
    fine = np.interp(np.arange((len(way) - 1) * between + 1) / between, np.arange(len(way)), way)
    np.testing.assert_allclose(stop(fine, width)[::between], stop(way, width), atol=1e-9)


@given(WAYS, WIDTHS)
def test_a_larger_swing_wipes_out_what_was_before(way: Array, width: float) -> None:
    swing = np.array([30.0, -30.0])  # more than twice any width beyond the way
    after = stop(np.concatenate([way, swing]), width)[-1]
    assert after == pytest.approx(-width, abs=1e-12)
    tail = np.array([-25.0, -28.0, 3.0])
    found = stop(np.concatenate([way, swing, tail]), width)[-3:]
    np.testing.assert_allclose(found, stop(np.concatenate([swing, tail]), width)[-3:], atol=1e-12)


@given(st.floats(0.0, 20.0), WIDTHS)
def test_a_first_move_is_followed_until_it_slips(step: float, width: float) -> None:
    assert stop(np.array([1.0, 1.0 + step]), width)[1] == pytest.approx(min(step, width))


@given(WAYS, WIDTHS, st.data())
def test_what_is_recorded_as_approach_holds(way: Array, width: float, data: st.DataObject) -> None:
    sides = np.array(data.draw(st.lists(st.sampled_from([-1.0, 1.0]), min_size=len(way), max_size=len(way))))
    lead = stop(way, width, sides)
    step, before = np.diff(way), np.concatenate([[0.0], lead[:-1]])[1:]
    against = (sides[1:] * step < 0) | ((step == 0) & (sides[1:] != sides[:-1]))
    np.testing.assert_array_equal(lead[1:][against], (width * sides[1:])[against])
    along = sides[1:] * step > 0
    np.testing.assert_allclose(lead[1:][along], np.clip(before + step, -width, width)[along])
    assert lead[0] == width * sides[0]


@given(st.floats(0.01, 1.0), st.floats(-5, 5), st.floats(0.5, 20.0))
def test_the_line_of_a_full_loop_is_its_least_squares_line(part: float, low: float, span: float) -> None:
    width = part * span / 2
    branch = np.linspace(low, low + span, 2001)
    full = np.concatenate([branch, branch[::-1]])
    lead = stop(np.concatenate([branch[::-1], full]), width)[len(branch) :]
    lead[0] = -width  # it came from the top
    slope, height = np.polyfit(full - (low + span / 2), lead, 1)
    line = line_of_full_loop(branch, width, low, low + span)
    assert (line[-1] - line[0]) / span == pytest.approx(slope, abs=3e-3)
    assert height == pytest.approx(0.0, abs=3e-3 * width + 1e-3 * span)


def creep(time: Array, way: Array, piece: Array | None = None) -> Array:
    labels = np.zeros(len(way), dtype=np.int64) if piece is None else piece.astype(np.int64)
    return creep_sum(np.asarray(time, dtype=float), np.asarray(way, dtype=float), labels, 0.1)


@given(WAYS, st.floats(-3, 3))
def test_creep_adds_up_over_moves(way: Array, factor: float) -> None:
    time = np.cumsum(1.0 + np.abs(np.sin(np.arange(len(way)))))
    other = np.cos(3 * np.arange(len(way)))
    together = creep(time, way + factor * other)
    np.testing.assert_allclose(together, creep(time, way) + factor * creep(time, other), atol=1e-9)


def test_one_step_creeps_with_the_logarithm_of_its_age() -> None:
    time = np.array([0.0, 10.0, 10.9, 109.9])
    np.testing.assert_allclose(creep(time, np.array([5.0, 8.0, 8.0, 8.0])), [0, 0, 3.0, 3.0 * np.log10(1000)])


# -- as drivers of a recording ----------------------------------------------------------------------------

NAMES = ("stop.s~3", "loop.s~3~-50~50", "creep.s~0.1", "stop.r~0.2")


def recorded(folder: Path, *frames: pd.DataFrame) -> Recording:
    paths = [folder / f"{k}.csv" for k in range(len(frames))]
    for path, frame in zip(paths, frames, strict=True):
        frame.to_csv(path, index=False)
    return read_recording(tables(paths), JOINTS, {"x": "mm"}, UnitSystem())


def rows(n: int = 40, *, time: bool = True, seed: int = 0) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    data = {"s": np.cumsum(rng.normal(0, 2, n)).clip(-50, 50), "r": rng.uniform(-20, 20, n), "x": np.zeros(n)}
    if time:
        data["time"] = 100 + np.cumsum(rng.uniform(1, 50, n))
    return pd.DataFrame(data)


def driver(recording: Recording, name: str) -> Array:
    values = recording.driver(name)
    assert values is not None
    assert not values.flags.writeable
    return values


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=examples(10))
@given(seed=st.integers(0, 1000))
def test_drivers_depend_on_the_clock_not_on_the_order_of_rows(
    tmp_path_factory: pytest.TempPathFactory, name: str, seed: int
) -> None:
    table, rng = rows(), np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp("memory")
    plain = driver(recorded(folder, table), name)
    assert np.ptp(plain) > 0
    order = rng.permutation(len(table))
    np.testing.assert_allclose(driver(recorded(folder, table.iloc[order]), name), plain[order], atol=1e-12)
    some = np.sort(rng.choice(len(table), 7))
    part = recorded(folder, table).subset(some)
    np.testing.assert_allclose(driver(part, name), plain[some], atol=1e-12)
    np.testing.assert_allclose(driver(part.subset([3, 1]), name), plain[some[[3, 1]]], atol=1e-12)


def test_the_width_is_in_the_readings_own_unit(tmp_path: Path) -> None:
    table = rows()
    recording = recorded(tmp_path, table)
    np.testing.assert_array_equal(
        driver(recording, "stop.r~0.2"), stop(np.radians(table["r"].to_numpy()), 0.2)
    )
    line = line_of_full_loop(recording.q[:, 0], 3.0, -50.0, 50.0)
    np.testing.assert_allclose(driver(recording, "stop.s~3") - driver(recording, "loop.s~3~-50~50"), line)


@pytest.mark.parametrize("time", [True, False])
@pytest.mark.parametrize("one_session", [True, False])
def test_sessions_begin_anew_and_files_where_there_is_no_clock(
    tmp_path: Path, time: bool, one_session: bool
) -> None:
    first, second = rows(time=time), rows(time=time, seed=1)
    if time:
        second["time"] += 5000
    for frame, number in ((first, 1), (second, 1 if one_session else 2)):
        frame["session"] = number
    found = driver(recorded(tmp_path, first, second), "stop.s~3")[len(first) :]
    alone = driver(recorded(tmp_path, second), "stop.s~3")
    assert np.array_equal(found, alone) == (not (time and one_session))


def test_what_is_not_recorded_is_told(tmp_path: Path) -> None:
    timeless = recorded(tmp_path, rows(time=False))
    assert timeless.driver("creep.s~0.1") is None
    assert timeless.driver("stop.s~3") is not None
    for name in ("stop.t~3", "stop.s~3~4~5", "loop.s~3", "stop.s~"):
        assert timeless.driver(name) is None
    assert Driver.of("creep.s~0.1").column == "time"
    assert Driver.of("stop.s~3").column == "s"
    assert Driver.of("temperature.base~300").column == "temperature.base"


@pytest.mark.parametrize(
    ("t0", "dwell", "end"), [(0.1, 0.0, 3600.0), (3.0, 0.5, 86400.0), (100.0, 2.0, 10.0)]
)
def test_creep_of_many_rows_is_that_of_every_move(
    t0: float, dwell: float, end: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exponentials in place of the logarithm: the same to 1e-9 of the largest sum."""
    rng, rows = np.random.default_rng(4), 600
    time, way = (
        np.sort(rng.uniform(0.0, end, rows)),
        np.cumsum(rng.normal(size=rows) * (rng.uniform(size=rows) < 0.5)),
    )
    piece = np.repeat([0, 1, 2], [100, 1, 499])
    exact = creep_sum(time, way, piece, t0, dwell)
    monkeypatch.setattr(history, "MANY", 0)
    np.testing.assert_allclose(
        creep_sum(time, way, piece, t0, dwell), exact, atol=1e-9 * np.max(np.abs(exact))
    )


@given(WAYS, WIDTHS, st.floats(-10, 10), st.floats(-10, 10))
def test_minor_loops_between_the_same_ends_are_congruent(
    way: Array, width: float, low: float, high: float
) -> None:
    """After any past, the second and every later round of a loop has one shape: only its height differs."""
    loop = np.tile(np.linspace(low, high, 5).tolist() + np.linspace(high, low, 5).tolist(), 3)
    rounds = [play(np.concatenate([past, loop]), width)[-10:] for past in (way, np.zeros(1))]
    shapes = [r - r[0] for r in rounds]
    np.testing.assert_allclose(shapes[0], shapes[1], atol=1e-9)
