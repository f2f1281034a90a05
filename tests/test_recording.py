"""Recordings: values in internal units, every refusal by file, row and column, and laws of their order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truepose.errors import InputError
from truepose.identification.history import exponential_lag, latest_earlier_row
from truepose.identification.recording import JointColumn, Recording, read_recording
from truepose.models.units import UnitSystem

SHARED = Path(__file__).parents[1].parent / "shared"
JOINTS = (JointColumn("s", "mm", (0.0, 100.0)), JointColumn("r", "rad", (-math.pi, math.pi)))
SENSOR = {"x": "mm", "rx": "rad"}
BASIC = "s,r,x,rx\n10,90,1,180\n20,-90,2,0\n"


def _read(
    tmp_path: Path,
    *texts: str,
    joints: Sequence[JointColumn] = JOINTS,
    sensor: dict[str, str] = SENSOR,
    units: UnitSystem | None = None,
    **options: Any,
) -> Recording:
    paths = [tmp_path / f"{chr(97 + k)}.csv" for k in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text, encoding="utf-8")
    return read_recording(paths, joints, sensor, units or UnitSystem(), **options)


def _refusal(tmp_path: Path, *texts: str, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        _read(tmp_path, *texts, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_values_are_in_internal_units(tmp_path: Path) -> None:
    recording = _read(tmp_path, "# made by hand\n" + BASIC + "# the end\n\n")
    np.testing.assert_array_equal(recording.q, [[10.0, math.pi / 2], [20.0, -math.pi / 2]])
    np.testing.assert_array_equal(recording.readings["x"], [1.0, 2.0])
    np.testing.assert_array_equal(recording.readings["rx"], [math.pi, 0.0])
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
    recording = _read(tmp_path, text, units=UnitSystem("m", "rad"))
    assert recording.q[0] == pytest.approx([10.0, 0.5])
    assert recording.readings["x"][0] == pytest.approx(1.0)
    assert recording.readings["rx"][0] == 2.0
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
    recording = _read(tmp_path, text, joints=joints, sensor={}, units=UnitSystem(joint="turn"))
    assert recording.q[0] == pytest.approx([1.5, 2.0])
    velocity = recording.driver("velocity.s")
    assert velocity is not None
    assert velocity[0] == 2.0


ROW_2 = "s,r,x,rx\n10,90,1,180\n{}\n"
REFUSED = {
    "missing joint": ("r,x,rx,ss\n0,0,0,0\n", "a.csv: missing column 's'; did you mean 'ss'?"),
    "missing reading": ("s,r,x\n0,0,0\n", "a.csv: missing column 'rx'"),
    "text": (ROW_2.format("10,abc,1,1"), "a.csv: row 2, column 'r': found 'abc', expected a finite number"),
    "grouped digits": (ROW_2.format("1_0,0,1,1"), "a.csv: row 2, column 's': found '1_0'"),
    "nan": (ROW_2.format("10,0,nan,1"), "a.csv: row 2, column 'x': found 'nan'"),
    "infinity": (ROW_2.format("10,0,1,-inf"), "a.csv: row 2, column 'rx': found '-inf'"),
    "empty cell": (ROW_2.format("10,0,,1"), "a.csv: row 2, column 'x': found an empty cell"),
    "short row": (ROW_2.format("10,0,1"), "a.csv: row 2: found 3 cells, expected 4"),
    "above range": (
        ROW_2.format("105.1,0,1,1"),
        "a.csv: row 2, column 's': found 105.1 mm, expected a value in",
    ),
    "below range": (
        ROW_2.format("10,-199,1,1"),
        "column 'r': found -199 deg, expected a value in the joint's range",
    ),
    "twice": ("s,r,x,rx,x\n0,0,0,0,0\n", "a.csv: column 'x': found twice"),
    "twice with a unit": ("s,r,x,rx,x [um]\n0,0,0,0,0\n", "a.csv: column 'x': found twice"),
    "no row": ("s,r,x,rx\n", "a.csv: found no row"),
    "nothing": ("", "a.csv: found no header"),
    "semicolons": (BASIC.replace(",", ";"), "expected commas"),
    "unknown unit": (BASIC.replace("x,rx", "x [mmm],rx"), "a.csv: column 'x': unknown unit 'mmm', expected"),
    "wrong unit": (BASIC.replace("x,rx", "x [deg],rx"), "a.csv: column 'x': unit 'deg' is an angle"),
    "plain angle": (BASIC.replace("r,x", "r [1],x"), "a.csv: column 'r': unit '1' is a plain number"),
    "role": ("s,r,x,rx,role\n0,0,0,0,test\n", "a.csv: row 1, column 'role': found 'test', expected"),
    "no role": ("s,r,x,rx,role\n0,0,0,0,\n", "a.csv: row 1, column 'role': found an empty cell"),
    "approach": (
        "s,r,x,rx,approach.s\n0,0,0,0,2\n",
        "a.csv: row 1, column 'approach.s': found 2, expected -1",
    ),
    "pose": (
        "s,r,x,rx,pose\n0,0,0,0,1.5\n",
        "a.csv: row 1, column 'pose': found 1.5, expected a whole number",
    ),
    "session": ("s,r,x,rx,session\n0,0,0,0,b\n", "a.csv: row 1, column 'session': found 'b'"),
    "from": (
        "s,r,x,rx,pose,from\n0,0,0,0,1,1\n0,0,0,0,2,3\n0,0,0,0,3,1\n",
        "a.csv: row 2, column 'from': found 3",
    ),
    "from without pose": ("s,r,x,rx,from\n0,0,0,0,1\n", "a.csv: missing column 'pose'"),
    "driver": ("s,r,x,rx,payload\n0,0,0,0,heavy\n", "a.csv: row 1, column 'payload': found 'heavy'"),
    "time": ("s,r,x,rx,time\n0,0,0,0,12:30\n", "a.csv: row 1, column 'time': found '12:30'"),
    "quotes": ('s,r,x,rx\n0,0,0,"0\n', "a.csv: cannot read the file"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_file_row_and_column(tmp_path: Path, case: str) -> None:
    text, expected = REFUSED[case]
    assert expected in _refusal(tmp_path, text)


def test_comments_do_not_count_as_rows(tmp_path: Path) -> None:
    text = "# header next\ns,r,x,rx\n# first\n0,0,0,0\n\n# second\n0,0,oops,0\n"
    assert "row 2, column 'x'" in _refusal(tmp_path, text)


def test_the_fault_names_its_own_file(tmp_path: Path) -> None:
    assert "b.csv: row 1" in _refusal(tmp_path, BASIC, "s,r,x,rx\n0,0,nan,0\n")


def test_a_range_has_five_per_cent_of_slack(tmp_path: Path) -> None:
    recording = _read(tmp_path, "s,r,x,rx\n105,-197.9,0,0\n-5,197.9,0,0\n")
    assert recording.q[0, 0] == 105.0


@pytest.mark.parametrize(
    "content", [None, b"PAR1 and nothing more", b"\xff\xfes,r\n", b"s,r,x,rx\n0,0,0,\x00\n"]
)
def test_unreadable_files_are_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "a.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.csv: "):
        read_recording([path], JOINTS, SENSOR, UnitSystem())
    with pytest.raises(InputError, match="cannot read the file"):
        read_recording([tmp_path], JOINTS, SENSOR, UnitSystem())
    with pytest.raises(InputError, match="no recording"):
        read_recording([], JOINTS, SENSOR, UnitSystem())


def test_readings_may_be_missing_where_none_are_needed(tmp_path: Path) -> None:
    recording = _read(tmp_path, "s,r,x\n10,90,1\n", need_readings=False)
    assert set(recording.readings) == {"x"}
    text = "s,r\n10,90\n"
    assert "missing column 'from'" in _refusal(tmp_path, text, need_readings=False, required=("from",))


def test_unknown_columns_are_ignored_with_a_note(tmp_path: Path) -> None:
    (note,) = _read(tmp_path, "goal,s,r,x,rx,aproach.s\n1,0,0,0,0,up\n").notes
    assert "'goal'" in note
    assert "'aproach.s' (did you mean 'approach.s'" in note


def test_labels_are_texts(tmp_path: Path) -> None:
    text = "set,placement,socket,s,r\na,left,0,1,2\nb,right,1,1,2\n"
    sensor = {"placement": "label", "socket": "label"}
    recording = _read(tmp_path, text, sensor=sensor, optional_labels=("set",))
    assert recording.labels == {"placement": ("left", "right"), "socket": ("0", "1"), "set": ("a", "b")}
    assert _read(
        tmp_path, text.replace("set", "bag"), sensor=sensor, optional_labels=("set",)
    ).labels.keys() == {
        "placement",
        "socket",
    }
    assert "row 1, column 'placement': found an empty cell" in _refusal(
        tmp_path, text.replace("left", ""), sensor=sensor
    )


def test_arrays_are_read_only(tmp_path: Path) -> None:
    recording = _read(tmp_path, "s,r,x,rx,time,pose,approach.s\n1,1,1,1,1,1,1\n2,2,2,2,2,2,1\n")
    part = recording.subset([1])
    for array in (recording.q, part.q, recording.readings["x"], recording.time, part.driver("approach.s")):
        assert array is not None
        assert not array.flags.writeable
        assert array.dtype == np.float64
    assert not recording.replicates().flags.writeable


def test_temperatures_of_unlogged_places_are_the_airs(tmp_path: Path) -> None:
    text = "s,r,x,rx,temperature.air,temperature.base\n0,0,0,0,20,25\n"
    recording = _read(tmp_path, text, "s,r,x,rx,temperature.air\n0,0,0,0,18\n")
    base, leg = recording.driver("temperature.base"), recording.driver("temperature.leg1")
    assert base is not None
    assert leg is not None
    assert base.tolist() == [25.0, 18.0]
    assert leg.tolist() == [20.0, 18.0]
    assert recording.driver("payload") is None
    assert recording.driver("temperature.base~100") is None  # no clock


def test_columns_of_some_files_only_are_not_used(tmp_path: Path) -> None:
    recording = _read(tmp_path, "s,r,x,rx,payload,time\n0,0,0,0,5,1\n", BASIC)
    assert recording.driver("payload") is recording.driver("time") is None
    assert len([note for note in recording.notes if "is not used" in note and "b.csv" in note]) == 2


def test_sessions_are_shared_by_number_and_files_without_are_their_own(tmp_path: Path) -> None:
    numbered = "s,r,x,rx,session\n0,0,0,0,3\n0,0,0,0,1\n"
    recording = _read(tmp_path, BASIC, numbered, numbered, BASIC)
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
    recording = _read(tmp_path, "s,r,x,rx,session\n0,0,0,0,1\n0,0,0,0,2\n0,0,0,0,4\n", BASIC)
    assert recording.session_rank([1, 4]).tolist() == [0, 1, 1, 1, 1]
    after = recording.driver("session.after.1", sessions=[1, 4])
    assert after is not None
    assert after.tolist() == [0.0, 1.0, 1.0, 1.0, 1.0]


def test_replicates_agree_in_file_session_pose_and_joints(tmp_path: Path) -> None:
    text = "s,r,x,rx,pose,session\n1,1,0,0,1,1\n2,1,0,0,2,1\n1,1,0,0,1,1\n1,2,0,0,1,1\n1,1,0,0,1,2\n"
    labels = _read(tmp_path, text, text).replicates().tolist()
    assert labels[0] == labels[2]
    assert labels[5] == labels[7]
    assert len(set(labels)) == 8
    assert len(set(_read(tmp_path, "s,r,x,rx\n1,1,0,0\n1,1,0,0\n").replicates().tolist())) == 2


def test_from_is_local_to_a_file_and_survives_a_subset(tmp_path: Path) -> None:
    text = "s,r,x,rx,pose,from\n1,0,0,0,1,1\n2,0,0,0,2,1\n3,0,0,0,1,2\n4,0,0,0,3,1\n"
    recording = _read(tmp_path, text, text)
    assert recording.from_row is not None
    assert recording.from_row.tolist() == [0, 0, 1, 2, 4, 4, 5, 6]
    part = recording.subset([7, 1])
    assert part.rows.tolist() == [7, 1]
    assert part.origins().q[:, 0].tolist() == [3.0, 1.0]
    assert part.subset([0]).origins().source_row.tolist() == [3]
    with pytest.raises(ValueError, match="no column 'from'"):
        _read(tmp_path, BASIC).origins()


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


def test_a_lag_follows_a_ramp_one_time_constant_behind() -> None:
    time = np.linspace(0.0, 1000.0, 11)
    lagged = exponential_lag(time, 0.1 * time, 50.0)
    np.testing.assert_allclose(lagged, 0.1 * (time - 50.0 * (1.0 - np.exp(-time / 50.0))), atol=1e-12)


def test_what_depends_on_history_is_the_same_in_a_part_and_in_any_order(tmp_path: Path) -> None:
    rows = ["1,0,0,0,0,20", "3,0,0,0,60,24", "2,0,0,0,120,30", "2,0,0,0,500,22"]
    header = "s,r,x,rx,time,temperature.air\n"
    recording = _read(tmp_path, header + "\n".join(rows))
    order = [2, 0, 3, 1]
    shuffled = _read(tmp_path, header + "\n".join(rows[k] for k in order))
    lagged, other = recording.driver("temperature.base~300"), shuffled.driver("temperature.base~300")
    part = recording.subset(recording.q[:, 0] == 2.0).driver("temperature.base~300")
    assert lagged is not None
    assert other is not None
    assert part is not None
    np.testing.assert_array_equal(other, lagged[order])
    np.testing.assert_array_equal(part, lagged[2:])
    assert recording.derived_approach("s").tolist() == [0.0, 1.0, -1.0, -1.0]
    assert shuffled.derived_approach("s").tolist() == [-1.0, 0.0, -1.0, 1.0]
    assert recording.subset(slice(2, 3)).derived_approach("s").tolist() == [-1.0]
    assert recording.driver("approach.s") is None


def test_an_empty_part_is_empty(tmp_path: Path) -> None:
    assert len(_read(tmp_path, BASIC).subset([])) == 0


reading = st.floats(-1e6, 1e6)
frames = st.lists(
    st.tuples(st.floats(0, 100), st.floats(-180, 180), reading, reading, st.integers(1, 3)), min_size=1
)


@settings(max_examples=30)
@given(frames)
def test_csv_and_parquet_hold_the_same(tmp_path_factory: pytest.TempPathFactory, rows: list[Any]) -> None:
    folder = tmp_path_factory.mktemp("table")
    frame = pd.DataFrame(rows, columns=["s", "r", "x [um]", "rx", "pose"])
    frame["role"] = ["validation" if k % 2 else "calibration" for k in range(len(frame))]
    frame.to_csv(folder / "a.csv", index=False)
    frame.to_parquet(folder / "a.parquet")
    one, two = (
        read_recording([folder / f"a.{kind}"], JOINTS, SENSOR, UnitSystem()) for kind in ("csv", "parquet")
    )
    np.testing.assert_array_equal(one.q, two.q)
    np.testing.assert_array_equal(one.validation, two.validation)
    np.testing.assert_array_equal(one.replicates(), two.replicates())
    for name in SENSOR:
        np.testing.assert_array_equal(one.readings[name], two.readings[name])


@pytest.mark.parametrize(
    ("column", "values", "expected"),
    [
        ("x", [1.0, None], "row 2, column 'x': found an empty cell"),
        ("x", ["1", "far"], "row 2, column 'x': found 'far'"),
        ("x", [True, False], "row 1, column 'x': found True"),
        ("x", [1.0, math.inf], "row 2, column 'x': found inf"),
        ("role", ["calibration", None], "row 2, column 'role': found an empty cell"),
    ],
)
def test_parquet_is_refused_like_csv(tmp_path: Path, column: str, values: list[Any], expected: str) -> None:
    frame = pd.DataFrame({"s": [1.0, 2.0], "r": [1, 2], "x": [0.0, 0.0], "rx": [0.0, 0.0], column: values})
    frame.to_parquet(tmp_path / "a.parquet")
    with pytest.raises(InputError) as caught:
        read_recording([tmp_path / "a.parquet"], JOINTS, SENSOR, UnitSystem())
    assert str(caught.value).startswith(f"{tmp_path / 'a.parquet'}: {expected}")


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
def test_recordings_at_hand_are_accepted(name: str) -> None:
    if not (SHARED / name).exists():
        pytest.skip("no recordings beside the repository")
    kinds, sensor, units, n_rows = AT_HAND[name]
    joints = [JointColumn(f"{stem}{k}", unit) for k, (stem, unit) in enumerate(kinds, start=1)]
    recording = read_recording([SHARED / name], joints, sensor, units)
    assert len(recording) == n_rows
    assert set(recording.readings) == set(sensor)
