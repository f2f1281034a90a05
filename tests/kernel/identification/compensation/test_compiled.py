"""Long paths by the generated C: the same commands and the same refusals as by numpy. mm, rad."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from typer.testing import CliRunner

from support.calibrated_machines import calibrated, path_file
from support.examples import by_day
from support.generated_c import needs_compiler
from truepose.cli import app
from truepose.codegen.c import generate
from truepose.codegen.evaluation import compiled
from truepose.errors import InputError
from truepose.identification.compensation import compensate as compensation
from truepose.identification.compensation import path_table
from truepose.identification.compensation.compensate import Compensation, compensate
from truepose.identification.compensation.inverse import CompiledKinematics
from truepose.identification.compensation.path_table import load_path
from truepose.identification.prediction.predict import predictor_for
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.task import WHOLE

Array = npt.NDArray[np.float64]
KINDS = ("arm", "hexapod", "polisher")
NUMPY = 10**9
"""More rows than any path here has."""
ELBOW = (0.2, 0.3, 0.2, 0.1, 0.9, 0.3)
"""Joints of the arm around which it is nowhere near a singular pose."""


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
@pytest.mark.parametrize("kind", by_day(KINDS, "arm", "polisher"))
def test_the_c_gives_the_commands_that_numpy_gives(kind: str, tmp_path: Path) -> None:
    machine, path = machine_and_path(kind, tmp_path)
    by_c, by_numpy = both(machine, path)
    assert (by_c.solved_by, by_numpy.solved_by) == ("compiled C", "numpy")
    assert_same(machine, by_c.command, by_numpy.command)
    for name in ("target", "before", "after"):
        np.testing.assert_allclose(getattr(by_c, name), getattr(by_numpy, name), rtol=0, atol=2e-6)
    assert np.max(np.abs(by_c.command - by_c.nominal)) > 1e-4


@needs_compiler
@pytest.mark.parametrize("kind", by_day(KINDS, "arm", "polisher"))
def test_the_controllers_function_means_the_same(kind: str, tmp_path: Path) -> None:
    """NAME_compensate as ``truepose codegen`` writes it, row by row with the row's drivers."""
    machine, path = machine_and_path(kind, tmp_path, 12)
    rows = load_path(machine, path)[1]
    assert machine.file is not None
    out = tmp_path / "controller"
    generate(machine, out, nominal=machine.file.nominal)
    library = compiled.load({path.name: path.read_text() for path in out.glob(f"{machine.name}_kin.[hc]")})
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


@pytest.mark.nightly
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
    monkeypatch.setattr(path_table, "MARKS", 7)
    assert_same(machine, load_path(machine, path)[1].q, by_numpy)
    poses[41, 2] = 9000.0
    pd.DataFrame(poses, columns=["x", "y", "z", "rx", "ry", "rz"]).to_csv(path, index=False)
    with pytest.raises(InputError, match=r"row 42: found a pose that the nominal machine cannot take"):
        load_path(machine, path)


@needs_compiler
def test_drivers_at_the_machines_own_values_are_none(tmp_path: Path) -> None:
    """Digit for digit: rows without drivers go through vector units, and the same they do with these."""
    machine, path = machine_and_path("arm", tmp_path)
    q = load_path(machine, path)[1].q
    kinematics, own = CompiledKinematics(machine, WHOLE), symbolic_model(machine, machine.effects).z_home
    z = np.tile(own, (len(q), 1))
    poses, stands = kinematics.fk(q)
    assert stands.all()
    np.testing.assert_array_equal(kinematics.fk(q, z)[0], poses)
    z[7] += 2.0
    moved = np.any(kinematics.fk(q, z)[0] != poses, axis=(1, 2))
    assert moved[7]
    np.testing.assert_allclose(
        kinematics.fk(q, z)[0][~(np.arange(len(q)) == 7)], np.delete(poses, 7, axis=0), atol=1e-9
    )


@needs_compiler
@pytest.mark.parametrize("block", [1, 7, 60])
def test_how_a_path_is_cut_does_not_matter(
    block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, path = machine_and_path("hexapod", tmp_path)
    rows = load_path(machine, path)[1]
    whole = compensate(machine, rows, compiled_from=1)
    monkeypatch.setattr(compensation, "BLOCK", block)
    parts = compensate(machine, rows, compiled_from=1)
    assert_same(machine, parts.command, whole.command)
