"""Long series on an arm of the study: rows that they concealed are found, and the search goes on without them.

The waves are sines, as the series that is fitted: this proves nothing of the law of gears.
"""

from __future__ import annotations

from pathlib import Path

import lines_study as study
import numpy as np
import pandas as pd
import pytest

import truepose
from truepose.identification.diagnosis.search import Expansion, Start

ROWS, ORDERS, WILD, OFF = 260, 60, (17, 160, 200), 0.25
"""Rows, orders of two gears, rows that are off, and by how much (mm): as far as the gears move the tool."""


def test_a_search_goes_on_without_the_rows_that_gears_concealed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study.write(tmp_path, 0)
    rng = np.random.default_rng(5)
    low, high = np.radians(study.RANGES).T
    q = rng.uniform(low, high, (ROWS, 6))
    turned = q + rng.normal(0.0, 5e-4, 6)
    for joint in (1, 2):
        waves = np.outer(q[:, joint], np.arange(1, ORDERS + 1))
        a, b = rng.normal(0.0, 3e-5, (2, ORDERS))
        turned[:, joint] += np.cos(waves) @ a + np.sin(waves) @ b
    seen = np.array([study.point(row) for row in turned]) + rng.normal(0.0, study.SIGMA, (ROWS, 3))
    seen[list(WILD), 0] += OFF
    columns = {f"q{k + 1}": np.degrees(q[:, k]) for k in range(6)}
    pd.DataFrame(columns | dict(zip("xyz", seen.T, strict=True))).to_csv(tmp_path / "arm.csv", index=False)
    begun = list[Start]()

    def expanded(start: Start) -> Expansion:
        begun.append(start)
        return Expansion(start)

    monkeypatch.setattr("truepose.identification.diagnosis.search.Expansion", expanded)
    found = truepose.diagnose(truepose.load_machine(tmp_path / "arm.yaml"), tmp_path / "arm.csv")
    again = next(start for start in begun if start.exclude.any())
    assert again.known is not None  # the search goes on from where it ended with all rows
    assert np.flatnonzero(again.exclude).tolist() == list(WILD)
    assert found.outlier_rows == tuple(k + 1 for k in WILD)
    named = {f.effect: f.place for f in found.findings}
    assert {f.place for f in found.findings} == {("q2",), ("q3",)} and set(named) == {"transmission-error"}
    (before, after) = (found.fits[stage].rms["position"] for stage in ("before", "after"))
    assert after < np.sqrt(3.0) * study.SIGMA < before / 5.0  # of three axes; the model takes part of it
