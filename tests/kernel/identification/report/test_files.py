"""Results written down: which files, what stands in them beside the result, and what has no report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from support.reports import fitted, own_markup, recorded, synthetic
from truepose.identification.diagnosis.result import Applied, PoseError
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.load import Caution
from truepose.identification.report.files import (
    put_both,
    write_calibration,
    write_diagnosis,
)
from truepose.identification.report.results import calibration_json
from truepose.models.file.sections import ExpectedPose
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.shown.result import Written

SENTENCE = "SUSPECT: sign: q2 counts backwards; turn its sign"
DOUBT = Caution("suspect", (SENTENCE,), {"check": {"found": [{"kind": "sign", "where": ["q2"]}]}})
CALM = Caution()


def document(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text("utf-8")))


def cautious(page: Path) -> bool:
    """Whether the doubt stands in the page."""
    return "q2 counts backwards" in own_markup(page.read_text("utf-8"))


def calibrated(machine: Machine) -> Calibration:
    recording = recorded(machine)
    return Calibration(fitted(machine, recording), None, recording, (), {"estimator": "map", "solver": "gn"})


def test_a_calibration_is_three_files(machine: Machine, tmp_path: Path) -> None:
    found = calibrated(machine)
    rows = [{"file": "a&b.csv", "row": 17, "sigma": 31.0}]
    told = {**calibration_json(found, ()), "rows_that_do_not_fit": rows}
    pose = ExpectedPose(than="plain calibration", before=0.5, after=0.25, rows="the validation rows")
    vars(found)["pose"] = pose  # as if it had been judged so
    names = write_calibration(found, told, tmp_path / "out", ["SUSPECT: q2 counts backwards"])
    assert names == ["calibrated.yaml", "fit.json", "report.html"]
    assert document(tmp_path / "out" / "fit.json")["rows_that_do_not_fit"] == rows
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "rows 17" in own_markup(page) or "row 17" in own_markup(page)
    assert cautious(tmp_path / "out" / "report.html")
    again = load_machine(tmp_path / "out" / "calibrated.yaml")
    assert again.file is not None and again.file.pose_error == pose
    first = found.fit.prior.names[found.fit.prior.free[0]]
    values = {p.name: p.nominal for p in again.parameters}
    assert values[first] == pytest.approx(found.fit.p[found.fit.prior.free[0]], rel=1e-9)


def test_a_diagnosis_is_three_files_with_its_doubts(machine: Machine, tmp_path: Path) -> None:
    applied = Applied("whole", "role", PoseError(0.5, 0.2), 0.4, PoseError(0.5, 0.2), 0.4)
    found = replace(synthetic(machine), applied=applied)
    for name, check in (("bare", None), ("both", DOUBT), ("calm", CALM)):
        names = write_diagnosis(found, tmp_path / name, check)
        assert names == ["diagnosis.json", "improved.yaml", "report.html"]
        told = document(tmp_path / name / "diagnosis.json")
        assert told["verdict"] == "missing-physics" and ("check" in told) is (name == "both")
        assert cautious(tmp_path / name / "report.html") is (name == "both")
    file = load_machine(tmp_path / "bare" / "improved.yaml").file
    assert file is not None
    assert file.pose_error == ExpectedPose(
        than="plain calibration", before=0.5, after=0.2, rows="the validation rows"
    )


@pytest.mark.parametrize("brief", [False, True])
def test_both_together_have_one_report(machine: Machine, tmp_path: Path, brief: bool) -> None:
    """The diagnosis's, whose doubts are those of the files; none where it is to be brief."""
    put_both(calibrated(machine), synthetic(machine), DOUBT, tmp_path, brief=brief)
    names = sorted(file.name for file in tmp_path.iterdir())
    both = ["calibrated.yaml", "diagnosis.json", "fit.json", "improved.yaml"]
    assert names == (both if brief else [*both, "report.html"])
    assert all("check" in document(tmp_path / name) for name in ("fit.json", "diagnosis.json"))
    if not brief:
        assert cautious(tmp_path / "report.html")


@pytest.mark.parametrize("other", [None, 3.0, "text"])
def test_what_is_no_result_has_no_report(other: object, tmp_path: Path) -> None:
    name = type(other).__name__
    with pytest.raises(TypeError, match=f"found a {name}, expected a result"):
        Written.report(cast(Any, other), tmp_path / "page.html")
    with pytest.raises(TypeError, match=f"found a {name}, expected a result with files"):
        Written.save(cast(Any, other), tmp_path / "out")
    assert not list(tmp_path.iterdir())
