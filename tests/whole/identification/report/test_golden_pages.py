"""Pages, JSON and views that are committed: a change of what is shown shows as a change of ``tests/golden_pages``.

What is shown is made up, or comes from fits that end in one point: another processor rounds it alike to the digits
that are shown. After a change that is meant:

    pytest tests/whole/identification/report/test_golden_pages.py --update-golden

writes the pages anew; what then differs is for the reviewer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from support import TESTS
from support.golden_pages import as_committed, lines, shown
from support.reports import (
    arm,
    calibration_html,
    fitted,
    gear,
    gear_finding,
    recorded,
    report_html,
    synthetic,
)
from support.results import RESULTS, drifting
from support.told_drift import drift_html
from support.told_fleet import fleet, fleet_html
from truepose.identification.diagnosis.null_fits import FarRow
from truepose.identification.diagnosis.result import (
    Alternative,
    Applied,
    Form,
    Lead,
    Levels,
    PoseError,
    Remainder,
    Together,
)
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.report.json_text import json_text
from truepose.identification.report.results import diagnosis_json, fit_json
from truepose.identification.signatures.untestable import Missing
from truepose.models.machine.machine import Machine
from truepose.version import VERSION

GOLDEN = TESTS / "golden_pages"
ELSEWHERE = ("diagnosis", "finding", "machine with effects", "compensation", "inverse")
"""Results of chains, whose goldens are diagnoses; and what is left of a solved pose, which is rounding."""


def _diagnosis(folder: Path) -> str:
    return report_html(synthetic(arm(folder)))


def _calibration(folder: Path) -> str:
    machine = arm(folder)
    recording = recorded(machine)
    method = {"estimator": "map", "solver": "gn"}
    found = Calibration(
        fitted(machine, recording), fitted(machine, recording, away=50.0), recording, (), method
    )
    return calibration_html(found)


def _diagnosis_json(folder: Path) -> str:
    """All that a diagnosis may hold, and one that has nothing of it."""
    own = replace(gear_finding(), family="transmission-error", levels=Levels(0.99, "position-periodic", 0.98))
    untested = Alternative("backlash", ("q1", "q2"), 0.25, 3.0, tested=False)
    bare = replace(
        own, effect="empirical", flip_lambda=None, replication=None, equivalents=(untested,), family=""
    )
    lead = Lead("backlash", ("q2",), Levels(0.6, "load", 0.4), 0.3)
    found = synthetic(
        arm(folder),
        findings=(own, bare),
        leading=(lead, replace(lead, effect="empirical")),
        together=(Together("load", ("q1", "q2"), 0.98),),
        applied=Applied("names", "role", PoseError(0.5, 0.2), 0.4, None, 0.9),
        missing=(Missing(("thermal-expansion",), "no column", "add it"),),
        remainder=Remainder(("q2",), "q2", Form("curve"), 2.1, {"position": 0.004}),
    )
    hollow = replace(
        found, findings=(), remainder=None, proof=None, applied=None, missing=(), outlier_rows=()
    )
    return json_text(diagnosis_json(found)) + json_text(diagnosis_json(hollow))


def _fit_json(folder: Path) -> str:
    machine = arm(folder)
    recording = recorded(machine)
    fit = replace(fitted(machine, recording, (gear(machine),)), unassembled=(2,))
    free, far = fitted(machine, recording, away=500.0), [FarRow("day/r.csv", 12, 30.0)]
    whole = fit_json(fit, recording, free, notes=("a note",), method={"estimator": "map"}, far=far)
    return json_text(whole) + json_text(fit_json(free, recording))


def _view(name: str, _folder: Path) -> str:
    result = RESULTS[name]()
    if isinstance(result, Machine) and result.file:  # whose path may be too long for a line elsewhere
        result = replace(result, file=replace(result.file, path=Path("machine.yaml")))
    return repr(result)


PAGES: Mapping[str, Callable[[Path], str]] = {
    "page of a diagnosis": _diagnosis,
    "page of a calibration": _calibration,
    "page of a drift": lambda _folder: drift_html(drifting(0.2)),
    "JSON of a diagnosis": _diagnosis_json,
    "JSON of a fit": _fit_json,
    "page of a fleet": lambda _folder: fleet_html(fleet()),
    **{f"view of {name}": partial(_view, name) for name in RESULTS if name not in ELSEWHERE},
}


@pytest.mark.parametrize("name", PAGES)
def test_what_is_shown_is_as_committed(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    page = PAGES[name](tmp_path).replace(str(tmp_path), "FOLDER").replace(VERSION, "VERSION")
    new = lines(page) if name.startswith("JSON") else shown(page)
    file = GOLDEN / f"{name.replace(' ', '_')}.txt"
    as_committed(file, new, update=bool(request.config.getoption("--update-golden")))


def test_no_golden_is_left_over() -> None:
    assert {file.stem for file in GOLDEN.glob("*.txt")} == {name.replace(" ", "_") for name in PAGES}
