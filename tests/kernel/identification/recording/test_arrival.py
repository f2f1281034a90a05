"""Laws of what the order of rows tells of the last motion: sides, steps, pieces, time, and rows that are shuffled."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from truepose.arrays import Array
from truepose.identification.recording.history import last_steps, side_of_arrival, stop_operator
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.load import tables
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import table_in_memory
from truepose.models.units import UnitSystem

WAYS = st.lists(st.integers(-40, 40), min_size=2, max_size=30).map(lambda way: np.array(way, dtype=float))
JOINTS = (JointColumn("s", "mm", (-50.0, 50.0)), JointColumn("r", "rad", (-3.0, 3.0)))


def rows(tmp_path: Path, text: str, head: str = "", *, shuffled: bool = False) -> Recording:
    path = tmp_path / "rows.csv"
    path.write_text(head + text)
    return read_recording(
        tables([path]), JOINTS, {}, UnitSystem("mm", "rad"), need_observations=False, shuffled=shuffled
    )


def of(way: Array, band: float = 0.5) -> Array:
    return side_of_arrival(way, np.zeros(len(way), dtype=np.int64), band)


def values(recording: Recording, name: str) -> list[float]:
    found = recording.driver(name)
    assert found is not None
    return [float(value) for value in found]


@settings(max_examples=examples(100), deadline=None)
@given(WAYS)
def test_a_joint_came_from_where_its_last_motion_says(way: Array) -> None:
    expected, side = [], 0.0
    for step in np.diff(way, prepend=way[:1]):
        side = float(np.sign(step)) or side
        expected.append(side)
    assert of(way).tolist() == expected


@settings(max_examples=examples(100), deadline=None)
@given(WAYS, st.integers(0, 1000))
def test_trembling_within_the_band_turns_no_side_round(way: Array, seed: int) -> None:
    """An encoder that scatters by less than half the band, with rests repeated, tells what the exact one tells."""
    rested = np.repeat(way, 3)
    scatter = 0.24 * np.random.default_rng(seed).uniform(-1, 1, len(rested))
    assert of(rested + scatter).tolist() == of(rested).tolist()


@settings(max_examples=examples(100), deadline=None)
@given(WAYS)
def test_long_motions_are_what_play_is_a_function_of(way: Array) -> None:
    """From the first motion on a narrow play operator is at the limit of the side: half its width behind."""
    piece = np.zeros(len(way), dtype=np.int64)
    stop = stop_operator(way, np.zeros(len(way)), piece, 0.1)
    np.testing.assert_allclose(stop, 0.1 * of(way), atol=1e-12)


def test_steps_are_of_motions_of_the_machine() -> None:
    """A joint's small share of a motion counts; rows between which nothing moved but encoders have no motion."""
    q = np.array([[0.0, 0.0], [10.0, 0.01], [10.002, 0.01], [20.0, -5.0], [0.0, 0.0]])
    piece = np.array([0, 0, 0, 0, 1])
    steps = last_steps(q, piece, np.array([0.02, 0.02]))
    expected = np.array([[0.0, 0.0], [10.0, 0.01], [0.0, 0.0], [9.998, -5.01], [0.0, 0.0]])
    np.testing.assert_allclose(steps, expected)


def test_many_short_steps_one_way_are_a_motion() -> None:
    way = np.concatenate([np.linspace(0, 10, 200), np.linspace(10, 9, 200)])
    assert of(way)[[5, 15, 199, 250, 350, -1]].tolist() == [0.0, 1.0, 1.0, 1.0, -1.0, -1.0]


def test_units_do_not_matter(tmp_path: Path) -> None:
    """The band is a share of the travel, so that mm or um, rad or deg tell the same sides."""
    rng = np.random.default_rng(3)
    q = np.cumsum(rng.normal(0, 1, (60, 2)) * [1e-2, 1e-3] * rng.choice([1, 1e-3], (60, 2)), axis=0)
    told = []
    for scale, unit in ((1.0, "mm"), (1e3, "um")):
        table = pd.DataFrame({f"s [{unit}]": q[:, 0] * scale, "r": q[:, 1]})
        path = tmp_path / f"{unit}.csv"
        table.to_csv(path, index=False)
        found = read_recording(tables([path]), JOINTS, {}, UnitSystem("mm", "rad"), need_observations=False)
        told.append(values(found, "approach.s"))
    assert told[0] == told[1]


def test_every_session_and_every_file_begins_anew(tmp_path: Path) -> None:
    found = rows(tmp_path, "s,r,session\n0,0,1\n5,1,1\n9,2,2\n5,1,2\n")
    assert values(found, "approach.s") == [0, 1, 0, -1]
    assert values(found, "step.s") == [0, 5, 0, -4]
    again = tmp_path / "again.csv"
    again.write_text("s,r\n3,0\n5,1\n")
    both = read_recording(
        tables([again, again]), JOINTS, {}, UnitSystem("mm", "rad"), need_observations=False
    )
    assert values(both, "step.s") == [0, 2, 0, 2]


def test_time_counts_where_it_says_another_order(tmp_path: Path) -> None:
    """Rows of one recording in any order mean the same where time is recorded."""
    told = rows(tmp_path, "time,s,r\n3,5,1\n1,0,0\n2,9,2\n")
    assert values(told, "approach.s") == [-1, 0, 1]
    assert values(told, "step.r") == [-1, 0, 2]


def test_what_is_recorded_holds(tmp_path: Path) -> None:
    found = rows(tmp_path, "s,r,approach.s\n0,0,1\n5,1,-1\n9,2,0\n")
    assert values(found, "approach.s") == [1, -1, 0]
    assert values(found, "approach.r") == [0, 1, 1]
    assert not found.inferred("approach.s")
    assert found.inferred("approach.r")
    assert found.inferred("step.s")


def test_rows_of_a_part_came_as_in_the_whole(tmp_path: Path) -> None:
    found = rows(tmp_path, "s,r\n0,0\n5,1\n9,2\n3,1\n")
    part = found.subset([3, 1])
    for name in ("approach.s", "step.r"):
        assert values(part, name) == [values(found, name)[k] for k in (3, 1)]


@pytest.mark.parametrize("head", ["# order: shuffled\n", "# monday\n# Order = shuffled, twice\n"])
def test_shuffled_rows_tell_no_way(tmp_path: Path, head: str) -> None:
    text = "time,s,r,approach.s\n0,0,0,1\n1,5,1,1\n2,9,2,-1\n"
    for found in (rows(tmp_path, text, head), rows(tmp_path, text, shuffled=True)):
        assert found.shuffled
        assert found.subset([0, 1]).shuffled
        assert values(found, "approach.s") == [1, 1, -1]
        for name in ("approach.r", "step.s", "stop.s~1", "loop.s~1~-5~5", "creep.s~1"):
            assert found.driver(name) is None
        assert found.driver("time~2") is not None  # a column through a lag needs the clock, not the way
        assert any("declared shuffled" in note for note in found.notes)


def test_a_comment_below_the_header_declares_nothing(tmp_path: Path) -> None:
    assert not rows(tmp_path, "s,r\n0,0\n# order: shuffled\n5,1\n").shuffled
    assert not rows(tmp_path, "s,r\n0,0\n5,1\n", "# in order, not shuffled\n").shuffled


def test_one_shuffled_file_takes_the_order_from_all(tmp_path: Path) -> None:
    first = tmp_path / "first.csv"
    first.write_text("# order: shuffled\ns,r\n3,0\n5,1\n")
    other = table_in_memory({"s": [1.0, 2.0], "r": [0.0, 1.0]}, "table")
    both = read_recording(
        tables([first, other]), JOINTS, {}, UnitSystem("mm", "rad"), need_observations=False
    )
    assert both.driver("approach.s") is None
    assert "the other files" in both.notes[-1]
    assert replace(both, shuffled=False).driver("approach.s") is not None
