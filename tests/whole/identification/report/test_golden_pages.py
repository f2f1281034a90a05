"""Pages and views that are committed: a change of what is shown shows as a change of ``tests/golden_pages``.

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
from support.golden_pages import as_committed, shown
from support.reports import arm, calibration_html, fitted, recorded, report_html, synthetic
from support.results import RESULTS, drifting
from support.told_drift import drift_html
from support.told_fleet import fleet, fleet_html
from truepose.identification.fit.calibrate import Calibration
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


def _view(name: str, _folder: Path) -> str:
    result = RESULTS[name]()
    if isinstance(result, Machine) and result.file:  # whose path may be too long for a line elsewhere
        result = replace(result, file=replace(result.file, path=Path("machine.yaml")))
    return repr(result)


PAGES: Mapping[str, Callable[[Path], str]] = {
    "page of a diagnosis": _diagnosis,
    "page of a calibration": _calibration,
    "page of a drift": lambda _folder: drift_html(drifting(0.2)),
    "page of a fleet": lambda _folder: fleet_html(fleet()),
    **{f"view of {name}": partial(_view, name) for name in RESULTS if name not in ELSEWHERE},
}


@pytest.mark.parametrize("name", PAGES)
def test_what_is_shown_is_as_committed(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    page = PAGES[name](tmp_path).replace(str(tmp_path), "FOLDER").replace(VERSION, "VERSION")
    new = shown(page)
    file = GOLDEN / f"{name.replace(' ', '_')}.txt"
    as_committed(file, new, update=bool(request.config.getoption("--update-golden")))


def test_no_golden_is_left_over() -> None:
    assert {file.stem for file in GOLDEN.glob("*.txt")} == {name.replace(" ", "_") for name in PAGES}
