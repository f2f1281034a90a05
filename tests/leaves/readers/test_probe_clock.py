"""A probe and a robot's log with a clock each: paired by time, the clocks told by the motion or by the machine's geometry.

The motion, the kinematics and the clocks are plain numpy (``support.probe_logs``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from support.command import invoke
from support.probe_logs import OFF, OFFSET, START, joints_at, pose_of, written
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.leaves.readers.turns import with_rotation_vector
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.table import table_in_memory
from truepose.models.load import load_machine


def imported(folder: Path, *words: object, ends: int = 0) -> str:
    """Import a probe with a robot's log; return what is said, in one line."""
    files = (folder / "probe.csv", "--log", folder / "robot.csv", "-o", folder / "out.csv")
    done = invoke("import", *files, *words)
    assert done.exit_code == ends, done.output
    return " ".join(done.output.split())


def rows_of(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "out.csv", comment="#")


@pytest.mark.parametrize("ppm", [0.0, 40.0])
def test_the_machine_tells_the_clocks_and_a_calibration_follows(tmp_path: Path, ppm: float) -> None:
    written(tmp_path, 90.0, ppm)
    said = imported(tmp_path, "--model", tmp_path / "cell.yaml", "--every", 0.2)
    rows = rows_of(tmp_path)
    true = (rows["time [s]"] - START).to_numpy()
    # 0.02 mm at about 300 mm/s is 0.07 ms for one sample; by many it is told to microseconds
    q = rows[[f"q{k}" for k in range(1, 7)]].to_numpy()
    assert np.abs(q - joints_at(true)).max() < 0.01
    _, place = pose_of(q)
    assert np.sqrt(np.mean((place - rows[["x", "y", "z"]].to_numpy()) ** 2)) < 0.03
    told = said.partition("drift apart by ")[2].split()
    assert float(told[0]) == pytest.approx(ppm, rel=0.05) if ppm else not told
    machine = load_machine(tmp_path / "cell.yaml")
    fit = calibrate(machine, load_recording(machine, tmp_path / "out.csv")).fit
    found = dict(zip(fit.prior.names, fit.p, strict=True))
    # the second and third joint are parallel, so that a zero of one can be told from the other's by lengths alone
    assert np.degrees(found["q2.theta"] + found["q3.theta"]) == pytest.approx(OFF - 90.0, abs=0.01)


def test_the_motion_alone_tells_the_clocks_to_milliseconds(tmp_path: Path) -> None:
    written(tmp_path, 90.0)
    note = imported(tmp_path)
    offset = float(note.partition("probe.csv plus ")[2].split()[0])
    sigma = float(note.partition("+- ")[2].split()[0])
    assert abs(offset - OFFSET) < min(0.02, 4 * sigma)
    assert "--model MACHINE tells it more exactly" in note


def test_what_was_stated_and_logged_is_kept(tmp_path: Path) -> None:
    written(tmp_path, 30.0)
    imported(tmp_path, "--offset", OFFSET, "--every", 0.5, "--rename", "q6=wrist")
    rows = rows_of(tmp_path)
    assert list(rows.columns) == [
        "time [s]",
        *(n for k in range(1, 6) for n in (f"q{k}", f"velocity.q{k}")),
        *("wrist", "velocity.wrist", "temperature.air", "session"),
        *("x", "y", "z", "rx [deg]", "ry [deg]", "rz [deg]"),
    ]
    assert (rows["session"] == 4).all()
    assert np.diff(rows["time [s]"]).min() >= 0.5 - 1e-6
    true = joints_at((rows["time [s]"] - START).to_numpy())
    # noise of 1e-4 deg; a parabola's slope over 8 ms is off by a 1e-3 part of it
    assert np.abs(rows[["q1", "q2", "q3"]].to_numpy() - true[:, :3]).max() < 2e-3
    turn, _ = pose_of(true)
    read = Rotation.from_rotvec(rows[["rx [deg]", "ry [deg]", "rz [deg]"]].to_numpy(), degrees=True)
    assert np.degrees((read.inv() * Rotation.from_matrix(turn)).magnitude().max()) < 0.01


def test_markers_tell_the_clocks_too(tmp_path: Path) -> None:
    written(tmp_path, 90.0)
    probe = pd.read_csv(tmp_path / "probe.csv")[["time", "x", "y", "z"]]
    probe.columns = pd.Index(["time", "P1.x", "P1.y", "P1.z"])
    probe["P1.x"] = probe["P1.x"].where(np.arange(len(probe)) % 7 > 0)  # seen no more
    probe.to_csv(tmp_path / "probe.csv", index=False)
    said = imported(tmp_path, "--every", 1)
    rows = rows_of(tmp_path)
    assert list(rows.columns)[-3:] == ["P1.x", "P1.y", "P1.z"]
    assert rows["P1.x"].isna().any()
    offset = float(said.partition("probe.csv plus ")[2].split()[0])
    assert abs(offset - OFFSET) < 0.02


def test_dates_are_times(tmp_path: Path) -> None:
    time = np.arange(0, 3, 0.01)
    stamps = [f"2026-05-01T10:11:{12 + t:09.6f}+00:00" for t in time]
    pd.DataFrame({"time": stamps, "a": time}).to_csv(tmp_path / "robot.csv", index=False)
    stamps = [f"2026-05-01T12:11:{12 + t:09.6f}+02:00" for t in time]
    pd.DataFrame({"t": stamps, "x": time, "y": 0, "z": 0}).to_csv(tmp_path / "probe.csv", index=False)
    imported(tmp_path, "--offset", 0)
    rows = rows_of(tmp_path)
    np.testing.assert_allclose(rows["a"], rows["x"], atol=1e-6)


def _plain(folder: Path, **probe: object) -> None:
    time = np.arange(0, 60, 0.02)
    pd.DataFrame({"time": time, "a": np.sin(time) + np.sin(3.3 * time)}).to_csv(
        folder / "robot.csv", index=False
    )
    rest = {"time": time, "x": np.random.default_rng(0).standard_normal(len(time)), "y": 0.0, "z": 0.0}
    pd.DataFrame(rest | probe).to_csv(folder / "probe.csv", index=False)


def test_a_motion_that_repeats_itself_does_not_tell_the_clocks(tmp_path: Path) -> None:
    written(tmp_path, 120.0, period=12.0)
    assert "the motion repeats itself" in imported(tmp_path, ends=2)


def test_what_cannot_be_paired_is_told(tmp_path: Path) -> None:
    _plain(tmp_path)
    assert "no time shift at which the probe moves when the joints do" in imported(tmp_path, ends=2)
    assert "found no sample at a time of" in imported(tmp_path, "--offset", 500, ends=2)
    assert "found no joint 'b'" in imported(tmp_path, "--joint", "b", "--offset", 0, ends=2)
    _plain(tmp_path, a=1.0)
    assert "column 'a': found there and in" in imported(tmp_path, "--offset", 0, ends=2)


def test_a_joint_that_moves_by_next_to_nothing_tells_no_clock(tmp_path: Path) -> None:
    """Squares of its readings are 0, as is its standard deviation then; the other joint tells the clocks as ever."""
    time = np.arange(0, 60, 0.02)
    turning = np.cumsum(np.random.default_rng(5).standard_normal(len(time)))
    log = pd.DataFrame({"time": time, "a": turning, "b": 1e-200 * np.sin(time)})
    log.to_csv(tmp_path / "robot.csv", index=False)
    pd.DataFrame({"time": time, "x": turning, "y": 0.0, "z": 0.0}).to_csv(tmp_path / "probe.csv", index=False)
    imported(tmp_path)
    rows = rows_of(tmp_path)
    np.testing.assert_allclose(rows["a"], rows["x"], atol=0.1)


@pytest.mark.parametrize("moving", [12, 60])
def test_a_run_that_hardly_moves_tells_no_clock(tmp_path: Path, moving: int) -> None:
    """What moves at twelve samples is not compared."""
    time = np.arange(0, 60, 0.5)
    turning = np.zeros(len(time))
    turning[40 : 40 + moving] = np.cumsum(np.random.default_rng(5).standard_normal(moving))
    turning[40 + moving :] = turning[39 + moving]
    pd.DataFrame({"time": time, "a": turning}).to_csv(tmp_path / "robot.csv", index=False)
    pd.DataFrame({"time": time, "x": turning, "y": 0.0, "z": 0.0}).to_csv(tmp_path / "probe.csv", index=False)
    told = imported(tmp_path, ends=0 if moving == 60 else 2)
    few = "samples at which the probe moves, that clocks could be compared"
    assert (few in told) == (moving == 12)


TURNS = st.lists(
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1), min_size=1, max_size=5
)


@settings(deadline=None, max_examples=50)
@given(TURNS)
def test_every_form_of_a_rotation_is_the_same_rotation(quaternions: list[tuple[float, ...]]) -> None:
    turns = Rotation.from_quat(np.array(quaternions))
    angles = turns.as_euler("ZYX", degrees=True)[:, ::-1]
    q = turns.as_quat()
    tables = {
        "quaternion": {f"q{a}": q[:, k] for k, a in enumerate("xyzw")},
        "auto": {"Roll [rad]": np.radians(angles[:, 0]), "Pitch": angles[:, 1], "Yaw": angles[:, 2]},
        "rpy": {f"r{a}": angles[:, k] for k, a in enumerate("xyz")},
        "vector": dict(zip(("rx", "ry", "rz"), turns.as_rotvec(degrees=True).T, strict=True)),
    }
    for form, columns in tables.items():
        table = with_rotation_vector(table_in_memory({"x": np.zeros(len(q)), **columns}, form), form)
        read = Rotation.from_rotvec(np.column_stack([table.numbers(f"r{a}") for a in "xyz"]), degrees=True)
        # angles near the pole lose half of their digits
        assert (read.inv() * turns).magnitude().max() < 1e-6, form
