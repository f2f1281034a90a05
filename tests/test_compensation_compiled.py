"""Long paths by the generated C: the same commands and the same refusals as by numpy, and the same tables. mm, rad."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from typer.testing import CliRunner

from support.generated_c import needs_compiler
from test_compensation import calibrated, path_file
from truepose.cli import app
from truepose.codegen import compiled
from truepose.codegen.c import generate
from truepose.errors import InputError
from truepose.identification import path_file as files
from truepose.identification import path_table
from truepose.identification.compensation import Compensation, compensate
from truepose.identification.compensation_compiled import CompiledKinematics
from truepose.identification.path_file import csv_text, read_path_table
from truepose.identification.path_table import load_path
from truepose.identification.predict import predictor_for
from truepose.identification.table import read_table
from truepose.models.machine import Machine

Array = npt.NDArray[np.float64]
KINDS = ("arm", "hexapod", "polisher")
NUMPY = 10**9
"""More rows than any path here has."""
ELBOW = (0.2, 0.3, 0.2, 0.1, 0.9, 0.3)
"""Joints of the arm around which it is nowhere near a singular pose."""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path_factory.getbasetemp() / "libraries"
    folder.mkdir(mode=0o700, exist_ok=True)
    monkeypatch.setenv("TRUEPOSE_CACHE", str(folder))


def machine_and_path(kind: str, folder: Path, count: int = 60) -> tuple[Machine, Path]:
    """The arm carries from nothing to 10 kg along its path."""
    machine = calibrated(kind, folder)
    columns = {"payload": np.linspace(0.0, 10.0, count)} if kind == "arm" else {}
    path = path_file(machine, folder, count, **columns)
    if kind == "arm":
        frame, rng = pd.read_csv(path), np.random.default_rng(3)
        for name, middle in zip(machine.mechanism.readings, ELBOW, strict=True):
            frame[f"{name} [rad]"] = middle + rng.uniform(-0.3, 0.3, count)
        frame.to_csv(path, index=False)
    return machine, path


def both(machine: Machine, path: Path) -> tuple[Compensation, Compensation]:
    rows = load_path(machine, path)[1]
    return compensate(machine, rows, compiled_from=1), compensate(machine, rows, compiled_from=NUMPY)


def assert_same(machine: Machine, one: Array, other: Array) -> None:
    """Readings (n, nq) that put the tool at the same poses.

    Both ways meet poses within 1e-9 of a machine's size (1.2 m at most) and 1e-9 rad; a joint may need some times that.
    """
    units = [actuator.unit for actuator in machine.mechanism.actuators]
    assert np.all(np.abs(one - other) <= [3e-6 if unit == "mm" else 1e-8 for unit in units])


@needs_compiler
@pytest.mark.parametrize("kind", KINDS)
def test_the_c_gives_the_commands_that_numpy_gives(kind: str, tmp_path: Path) -> None:
    machine, path = machine_and_path(kind, tmp_path)
    by_c, by_numpy = both(machine, path)
    assert (by_c.solved_by, by_numpy.solved_by) == ("compiled C", "numpy")
    assert_same(machine, by_c.command, by_numpy.command)
    for name in ("target", "before", "after"):
        np.testing.assert_allclose(getattr(by_c, name), getattr(by_numpy, name), rtol=0, atol=2e-6)
    assert np.max(np.abs(by_c.command - by_c.nominal)) > 1e-4


@needs_compiler
@pytest.mark.parametrize("kind", KINDS)
def test_the_controllers_function_means_the_same(kind: str, tmp_path: Path) -> None:
    """NAME_compensate as ``truepose codegen`` writes it, row by row with the row's drivers."""
    machine, path = machine_and_path(kind, tmp_path, 12)
    rows = load_path(machine, path)[1]
    assert machine.file is not None
    out = tmp_path / "controller"
    generate(machine, out, nominal=machine.file.nominal)
    texts = {name: (out / f"{machine.name}_kin.{name}").read_text() for name in ("h", "c")}
    library = compiled.load(texts["c"].replace(f'#include "{machine.name}_kin.h"', texts["h"]))
    function = getattr(library, f"{machine.name}_compensate")
    z, commands = predictor_for(machine, rows).z, np.empty_like(rows.q)
    for k, q in enumerate(rows.q):
        places = [array.ctypes.data_as(ctypes.c_void_p) for array in (np.array(q), commands[k])]
        drivers = np.array(z[k]).ctypes.data_as(ctypes.c_void_p) if z.shape[1] else None
        assert function(None, drivers, *places) == 0
    assert_same(machine, commands, compensate(machine, rows).command)


@needs_compiler
@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda f: _with(f, 7, {"q1 [mm]": 640.0, "q2 [mm]": 1150.0, "q3 [mm]": 640.0}), "row 8"),
        (lambda f: _with(f, 5, {"q4 [rad]": 1.0471}), "row 6, column 'q4': found that the corrected command"),
        (lambda f: _with(_with(f, 9, {"q6 [rad]": 1.0471}), 11, {"q4 [rad]": 1.0471}), "row"),
    ],
)
def test_what_numpy_refuses_is_refused_in_the_same_words(
    change: Callable[[pd.DataFrame], pd.DataFrame], says: str, tmp_path: Path
) -> None:
    machine, path = machine_and_path("polisher", tmp_path)
    change(pd.read_csv(path)).to_csv(path, index=False)
    rows = load_path(machine, path)[1]
    said = []
    for compiled_from in (1, NUMPY):
        with pytest.raises(InputError) as caught:
            compensate(machine, rows, compiled_from=compiled_from)
        said.append(str(caught.value))
    assert said[0] == said[1]
    assert says in said[0]


def _with(frame: pd.DataFrame, row: int, cells: dict[str, float]) -> pd.DataFrame:
    for name, value in cells.items():
        frame.loc[row, name] = value
    return frame


def test_without_a_compiler_numpy_does_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, path = machine_and_path("arm", tmp_path)
    monkeypatch.setenv("TRUEPOSE_CC", "")
    found, by_numpy = both(machine, path)
    assert found.solved_by.startswith("numpy: ")
    np.testing.assert_array_equal(found.command, by_numpy.command)
    out = tmp_path / "commands.csv"
    result = CliRunner().invoke(
        app, ["compensate", str(tmp_path / "calibrated.yaml"), str(path), "-o", str(out)]
    )
    assert result.exit_code == 0, result.output
    assert "60 rows, solved by numpy" in result.stdout


@needs_compiler
def test_rows_that_the_c_leaves_are_solved_by_numpy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, path = machine_and_path("hexapod", tmp_path)
    whole = CompiledKinematics.ik

    def partial(self: CompiledKinematics, *arguments: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        q, solved = whole(self, *arguments)
        return np.where(np.arange(len(q))[:, None] % 3 == 0, 7.0, q), solved & (np.arange(len(q)) % 3 > 0)

    monkeypatch.setattr(CompiledKinematics, "ik", partial)
    found, by_numpy = both(machine, path)
    assert found.solved_by == "compiled C; 20 rows by numpy"
    assert_same(machine, found.command, by_numpy.command)


@needs_compiler
def test_long_paths_of_poses_lead_to_the_same_joints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, path = machine_and_path("polisher", tmp_path)
    rng = np.random.default_rng(9)
    poses = rng.uniform([-30, -30, 1670, -3, -3, -3], [30, 30, 1730, 3, 3, 3], (60, 6))
    pd.DataFrame(poses, columns=["x", "y", "z", "rx", "ry", "rz"]).to_csv(path, index=False)
    by_numpy = load_path(machine, path)[1].q
    monkeypatch.setattr(path_table, "COMPILED_FROM", 1)
    monkeypatch.setattr(path_table, "_MARKS", 7)
    assert_same(machine, load_path(machine, path)[1].q, by_numpy)
    poses[41, 2] = 9000.0
    pd.DataFrame(poses, columns=["x", "y", "z", "rx", "ry", "rz"]).to_csv(path, index=False)
    with pytest.raises(InputError, match=r"row 42: found a pose that the nominal machine cannot take"):
        load_path(machine, path)


# --- tables ----------------------------------------------------------------------------------------------------


@pytest.fixture
def _columns_always(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "LARGE", 0)
    monkeypatch.setattr(files, "MANY", 0)


@pytest.mark.usefixtures("_columns_always")
@pytest.mark.parametrize(
    "text",
    [
        "q1 [mm],note,q2\n1,a,2.50\n-1e-3,b c,+4\n",
        "\ufeff# comment\n\nq1,note,q2\r\n 1 ,,2\r\n3,x,4\r\n",
        'q1,note,q2\n1,"a, b",2\n',
        "q1,note,q2\n1,a,2\n# between\n3,b,4\n",
        "q1,note,q2\n\n1,a,2\n\n3,b,4\n",
    ],
)
def test_a_table_is_the_same_by_columns(text: str, tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    path.write_bytes(text.encode())
    one, other = read_path_table(path), read_table(path)
    assert (one.file, one.columns, one.n_rows) == (other.file, other.columns, other.n_rows)
    for name in ("q1", "q2"):
        np.testing.assert_array_equal(one.numbers(name), other.numbers(name))
    assert {name: list(one.cells[name]) for name in one.names} == dict(other.cells)


@pytest.mark.usefixtures("_columns_always")
@pytest.mark.parametrize(
    "text",
    [
        "q1,q2\n1,2\n3,high\n",
        "q1,q2\n1,2\n3,\n",
        "q1,q2\n1,2\n3,nan\n",
        "q1,q2\n1,2\n3,1_000\n",
        "q1,q2\n1,2\n3\n",
        "q1,q2\n1,2\n3,4,5\n",
        "q1,q1 [mm]\n1,2\n",
        "q1,q2\n",
        "",
        "q1,q2\n1,\udcff\n",
    ],
)
def test_what_is_wrong_with_a_table_is_said_the_same(text: str, tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    said = []
    for read in (read_path_table, read_table):
        with pytest.raises(InputError) as caught:
            read(path).numbers("q2")
        said.append(str(caught.value))
    assert said[0] == said[1]


@pytest.mark.usefixtures("_columns_always")
def test_parquet_is_the_same_by_columns(tmp_path: Path) -> None:
    data: dict[str, Any] = {"q1": [1.5, -2.0], "count": [3, 4], "note": ["a", "b"], "hot": [True, False]}
    path = tmp_path / "path.parquet"
    pd.DataFrame(data).to_parquet(path)
    one, other = read_path_table(path), read_table(path)
    for name in ("q1", "count"):
        np.testing.assert_array_equal(one.numbers(name), other.numbers(name))
    assert {name: list(one.cells[name]) for name in one.names} == dict(other.cells)
    with pytest.raises(InputError, match="expected a finite number"):
        one.numbers("hot")


@pytest.mark.usefixtures("_columns_always")
@pytest.mark.parametrize("note", [["a", "b c", ""], ["a, b", 'say "c"', "d"]])
def test_what_is_written_reads_back_exactly(note: list[str], tmp_path: Path) -> None:
    values = np.array([1 / 3, -1e-17, 6.02e23])
    path = tmp_path / "commands.csv"
    path.write_text(csv_text(pd.DataFrame({"q1 [mm]": values, "note": note})))
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers("q1"), values)
    assert list(table.cells["note"]) == note
    assert table.columns[0].unit == "mm"
