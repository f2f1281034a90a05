"""A result stands for the machine that it found: it predicts as the file it writes, wherever a machine is taken."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import truepose
from support.examples import by_day
from support.results import BUNDLED, calibration, diagnosis, machine, recording
from support.round_trips import check_round_trip
from truepose.errors import InputError
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Fitted
from truepose.identification.recording.recording import Recording

FITTED: Mapping[str, Callable[[], Fitted]] = {
    **{
        name: cache(
            partial(lambda n: truepose.calibrate(machine(n), recording(n).subset(slice(0, 150))), name)
        )
        for name in BUNDLED
    },
    "estimate": lambda: calibration().fit,
    "free": lambda: diagnosis().free,
    "diagnosis": diagnosis,
    "after": lambda: diagnosis().after,
}
each = pytest.mark.parametrize("name", by_day(FITTED, "nanopositioner", "estimate", "diagnosis"))
SLOW = {"check", "diagnose"}


def rows_of(result: Any) -> Recording:
    """The recording of a result."""
    return result.recording  # type: ignore[no-any-return]


def saved(result: Fitted, folder: Path) -> Path:
    """Write a result by whatever way there is; the machine file."""
    if isinstance(result, Calibration | Diagnosis):
        result.save(folder)
        return folder / ("calibrated.yaml" if isinstance(result, Calibration) else "improved.yaml")
    truepose.write_calibrated(folder / "fit.yaml", result, rows_of(result))  # type: ignore[arg-type]
    return folder / "fit.yaml"


@each
def test_a_result_predicts_as_the_file_that_it_writes(name: str, tmp_path: Path) -> None:
    result = FITTED[name]()
    rows = rows_of(result).subset(slice(0, 200))
    again = truepose.load_machine(saved(result, tmp_path))
    expected = truepose.predict(again, rows)
    size = expected.abs().max().clip(lower=1e-6)
    for found in (
        result.predict(rows),
        truepose.predict(result, rows),
        truepose.predict(result.machine, rows),
    ):
        assert ((found - expected).abs().max() <= 1e-9 * size).all()
    check_round_trip(result, tmp_path)  # type: ignore[arg-type]
    file, read = result.machine.file, again.file
    assert file is not None and read is not None
    assert (file.covariance, file.nominal, file.pose_error, file.refused) == (
        read.covariance,
        read.nominal,
        read.pose_error,
        read.refused,
    )


def test_the_machine_of_a_fit_is_not_the_drawing() -> None:
    """Readings are met to their noise; the drawing is millimetres off."""
    fit = calibration().fit
    for given in (calibration(), fit, fit.machine):
        off = truepose.predict(given, recording()) - recording().to_frame().reset_index(drop=True)
        assert off[["P1.x", "P1.y", "P1.z"]].abs().max().max() < 0.1
    away = truepose.predict(fit.nominal, recording()) - recording().to_frame().reset_index(drop=True)
    assert away[["P1.x", "P1.y", "P1.z"]].abs().max().max() > 0.1


@each
def test_residuals_are_prediction_minus_reading(name: str) -> None:
    result = FITTED[name]()
    rows = rows_of(result)
    table, predicted, read = result.residuals, result.predict(rows), rows.to_frame()
    assert table.index.equals(read.index) and len(table) == len(rows)
    for column in table.columns.drop("fitted"):
        if column in predicted and column in read:
            expected = predicted[column].to_numpy() - read[column].to_numpy()
            np.testing.assert_allclose(table[column].to_numpy(), expected, rtol=1e-5, atol=1e-6)
    assert table["fitted"].sum() > 0


TAKE_MACHINES: Mapping[str, Callable[[Any], Any]] = {
    "calibrate": lambda m: truepose.calibrate(m, recording()),
    "check": lambda m: truepose.check(m, recording()),
    "compensate": lambda m: truepose.compensate(m, recording().subset([0, 1])),
    "diagnose": lambda m: truepose.diagnose(m, recording()),
    "drift": lambda m: truepose.drift(m, recording()),
    "estimate": lambda m: truepose.estimate(m, recording()),
    "identifiability": lambda m: truepose.identifiability(m, recording(), machines=1),
    "inverse": lambda m: truepose.inverse(m, np.eye(4)[None]),
    "load_recording": lambda m: truepose.load_recording(m, recording().to_frame().reset_index(drop=True)),
    "parse_effect": lambda m: truepose.parse_effect("backlash@rho1:b=1e-3", m),
    "plan": lambda m: truepose.plan(m, 20, method="random"),
    "predict": lambda m: truepose.predict(m, recording()),
    "simulate": lambda m: truepose.simulate(m, recording()),
}
"""Public functions that take a machine, but for those that write."""


def test_every_function_that_takes_a_machine_is_there() -> None:
    public = {name: getattr(truepose, name) for name in truepose.__all__}
    taking = {
        n for n, f in public.items() if inspect.isfunction(f) and "machine" in inspect.signature(f).parameters
    }
    assert taking == {*TAKE_MACHINES, "export", "generate"}


def outcome(function: str, given: object) -> tuple[str, object]:
    """Return what a function gives or says, in words and as numbers where it has any."""
    try:
        found = TAKE_MACHINES[function](given)
    except InputError as exc:
        return str(exc), None
    return str(found), found.to_numpy().tolist() if isinstance(found, pd.DataFrame) else None


@pytest.mark.parametrize("function", by_day(TAKE_MACHINES, *TAKE_MACHINES.keys() - SLOW))
def test_a_result_is_taken_in_a_machine_s_place(function: str) -> None:
    """What comes out is what the result's machine gives."""
    assert outcome(function, calibration()) == outcome(function, calibration().machine)


def test_a_fit_keeps_the_effects_of_the_machine_that_it_is_given() -> None:
    """What a diagnosis found is not let go where its result is fitted again, unless other effects are named."""
    found = diagnosis()
    again = truepose.estimate(found, recording())
    assert {effect.label for effect in again.effects} == {effect.label for effect in found.machine.effects}
    assert again.effects and not truepose.estimate(found, recording(), ()).effects


TAKE_ROWS: Mapping[str, Callable[[Any], Any]] = {
    "calibrate": lambda rows: truepose.calibrate(machine(), rows),
    "check": lambda rows: truepose.check(machine(), rows),
    "compensate": lambda rows: truepose.compensate(calibration(), rows),
    "drift": lambda rows: truepose.drift(machine(), rows),
    "estimate": lambda rows: truepose.estimate(machine(), rows),
    "identifiability": lambda rows: truepose.identifiability(machine(), rows, machines=1),
    "predict": lambda rows: truepose.predict(calibration(), rows),
    "simulate": lambda rows: truepose.simulate(calibration(), rows),
}
"""Public functions of rows; ``diagnose`` reads them as ``estimate`` does."""


@pytest.mark.parametrize("function", by_day(TAKE_ROWS, *TAKE_ROWS.keys() - SLOW))
def test_a_table_is_taken_in_a_recording_s_place(function: str) -> None:
    """A DataFrame and a dict of columns are the recording that ``load_recording`` makes of them."""
    frame = recording().to_frame().reset_index(drop=True)

    def given(rows: object) -> str:
        try:
            return str(TAKE_ROWS[function](rows))
        except InputError as exc:
            return str(exc)

    expected = given(truepose.load_recording(machine(), frame))
    assert given(frame) == expected
    assert given(frame.to_dict("list")).replace("dict", "DataFrame") == expected


def test_what_a_result_writes_is_what_its_file_writes(tmp_path: Path) -> None:
    again = truepose.load_machine(saved(diagnosis(), tmp_path))
    for folder, given in (("result", diagnosis()), ("file", again)):
        truepose.generate(given, tmp_path / folder)
    for path in (tmp_path / "file").rglob("*"):
        if path.is_file():
            assert (
                path.read_bytes() == (tmp_path / "result" / path.relative_to(tmp_path / "file")).read_bytes()
            )
    with pytest.raises(InputError, match="found loops"):
        truepose.export(diagnosis(), tmp_path / "arm.urdf")


@pytest.mark.parametrize("function", TAKE_MACHINES)
@pytest.mark.parametrize("given", [None, 3, "machine.yaml", Path("machine.yaml"), {}])
def test_what_is_no_machine_is_refused_by_name(function: str, given: object) -> None:
    expected = f"machine: found {type(given).__name__}, expected a machine or a result of calibrate"
    with pytest.raises(InputError, match=expected):
        TAKE_MACHINES[function](given)


def test_write_calibrated_names_the_estimate_that_it_takes(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"^estimate: found Calibration, expected an Estimate, such as calibration.fit"
    ):
        truepose.write_calibrated(tmp_path / "m.yaml", calibration(), recording())  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_results_in_json_name_what_they_take() -> None:
    with pytest.raises(InputError, match=r"^estimate: found Calibration, expected an Estimate"):
        truepose.fit_json(calibration(), recording())  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^diagnosis: found Calibration, expected a Diagnosis"):
        truepose.diagnosis_json(calibration())  # type: ignore[arg-type]


def test_a_single_column_is_no_recording() -> None:
    with pytest.raises(InputError, match=r"^Series: found one column without a name, expected a table"):
        truepose.predict(calibration(), recording().to_frame()["P1.x"])
