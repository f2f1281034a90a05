"""Paths row by row: what the C commands, which row is refused, and however many rows go together. mm, rad."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.calibrated_machines import calibrated, path_file
from support.examples import by_day
from support.generated_c import needs_compiler
from truepose.codegen.c import generate
from truepose.codegen.evaluation import compiled
from truepose.errors import InputError
from truepose.identification.compensation import compensate as compensation
from truepose.identification.compensation.compensate import compensate
from truepose.identification.compensation.path_table import path_rows
from truepose.identification.prediction.predict import predictor_for
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import read_table, table_in_memory
from truepose.models.machine.machine import Machine

ELBOW = (0.2, 0.3, 0.2, 0.1, 0.9, 0.3)
"""Joints of the arm around which it is nowhere near a singular pose."""


def machine_and_path(kind: str, folder: Path, count: int) -> tuple[Machine, Recording]:
    """The arm carries from nothing to 10 kg along its path."""
    machine = calibrated(kind, folder)
    columns = {"payload": np.linspace(0.0, 10.0, count)} if kind == "arm" else {}
    frame, rng = pd.read_csv(path_file(machine, folder, count, **columns)), np.random.default_rng(3)
    for name, middle in zip(machine.mechanism.readings, ELBOW, strict=True) if kind == "arm" else ():
        frame[f"{name} [rad]"] = middle + rng.uniform(-0.3, 0.3, count)
    return machine, path_rows(machine, table_in_memory(frame, "path"))[1]


@needs_compiler
@pytest.mark.parametrize("kind", by_day(("arm", "hexapod", "polisher"), "arm", "polisher"))
def test_the_controllers_function_means_the_same(kind: str, tmp_path: Path) -> None:
    """NAME_compensate as ``truepose codegen`` writes it, row by row with the row's drivers.

    Both ways meet poses within 1e-9 of a machine's size (1.2 m at most) and 1e-9 rad; a joint may need some times that.
    """
    machine, rows = machine_and_path(kind, tmp_path, 12)
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
    slack = [3e-6 if actuator.unit == "mm" else 1e-8 for actuator in machine.mechanism.actuators]
    assert np.all(np.abs(commands - compensate(machine, rows).command) <= slack)


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        (
            {(7, "q1"): 640.0, (7, "q2"): 1150.0, (7, "q3"): 640.0},
            "row 8: the mechanism cannot be assembled there",
        ),
        ({(5, "q4"): 1.0471}, "row 6, column 'q4': found that the corrected command"),
    ],
)
def test_the_row_that_cannot_be_followed_is_named(
    cells: dict[tuple[int, str], float], says: str, tmp_path: Path
) -> None:
    machine = calibrated("polisher", tmp_path)
    table = read_table(path_file(machine, tmp_path, 12))
    columns = {name: table.numbers(name) for name in table.names}
    for (row, name), value in cells.items():
        columns[name][row] = value
    headers = {c.name: f"{c.name} [{c.unit}]" for c in table.columns}
    frame = pd.DataFrame({headers[name]: values for name, values in columns.items()})
    rows = path_rows(machine, table_in_memory(frame, "path"))[1]
    with pytest.raises(InputError, match=says):
        compensate(machine, rows)


@pytest.mark.parametrize("block", [1, 7])
def test_how_a_path_is_cut_does_not_matter(
    block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, rows = machine_and_path("hexapod", tmp_path, 20)
    whole = compensate(machine, rows)
    monkeypatch.setattr(compensation, "BLOCK", block)
    found = compensate(machine, rows)
    np.testing.assert_allclose(found.command, whole.command, rtol=0, atol=1e-8)
