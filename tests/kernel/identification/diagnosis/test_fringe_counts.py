"""Miscounted fringes: whole half wavelengths told from other outliers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support.sensor_bench import STAGE, STAGE_HEAD, Bench
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.null_fits import fringes_by_row, miscounted_fringes
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.results import diagnosis_json

UM = 1e3
HALF = 1.56e-3 / 2
RIGID = (STAGE_HEAD + STAGE).replace("length: 1, angle: 0.05", "length: 0, angle: 0")
"""The stage without tolerances of its own: what is unknown is where the beam and the mirror are."""


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Bench]:
    return {name: Bench(tmp_path_factory.mktemp(name), name) for name in ("arm", "stage")}


def longer(column: str, rows: Mapping[int, float], unit: float) -> Callable[[pd.DataFrame], None]:
    """What makes the readings of some rows too long, mm; ``unit``: how many of the file's units are a mm."""

    def change(frame: pd.DataFrame) -> None:
        values = frame[column].to_numpy(dtype=float).copy()
        for row, mm in rows.items():
            values[row] += unit * mm
        frame[column] = values

    return change


def _without(bench: Bench, recording: Recording, rows: list[int]) -> tuple[Estimate, NDArray[np.bool_]]:
    far = np.zeros(len(recording), dtype=bool)
    far[rows] = True
    return estimate(bench.machine, recording, exclude=far), far


@pytest.mark.parametrize("counts", [{7: 1, 31: -2}, {11: 5, 13: -1, 65: 1}])
def test_whole_half_wavelengths_are_counted_with_their_sign(
    benches: Mapping[str, Bench], counts: dict[int, int]
) -> None:
    bench = benches["stage"]
    change = longer("dL", {row: k * HALF for row, k in counts.items()}, UM)
    recording = bench.recording(change=change)
    fit, far = _without(bench, recording, list(counts))
    assert miscounted_fringes(fit, recording, far) == counts
    numbers = [row + 1 for row in counts]
    assert fringes_by_row(fit, recording, numbers) == {row + 1: k for row, k in counts.items()}


@pytest.mark.parametrize("part", [0.3, 0.5, 0.8, 0.0, 2.4])
def test_other_outliers_are_no_fringes(benches: Mapping[str, Bench], part: float) -> None:
    bench = benches["stage"]
    recording = bench.recording(change=longer("dL", {9: part * HALF}, UM))
    assert miscounted_fringes(*_arguments(bench, recording, [9])) == {}


def _arguments(
    bench: Bench, recording: Recording, rows: list[int]
) -> tuple[Estimate, Recording, NDArray[np.bool_]]:
    fit, far = _without(bench, recording, rows)
    return fit, recording, far


def test_noise_as_large_as_a_fringe_names_none(tmp_path: Path) -> None:
    coarse = Bench(tmp_path, "stage", RIGID.replace("distance: 0.002", "distance: 0.1"))
    recording = coarse.recording(seed=None, change=longer("dL", {9: 2 * HALF}, UM))
    assert miscounted_fringes(*_arguments(coarse, recording, [9])) == {}


def test_sensors_without_light_have_no_fringes(benches: Mapping[str, Bench]) -> None:
    bench = benches["arm"]
    recording = bench.recording(change=longer("x", {9: HALF}, 1.0))
    assert miscounted_fringes(*_arguments(bench, recording, [9])) == {}


def test_a_diagnosis_tells_fringes_from_other_rows(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "stage", RIGID.replace("distance: 0.002", "distance: 0.01"))
    change = longer("dL", {11: HALF, 41: -3 * HALF, 21: 0.4 * HALF}, UM)
    found = diagnosis_json(diagnose(bench.machine, bench.recording(change=change)))
    assert found["verdict"] == "adequate"
    assert [(f["effect"], f["place"]) for f in found["findings"]] == [
        ("fringe-miscount", ["12", "42"]),
        ("outliers", ["22"]),
    ]
    assert "row 12: +1, row 42: -3" in found["findings"][0]["explanation"]
