"""Columns that a machine file declares are read in their units; others of numbers are left out, and may be tried."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.short_arm import FRAMES, JOINTS, POSITION, written
from truepose.errors import InputError
from truepose.identification.recording.load import load_recording, tried, try_columns, with_measured_loads
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import catalogue
from truepose.models.machine.machine import Machine

DRIVERS = "drivers: [{name: tilt.column, unit: deg}, {name: torque.q2, unit: kN*m}, note]\n"
ROWS = 5


def arm(folder: Path, drivers: str = DRIVERS) -> Machine:
    return written(folder, JOINTS + FRAMES + POSITION + drivers)


def table(**more: object) -> pd.DataFrame:
    q = {f"q{k}": np.linspace(-40.0, 50.0, ROWS) for k in range(1, 5)}
    return pd.DataFrame({**q, "x": 1.0, "y": 2.0, "z": 3.0, **more})


def values(recording: Recording, name: str) -> list[float]:
    found = recording.driver(name)
    assert found is not None
    return [float(f"{value:.9g}") for value in found]


@pytest.mark.parametrize(("header", "factor"), [("tilt.column", 1.0), ("tilt.column [mdeg]", 1e3)])
def test_a_declared_column_is_in_its_unit_or_that_of_its_header(
    tmp_path: Path, header: str, factor: float
) -> None:
    machine, tilt = arm(tmp_path), np.linspace(0.0, 0.4, ROWS)
    recording = load_recording(machine, table(**{header: tilt * factor, "torque.q2": tilt, "note": tilt}))
    assert values(recording, "tilt.column") == pytest.approx(np.radians(tilt))
    assert values(recording, "torque.q2") == pytest.approx(1000 * tilt)
    assert values(recording, "note") == pytest.approx(tilt)  # nobody says in which unit
    assert not recording.notes and not recording.untried
    # what is written out is read again as the same
    again = load_recording(machine, recording.to_frame())
    assert values(again, "tilt.column") == values(recording, "tilt.column")


def test_a_header_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"column 'tilt.column': unit 'mm' is a length, expected a unit convertible to rad"
    ):
        load_recording(arm(tmp_path), table(**{"tilt.column [mm]": 1.0}))  # fmt: skip


def test_what_drives_hold_needs_no_declaration(tmp_path: Path) -> None:
    machine = arm(tmp_path, "")
    recording = load_recording(machine, table(**{"torque.q3": np.arange(5.0), "current.q1 [mA]": 2.0}))
    assert values(recording, "current.q1") == [0.002] * 5 and not recording.notes
    knows = with_measured_loads(machine, recording)
    assert set(knows.drivers) == {"torque.q3", "current.q1"} and knows.drives("current.q1") == "load"
    assert with_measured_loads(knows, recording) is knows
    assert set(recording.columns(smooth=True)) == set(recording.joints)


def test_a_column_that_nobody_declared_is_left_out_and_may_be_tried(tmp_path: Path) -> None:
    machine = arm(tmp_path, "")
    rows = table(**{"tilt [deg]": np.arange(5.0), "still": 4.0, "who": list("abcde"), "oil": np.arange(5.0)})
    recording = load_recording(machine, rows)
    assert recording.untried == ("tilt", "oil") and recording.driver("tilt") is None
    assert "ignored columns that mean nothing here: 'tilt', 'still', 'who', 'oil'" in recording.notes[0]
    every = try_columns(machine, rows)
    assert tried(every) == ("tilt", "oil") == every.drivers and every.driver_unit("tilt") == "rad"
    one = try_columns(machine, rows, ["oil"])
    assert tried(one) == ("oil",) and load_recording(one, rows).untried == ("tilt",)
    assert values(load_recording(one, rows), "oil") == list(range(5))
    with pytest.raises(InputError, match=r"--try-columns: found 'tlt', expected a column of numbers.*'tilt'"):
        try_columns(machine, rows, ["tlt"])
    with pytest.raises(InputError, match="has none"):
        try_columns(machine, table(), ["tilt"])


def test_a_column_of_a_joints_drive_is_read_under_its_name(tmp_path: Path) -> None:
    machine = arm(tmp_path, "drivers: [{name: axis2, unit: mA, of: q2}]\n")
    recording = load_recording(machine, table(axis2=2000.0, Note=1.0))
    assert values(recording, "current.q2") == [2.0] * 5 and recording.driver("axis2") is None
    assert any("read 'axis2' as 'current.q2'" in note for note in recording.notes)
    assert values(load_recording(machine, recording.to_frame()), "current.q2") == [2.0] * 5
    with pytest.raises(
        InputError, match=r"found the columns .axis2. and .current\.q2., expected one of them"
    ):
        load_recording(machine, table(**{"axis2": 1.0, "current.q2": 1.0}))


@pytest.mark.parametrize(
    ("drivers", "elsewhere"),
    [
        ("", False),
        ("drivers: [torque.q2]\n", False),
        ("drivers: [{name: axis2, unit: N*m, of: q2}]\n", False),
        ("drivers: [{name: torque.q2, drives: load}]\n", True),
        ("drivers: [{name: axis2, unit: N*m, of: q2, drives: load}]\n", True),
        ("drivers: [{name: axis2, unit: N*m}]\n", True),
    ],
)
def test_what_a_joint_holds_drives_that_joint_alone_unless_the_file_says_so(
    tmp_path: Path, drivers: str, elsewhere: bool
) -> None:
    rng = np.random.default_rng(1)
    header = "axis2" if "axis2" in drivers else "torque.q2"
    q = {f"q{k}": rng.uniform(-40, 40, 20) for k in range(1, 5)}
    rows = pd.DataFrame({**q, "x": rng.normal(size=20), "y": 2.0, "z": 3.0, header: rng.normal(size=20)})
    machine = arm(tmp_path, drivers)
    recording = load_recording(machine, rows)
    found = catalogue(with_measured_loads(machine, recording), recording).candidates
    labels = [placed.label for placed in found]
    assert len(set(labels)) == len(labels)
    reading = {placed.place[0] for placed in found if {"axis2", "torque.q2"} & {*placed.drivers}}
    everything = {
        "q1",
        "q2",
        "q3",
        "q4",
        "base",
        "tool",
    }  # what a force moves; a sensor errs by what it reads
    assert reading == (everything if elsewhere else {"q2"})
