"""What is left is told in numbers where check has nothing more to say: rows that stand out, else columns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.reports import arm, synthetic
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.report.verdict import left_words

OUT = Path("out")


def leaving(found: Diagnosis, far: list[int], column: int, size: float) -> Diagnosis:
    """The diagnosis, of unknown cause, with residuals of a sigma but for some rows of a column."""
    residual = np.random.default_rng(2).choice([-1.0, 1.0], found.after.residual.shape)
    residual[far, column] = size
    return replace(found, verdict="unknown", findings=(), after=replace(found.after, residual=residual))


@pytest.mark.parametrize("far", [[3], [2, 5], [1, 2, 3]])
@pytest.mark.parametrize("column", [0, 2])
def test_rows_that_stand_out_are_told_with_their_column(far: list[int], column: int, tmp_path: Path) -> None:
    found = leaving(synthetic(arm(tmp_path)), far, column, 300.0)
    said = left_words(found)
    fitted = int(np.sum(~found.recording.validation))
    rows = ", ".join(str(found.recording.source_row[k]) for k in far)
    assert said.startswith(f"row{'s' * (len(far) > 1)} {rows} ({len(far)} of {fitted}): ")
    assert found.nominal.channels[column].name in said


def test_columns_are_told_where_no_row_stands_out(tmp_path: Path) -> None:
    found = synthetic(arm(tmp_path))
    found = leaving(found, list(range(len(found.recording))), 1, 6.0)
    assert left_words(found).startswith(f"{found.nominal.channels[1].name} is off by ")
    assert "(6 sigma)" in left_words(found)
