"""The first screen of a calibration: the tool and the readings, how sure, rows that do not fit, what to do next."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.reports import fitted, of, recorded, rows, summary
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.summary import FitSummary
from truepose.shown.document import Command, Opening, Table
from truepose.identification.report.opening import calibration_opening
from truepose.identification.report.closing import calibration_origin
from truepose.models.file.machine_file import ExpectedPose
from truepose.models.machine.machine import Machine

CHECK = "truepose check arm.yaml a&b.csv"
APPLY = "truepose codegen calibrated.yaml -o controller"
FIND = "truepose diagnose arm.yaml a&b.csv -o diagnosis"


def calibrated(machine: Machine, away: float = 1.0, **method: str) -> Calibration:
    recording = recorded(machine)
    given = {"estimator": "map", "solver": "gn"} | method
    return Calibration(fitted(machine, recording, away=away), None, recording, (), given)


def opening(found: Calibration, told: FitSummary, **more: Any) -> Opening:
    given: dict[str, Any] = {"pose": None, "warnings": (), **more}
    return calibration_opening(found, told, given["pose"], given["warnings"])


def steps(found: Opening) -> list[str]:
    return [step.command for step in found.steps if isinstance(step, Command)]


def test_a_fit_that_nothing_speaks_against_is_applied_first(machine: Machine) -> None:
    found = calibrated(machine)
    assert steps(opening(found, summary(1.01, 1.2))) == [APPLY, FIND]
    for doubtful in (summary(1.31, 1.2), summary(1.01, 3.2)):
        assert steps(opening(found, doubtful)) == [FIND, APPLY]
    assert steps(opening(calibrated(machine, away=500.0), summary(1.01, 1.2))) == [CHECK]


def test_how_sure_is_told_with_the_directions_that_nothing_sees(machine: Machine) -> None:
    found = calibrated(machine)
    (sure,) = opening(found, summary(1.01, 1.2)).lists
    figures = "Misfit chi2/dof 1.01, farthest parameter q1.d at 1.20 tolerances (within the 3.10 that a true model allows)."
    free = len(found.fit.prior.free)
    assert sure.title == "How sure"
    assert list(sure.items) == [
        figures,
        f"Of {free} directions of the free constants the readings see {free - 1}; tolerances hold the others.",
    ]
    factor = np.triu(np.eye(free + 1))
    whole = replace(found, fit=replace(found.fit, factor=factor))
    (sure,) = opening(whole, summary(1.01, 1.2)).lists
    assert list(sure.items) == [figures]


@pytest.mark.parametrize("count", [1, 3, 4])
def test_three_rows_that_do_not_fit_are_told(machine: Machine, count: int) -> None:
    warnings = [f"row {k}" for k in range(count)]
    _, list_ = opening(calibrated(machine), summary(1.0, 1.0), warnings=warnings).lists
    assert (list_.title, list_.tone) == ("Rows that do not fit", "warn")
    assert list(list_.items) == warnings[:3]


@pytest.mark.parametrize(
    ("before", "after", "told", "shares"),
    [
        (0.5, 0.2, ("0.500 mm", "0.200 mm"), (1.0, 0.4, 0.0)),
        (0.2, 0.5, ("0.200 mm", "0.500 mm"), (0.4, 1.0, 0.0)),
        (0.08, 0.02, ("80.0 µm", "20.0 µm"), (1.0, 0.25, 0.0)),
        (0.0, 0.0, ("0 mm", "0 mm"), (0.0, 0.0, 0.0)),
    ],
)
def test_what_a_fit_is_worth_to_the_tool_stands_first(
    machine: Machine, before: float, after: float, told: tuple[str, str], shares: tuple[float, float, float]
) -> None:
    """Both in the unit of the larger one, bars as long as the figures."""
    pose = ExpectedPose("nominal", before, after, "20 rows held out")
    tool, readings = opening(calibrated(machine), summary(1.0, 1.0), pose=pose).gains
    assert (tool.kind, readings.kind) == ("the tool's position, rms", "position error, rms")
    assert (tool.before, tool.after) == told
    assert tool.shares == pytest.approx(shares)
    assert tool.where == "nominal and this calibration, on 20 rows held out, base and tool refitted"
    assert (readings.before, readings.after, readings.where) == (
        "",
        "13.0 µm",
        "on rows that were not fitted",
    )
    (alone,) = opening(calibrated(machine), summary(1.0, 1.0)).gains
    assert alone == readings


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ({}, ""),
        ({"estimator": "ols"}, " --estimator ols"),
        ({"solver": "lm"}, " --solver lm"),
        ({"estimator": "huber", "solver": "ipopt"}, " --estimator huber --solver ipopt"),
    ],
)
def test_the_command_has_the_options_that_are_not_the_usual_ones(
    machine: Machine, method: dict[str, str], options: str
) -> None:
    (table,) = of(calibration_origin(calibrated(machine, 1.0, **method)).blocks[:1], Table)
    told = dict(rows(table))
    assert told["command, or what does the same"] == f"truepose calibrate arm.yaml a&b.csv{options}"
