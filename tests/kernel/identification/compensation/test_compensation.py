"""Laws of compensation: the corrected command puts the calibrated tool where the drawing's would stand. mm, rad."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner, Result

from support import MACHINES
from support.calibrated_machines import calibrated, path_file, with_drawing
from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.compensation.compensate import Compensation, Method, compensate
from truepose.identification.compensation.path_table import commands, path_rows
from truepose.identification.prediction.predict import predict
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import read_table
from truepose.models.lie import log_so3
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = npt.NDArray[np.float64]
POSE = ["x", "y", "z", "rx", "ry", "rz"]


def followed(machine: Machine, path: Path, method: Method = "exact") -> tuple[Recording, Compensation]:
    _, rows = path_rows(machine, read_table(path))
    return rows, compensate(machine, rows, method=method)


@pytest.mark.parametrize("kind", ["arm", "hexapod", "polisher"])
def test_the_real_tool_stands_where_nominal_links_would_put_it(kind: str, tmp_path: Path) -> None:
    """Checked against the forward kinematics of a second machine file, whose links are the drawing's."""
    machine = calibrated(kind, tmp_path)
    path = path_file(machine, tmp_path)
    table, rows = path_rows(machine, read_table(path))
    found = compensate(machine, rows)
    commands(table, machine, found).to_csv(tmp_path / "commands.csv", index=False)
    ideal = with_drawing(machine, tmp_path)
    meant = predict(ideal, path_rows(ideal, read_table(path))[1])
    real = predict(machine, path_rows(machine, read_table(tmp_path / "commands.csv"))[1])
    columns = [f"pose.{axis}" for axis in POSE]
    # files are in mm and deg; the solver meets poses to 1e-9 of the machine's size
    np.testing.assert_allclose(real[columns], meant[columns], rtol=0, atol=3e-6)
    assert np.max(np.abs(found.command - found.nominal)) > 1e-4


@pytest.mark.parametrize("kind", ["arm", "polisher"])
def test_a_machine_as_drawn_needs_no_correction(kind: str, tmp_path: Path) -> None:
    machine = calibrated(kind, tmp_path, size=0.0)
    _, found = followed(machine, path_file(machine, tmp_path))
    np.testing.assert_allclose(found.command, found.nominal, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", ["arm", "polisher"])
def test_what_the_first_order_leaves_is_of_second_order(kind: str, tmp_path: Path) -> None:
    """Half the errors, a quarter of the remainder (eq. 16); geometry alone, so that everything scales."""
    left = []
    for size in (1.0, 0.5):
        machine = calibrated(kind, tmp_path, size).with_effects(())
        _, found = followed(machine, path_file(machine, tmp_path), "first-order")
        left.append(np.linalg.norm(found.after[:, :3], axis=1))
        assert np.max(left[-1]) < 0.3 * np.max(np.linalg.norm(found.before[:, :3], axis=1))
    assert np.median(left[0] / left[1]) == pytest.approx(4.0, rel=0.1)


def test_poses_ask_for_the_same_as_their_joints(tmp_path: Path) -> None:
    """Poses of the tool in the nominal frame of the base, as the path's own joints mean them."""
    machine = calibrated("polisher", tmp_path)
    path = path_file(machine, tmp_path)
    _, found = followed(machine, path)
    base = _base(machine)
    inside = np.linalg.inv(base) @ found.target
    columns = np.hstack([inside[:, :3, 3], log_so3(inside[:, :3, :3])])
    header = [f"{name} [{'mm' if k < 3 else 'rad'}]" for k, name in enumerate(POSE)]
    pd.DataFrame(columns, columns=header).assign(note="a").to_csv(tmp_path / "poses.csv", index=False)
    table, rows = path_rows(machine, read_table(tmp_path / "poses.csv"))
    again = compensate(machine, rows)
    np.testing.assert_allclose(again.command, found.command, rtol=0, atol=1e-6)
    frame = commands(table, machine, again)
    assert list(frame) == [*header, "note", *machine.mechanism.readings]


def _base(machine: Machine) -> Array:
    """(4, 4) frame of the base as calibrated: Trans(xyz) Rz Ry Rx."""
    value = {parameter.name: parameter.nominal for parameter in machine.frames}
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("ZYX", [value[f"base.r{axis}"] for axis in "zyx"]).as_matrix()
    out[:3, 3] = [value[f"base.{axis}"] for axis in "xyz"]
    return out


def test_drivers_of_the_path_count_row_by_row(tmp_path: Path) -> None:
    """A joint gives way under the payload: the same pose takes another command where the path carries more."""
    machine = calibrated("arm", tmp_path)
    payload = [0.0, 10.0]
    path = path_file(machine, tmp_path, 2, payload=payload)
    frame = pd.read_csv(path)
    frame.iloc[1, 1:] = frame.iloc[0, 1:]
    frame.to_csv(path, index=False)
    _, found = followed(machine, path)
    np.testing.assert_allclose(found.target[0], found.target[1], rtol=0, atol=1e-12)
    assert np.max(np.abs(found.command[1] - found.command[0])) > 1e-5
    np.testing.assert_allclose(found.after, 0.0, atol=1e-6)


def test_columns_come_back_in_order_and_in_their_own_units(tmp_path: Path) -> None:
    machine = calibrated("arm", tmp_path)
    path = path_file(machine, tmp_path, 5, feed=np.arange(5), time=10.0 * np.arange(5))
    frame = pd.read_csv(path)
    frame = frame.rename(columns={"q2 [rad]": "q2"})
    frame["q2"] = np.degrees(frame["q2"])
    frame.to_csv(path, index=False)
    table, rows = path_rows(machine, read_table(path))
    found = compensate(machine, rows)
    out = commands(table, machine, found)
    assert list(out) == list(frame)
    np.testing.assert_allclose(out["q2"], np.degrees(found.command[:, 1]), rtol=1e-12)
    np.testing.assert_allclose(out["q3 [rad]"], found.command[:, 2], rtol=1e-12)


def test_an_instrument_that_counts_changes_is_not_needed(tmp_path: Path) -> None:
    """A path has no column ``from``; the three joints of this stage can correct nothing, and need not."""
    machine = load_machine(MACHINES / "distance.yaml")
    _, found = followed(machine, path_file(machine, tmp_path, 3))
    np.testing.assert_allclose(found.command, found.nominal, rtol=0, atol=1e-9)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["compensate", *(str(argument) for argument in arguments)])


def test_the_command_writes_the_table_and_tells_what_it_did(tmp_path: Path) -> None:
    machine = calibrated("polisher", tmp_path)
    path, out = path_file(machine, tmp_path), tmp_path / "commands.csv"
    result = run(tmp_path / "calibrated.yaml", path, "-o", out)
    assert result.exit_code == 0, result.output
    assert "40 rows" in result.stdout
    _, found = followed(machine, path)
    written = pd.read_csv(out)
    np.testing.assert_allclose(written["q5 [rad]"], found.command[:, 4], rtol=1e-12)
    assert not list(tmp_path.glob(".*partial"))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda f: f.drop(columns="q3 [mm]"), "missing column 'q3'"),
        (
            lambda f: f.assign(x=1.0, y=2.0, z=3.0)[["x", "y", "z"]],
            "missing column 'q1', expected the joints q1",
        ),
        (lambda f: f.assign(**{"q1 [mm]": 640.0, "q2 [mm]": 1150.0, "q3 [mm]": 640.0}), "row 1"),
        (lambda f: f.assign(**{"q4 [rad]": "high"}), "column 'q4'"),
        (lambda f: f.assign(**{"q4 [rad]": 1.0471}), "column 'q4': found that the corrected command"),
    ],
)
def test_a_path_that_cannot_be_followed_is_refused(change: Any, says: str, tmp_path: Path) -> None:
    machine = calibrated("polisher", tmp_path)
    path, out = path_file(machine, tmp_path), tmp_path / "commands.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)
    result = run(tmp_path / "calibrated.yaml", path, "-o", out)
    assert result.exit_code == 2, result.output
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: ") and says in lines[0]
    assert str(path) in lines[0]
    assert not out.exists()


def test_a_pose_out_of_reach_names_its_row(tmp_path: Path) -> None:
    machine = calibrated("polisher", tmp_path)
    path = tmp_path / "poses.csv"
    path.write_text("x,y,z,rx,ry,rz\n0,0,1700,0,10,0\n0,0,9000,0,10,0\n")
    with pytest.raises(
        InputError, match=r"poses.csv: row 2: found a pose that the nominal machine cannot take"
    ):
        path_rows(machine, read_table(path))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda frame: frame + 1e-9, "reads as another path: row 1: q1 is "),
        (lambda frame: frame.iloc[1:], "has 39 rows, expected 40"),
        (lambda frame: frame.drop(columns="q3 [rad]"), "cannot be read: missing column 'q3'"),
    ],
    ids=["digit", "row", "column"],
)
def test_commands_that_read_otherwise_are_not_published(
    change: Callable[[pd.DataFrame], pd.DataFrame],
    said: str,
    suffix: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = calibrated("arm", tmp_path)
    assert machine.file is not None
    path, out = path_file(machine, tmp_path), tmp_path / f"commands{suffix}"
    command = ["compensate", str(machine.file.path), str(path), "-o", str(out), "--anyway"]
    assert CliRunner().invoke(app, command).exit_code == 0
    out.write_text("older")
    reports = tmp_path / "reports"
    reports.mkdir()
    before = sorted(tmp_path.iterdir())
    where = "truepose.identification.compensation.path_table.commands"
    monkeypatch.setattr(where, lambda *given: change(commands(*given)))
    monkeypatch.setattr("tempfile.tempdir", str(reports))
    failed = CliRunner().invoke(app, command)
    assert failed.exit_code == 1 and len(failed.stderr.splitlines()) == 1
    assert re.search(rf"ReadBackError: \S*commands{suffix}: what was to be written {said}", failed.stderr)
    assert sorted(tmp_path.iterdir()) == before and out.read_text() == "older"
