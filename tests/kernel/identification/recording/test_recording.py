"""Recordings: values in internal units, drivers, sessions, replicates and tables of either format."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from support.recordings import BASIC, JOINTS, SENSOR, read, refusal
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.load import tables
from truepose.identification.recording.read import read_recording
from truepose.models.units import UnitSystem


def test_values_are_in_internal_units(tmp_path: Path) -> None:
    recording = read(tmp_path, "# made by hand\n" + BASIC + "# the end\n\n")
    np.testing.assert_array_equal(recording.q, [[10.0, math.pi / 2], [20.0, -math.pi / 2]])
    np.testing.assert_array_equal(recording.observations["x"], [1.0, 2.0])
    np.testing.assert_array_equal(recording.observations["rx"], [math.pi, 0.0])
    assert recording.source_row.tolist() == [1, 2]
    assert recording.where(1) == f"{tmp_path / 'a.csv'}: row 2"
    assert recording.pose is None
    assert recording.time is None
    assert recording.from_row is None
    assert not recording.validation.any()
    assert recording.notes == ()


def test_units_come_from_the_header_else_from_the_machine_file(tmp_path: Path) -> None:
    text = "s [um],r,x [m],rx [rad],time [min],temperature.base [K],payload [g],pressure [Pa],humidity [1]\n"
    text += "10000,0.5,0.001,2,2,293.15,500,101325,0.4\n"
    recording = read(tmp_path, text, units=UnitSystem("m", "rad"))
    assert recording.q[0] == pytest.approx([10.0, 0.5])
    assert recording.observations["x"][0] == pytest.approx(1.0)
    assert recording.observations["rx"][0] == 2.0
    expected = {
        "time": 120.0,
        "temperature.base": 20.0,
        "payload": 0.5,
        "pressure": 1013.25,
        "humidity": 40.0,
    }
    for name, value in expected.items():
        driver = recording.driver(name)
        assert driver is not None
        assert driver[0] == pytest.approx(value)


def test_turns_stay_as_recorded(tmp_path: Path) -> None:
    joints = (JointColumn("s", "turn"), JointColumn("r", "turn"))
    text = "s,r [deg],velocity.s\n1.5,720,2\n"
    recording = read(tmp_path, text, joints=joints, sensor={}, units=UnitSystem(joint="turn"))
    assert recording.q[0] == pytest.approx([1.5, 2.0])
    velocity = recording.driver("velocity.s")
    assert velocity is not None
    assert velocity[0] == 2.0


def test_readings_may_be_missing_where_none_are_needed(tmp_path: Path) -> None:
    recording = read(tmp_path, "s,r,x\n10,90,1\n", need_observations=False)
    assert set(recording.observations) == {"x"}
    text = "s,r\n10,90\n"
    assert "missing column 'from'" in refusal(tmp_path, text, need_observations=False, required=("from",))


def test_unknown_columns_are_ignored_with_a_note(tmp_path: Path) -> None:
    (note,) = read(tmp_path, "goal,s,r,x,rx,aproach.s\n1,0,0,0,0,up\n").notes
    assert "'goal'" in note
    assert "'aproach.s' (did you mean 'approach.s'" in note


def test_labels_are_texts(tmp_path: Path) -> None:
    text = "set,placement,socket,s,r\na,left,0,1,2\nb,right,1,1,2\n"
    sensor = {"placement": "label", "socket": "label"}
    recording = read(tmp_path, text, sensor=sensor, optional_labels=("set",))
    assert recording.labels == {"placement": ("left", "right"), "socket": ("0", "1"), "set": ("a", "b")}
    assert read(
        tmp_path, text.replace("set", "bag"), sensor=sensor, optional_labels=("set",)
    ).labels.keys() == {
        "placement",
        "socket",
    }
    assert "row 1 (line 2), column 'placement': found an empty cell" in refusal(
        tmp_path, text.replace("left", ""), sensor=sensor
    )


def test_arrays_are_read_only(tmp_path: Path) -> None:
    recording = read(tmp_path, "s,r,x,rx,time,pose,approach.s\n1,1,1,1,1,1,1\n2,2,2,2,2,2,1\n")
    part = recording.subset([1])
    for array in (
        recording.q,
        part.q,
        recording.observations["x"],
        recording.time,
        part.driver("approach.s"),
    ):
        assert array is not None
        assert not array.flags.writeable
        assert array.dtype == np.float64
    assert not recording.replicates().flags.writeable


def test_temperatures_of_unlogged_places_are_the_airs(tmp_path: Path) -> None:
    text = "s,r,x,rx,temperature.air,temperature.base\n0,0,0,0,20,25\n"
    recording = read(tmp_path, text, "s,r,x,rx,temperature.air\n0,0,0,0,18\n")
    base, leg = recording.driver("temperature.base"), recording.driver("temperature.leg1")
    assert base is not None
    assert leg is not None
    assert base.tolist() == [25.0, 18.0]
    assert leg.tolist() == [20.0, 18.0]
    assert recording.driver("payload") is None
    assert recording.driver("temperature.base~100") is None  # no clock


@pytest.mark.parametrize("clock", [True, False])
def test_rows_come_in_the_order_of_acquisition_however_they_are_picked(tmp_path: Path, clock: bool) -> None:
    """Without a clock, and where two rows have one time, by file and row."""
    head, times = ("s,r,x,rx,time\n", (",7", ",3", ",7")) if clock else ("s,r,x,rx\n", ("", "", ""))
    texts = [head + "".join(f"{10 * (k + 1)},0,{k},0{t}\n" for k, t in enumerate(times)) for _ in range(2)]
    whole = read(tmp_path, *texts)
    expected = [1, 4, 0, 2, 3, 5] if clock else [0, 1, 2, 3, 4, 5]
    assert whole.order.tolist() == expected
    part = whole.subset([5, 0, 4, 2, 1, 3])
    assert part.rows[part.order].tolist() == expected


def test_columns_of_some_files_only_are_not_used(tmp_path: Path) -> None:
    recording = read(tmp_path, "s,r,x,rx,payload,time\n0,0,0,0,5,1\n", BASIC)
    assert recording.driver("payload") is recording.driver("time") is None
    assert len([note for note in recording.notes if "is not used" in note and "b.csv" in note]) == 2


def test_sessions_are_shared_by_number_and_files_without_are_their_own(tmp_path: Path) -> None:
    numbered = "s,r,x,rx,session\n0,0,0,0,3\n0,0,0,0,1\n"
    recording = read(tmp_path, BASIC, numbered, numbered, BASIC)
    assert recording.session.tolist() == [4, 4, 3, 1, 3, 1, 5, 5]
    assert recording.session_recorded.tolist() == [False] * 2 + [True] * 4 + [False] * 2
    assert recording.sessions == (1, 3, 4, 5)
    assert recording.n_sessions == 4
    after = [recording.driver(f"session.after.{k}") for k in (1, 2, 3)]
    assert [None if a is None else a.tolist() for a in after] == [
        [1, 1, 1, 0, 1, 0, 1, 1],
        [1, 1, 0, 0, 0, 0, 1, 1],
        [0, 0, 0, 0, 0, 0, 1, 1],
    ]


def test_an_unseen_session_takes_the_latest_rank(tmp_path: Path) -> None:
    recording = read(tmp_path, "s,r,x,rx,session\n0,0,0,0,1\n0,0,0,0,2\n0,0,0,0,4\n", BASIC)
    assert recording.session_rank([1, 4]).tolist() == [0, 1, 1, 1, 1]
    after = recording.driver("session.after.1", sessions=[1, 4])
    assert after is not None
    assert after.tolist() == [0.0, 1.0, 1.0, 1.0, 1.0]


def test_replicates_agree_in_file_session_pose_and_joints(tmp_path: Path) -> None:
    text = "s,r,x,rx,pose,session\n1,1,0,0,1,1\n2,1,0,0,2,1\n1,1,0,0,1,1\n1,2,0,0,1,1\n1,1,0,0,1,2\n"
    labels = read(tmp_path, text, text).replicates().tolist()
    assert labels[0] == labels[2]
    assert labels[5] == labels[7]
    assert len(set(labels)) == 8
    assert len(set(read(tmp_path, "s,r,x,rx\n1,1,0,0\n1,1,0,0\n").replicates().tolist())) == 2


reading = st.floats(-1e6, 1e6)
frames = st.lists(
    st.tuples(st.floats(0, 100), st.floats(-180, 180), reading, reading, st.integers(1, 3)), min_size=1
)


@settings(max_examples=examples(30))
@given(frames)
def test_csv_and_parquet_hold_the_same(tmp_path_factory: pytest.TempPathFactory, rows: list[Any]) -> None:
    folder = tmp_path_factory.mktemp("table")
    frame = pd.DataFrame(rows, columns=["s", "r", "x [um]", "rx", "pose"])
    frame["role"] = ["validation" if k % 2 else "calibration" for k in range(len(frame))]
    frame.to_csv(folder / "a.csv", index=False)
    frame.to_parquet(folder / "a.parquet")
    one, two = (
        read_recording(tables([folder / f"a.{kind}"]), JOINTS, SENSOR, UnitSystem())
        for kind in ("csv", "parquet")
    )
    np.testing.assert_array_equal(one.q, two.q)
    np.testing.assert_array_equal(one.validation, two.validation)
    np.testing.assert_array_equal(one.replicates(), two.replicates())
    for name in SENSOR:
        np.testing.assert_array_equal(one.observations[name], two.observations[name])


POSE = dict.fromkeys(("x", "y", "z"), "mm") | dict.fromkeys(("rx", "ry", "rz"), "rad")
AT_HAND = {
    "data/ur10-laser-tracker/configurations.csv": ([("q", "rad")] * 6, POSE, UnitSystem(), 1495),
    "data/ur10-laser-tracker/grid.csv": ([("q", "rad")] * 6, POSE, UnitSystem(), 11911),
    "data/stewart-mocap/session_108.csv": ([("leg", "turn")] * 6, POSE, UnitSystem(joint="turn"), 108),
    "practice/case002/recording.csv": (
        [("q", "mm")] * 3 + [("q", "rad")] * 3,
        {"dL": "mm"},
        UnitSystem(),
        150,
    ),
    "practice/case004/heldout.csv": ([("rho", "mm")] * 6, POSE, UnitSystem(), 24),
}


@pytest.mark.parametrize("name", AT_HAND)
def test_recordings_at_hand_are_accepted(shared: Path, name: str) -> None:
    kinds, sensor, units, n_rows = AT_HAND[name]
    joints = [JointColumn(f"{stem}{k}", unit) for k, (stem, unit) in enumerate(kinds, start=1)]
    recording = read_recording(tables([shared / name]), joints, sensor, units)
    assert len(recording) == n_rows
    assert set(recording.observations) == set(sensor)
