"""A recording as a data frame: written and read again it is the same rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.recordings import BASIC, read
from support.results import BUNDLED, machine, recording
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.units import UnitSystem

FULL = (
    "pose,from,session,time [min],role,s [um],r,x,rx,payload [g],temperature.leg1,approach.r,velocity.s\n"
    "1,1,3,0,calibration,1000,90,1,180,5,21,1,2\n"
    "1,1,3,1,calibration,1000,90,1,180,5,22,-1,2\n"
    "2,1,4,2,validation,500,-30,2,90,10,23,0,2\n"
)


def _again(rows: Recording, folder: Path, **options: object) -> Recording:
    text = rows.to_frame().to_csv(index=False)
    return read(folder, text, **options)  # type: ignore[arg-type]


def _arrays(rows: Recording) -> dict[str, Any]:
    """Every array by name; units there and back again are two roundings."""
    fixed = {"q": rows.q, "session": rows.session, "validation": rows.validation}
    optional = {"time": rows.time, "pose": rows.pose, "from": rows.from_row}
    present = {name: values for name, values in optional.items() if values is not None}
    return {**fixed, **present, **rows.observations, **rows.drivers}


def _alike(a: Recording, b: Recording) -> None:
    own, other = _arrays(a), _arrays(b)
    assert a.joints == b.joints and dict(a.labels) == dict(b.labels) and list(own) == list(other)
    for name, values in own.items():
        np.testing.assert_allclose(values, other[name], rtol=1e-14, atol=0.0, err_msg=name)


@pytest.mark.parametrize("units", [UnitSystem(), UnitSystem("m", "rad"), UnitSystem("um", "arcsec")])
def test_a_frame_read_again_is_the_same_recording(tmp_path: Path, units: UnitSystem) -> None:
    stated = FULL.replace(",r,x,rx,", ",r [deg],x [mm],rx [deg],").replace("velocity.s", "velocity.s [mm/s]")
    own = read(tmp_path, stated, units=units)
    assert own.notes == () and own.written["x"] == ("mm", units.length)
    _alike(own, _again(own, tmp_path, units=units))


def test_columns_are_in_the_units_of_the_machine_file(tmp_path: Path) -> None:
    frame = read(tmp_path, FULL).to_frame()
    assert frame["s"].tolist() == [1.0, 1.0, 0.5]  # um in the file, mm by the machine's units
    assert frame["r"].tolist() == pytest.approx([90.0, 90.0, -30.0])
    assert frame["time"].tolist() == [0.0, 60.0, 120.0]
    assert frame["payload"].tolist() == pytest.approx([0.005, 0.005, 0.01])
    assert frame["role"].tolist() == ["calibration", "calibration", "validation"]
    assert frame["from"].tolist() == [1, 1, 1] and frame.index.tolist() == [1, 2, 3]


def test_several_files_are_told_apart_by_the_index(tmp_path: Path) -> None:
    both = read(tmp_path, BASIC, BASIC).to_frame()
    assert both.index.names == ["file", "row"] and both["session"].tolist() == [1, 1, 2, 2]
    assert [row for _, row in both.index] == [1, 2, 1, 2]
    assert "role" not in both and "time" not in both


def test_some_rows_keep_their_numbers(tmp_path: Path) -> None:
    assert read(tmp_path, FULL).subset([2, 0]).to_frame().index.tolist() == [3, 1]


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_recordings_read_again_are_the_same(name: str, tmp_path: Path) -> None:
    path = tmp_path / "again.csv"
    recording(name).to_frame().to_csv(path, index=False)
    _alike(recording(name), load_recording(machine(name), [path]))
