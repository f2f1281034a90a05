"""What is said of corrected commands: the farthest row counts, lengths and angles apart, before and after."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.identification.compensation.compensate import Compensation
from truepose.identification.report.compensation_words import compensation_json, compensation_lines

Array = NDArray[np.float64]
BEFORE = np.array([[0.3, 0.0, 0.4, 0.03, 0.0, 0.0], [0.0, 0.0, 0.1, 0.03, 0.0, -0.04]])
AFTER = np.array([[0.0, 0.0, 0.0, 2e-6, 0.0, 0.0], [0.0, -2e-5, 0.0, 0.0, 0.0, 0.0]])


def corrected(before: Array = BEFORE, after: Array = AFTER) -> Compensation:
    nominal = np.array([[1.0, -2.0], [3.0, 4.0]])
    command = nominal + np.array([[0.1, 0.0], [-0.25, 0.05]])
    target = np.broadcast_to(np.eye(4), (2, 4, 4))
    return Compensation(("q1", "q2"), nominal, command, target, before, after, "C")


def test_the_farthest_row_is_told_with_its_length_and_its_angle() -> None:
    """Of several axes their length together: 0.3 and 0.4 mm make 0.5 mm."""
    assert compensation_lines(corrected(), Path("path.csv")) == [
        "path.csv: 2 rows, solved by C",
        "  largest pose error, as the calibrated model has it: 0.5 mm, 2.865 deg with the path's commands,"
        " 2e-05 mm, 0.0001146 deg with these",
    ]
    backwards = corrected(BEFORE[::-1], AFTER[::-1])
    assert compensation_lines(backwards, Path("path.csv")) == compensation_lines(
        corrected(), Path("path.csv")
    )


def test_the_same_as_data_in_mm_and_rad() -> None:
    document = compensation_json(corrected())
    assert document["rows"] == 2
    errors = document["largest_error"]
    assert errors == {
        "before": {
            "position": {"value": pytest.approx(0.5), "unit": "mm"},
            "rotation": {"value": pytest.approx(0.05), "unit": "rad"},
        },
        "after": {
            "position": {"value": pytest.approx(2e-5), "unit": "mm"},
            "rotation": {"value": pytest.approx(2e-6), "unit": "rad"},
        },
    }
    assert document["largest_correction"] == {"q1": pytest.approx(0.25), "q2": pytest.approx(0.05)}
