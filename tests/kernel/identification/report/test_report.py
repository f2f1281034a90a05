"""Reports: one page that loads nothing, and what it says of a diagnosis, of its truth and of a calibration."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pandas as pd
import pytest

from support.reports import (
    NAN,
    calibration_html,
    fitted,
    gear_finding,
    own_markup,
    page_data,
    recorded,
    report_html,
    synthetic,
)
from truepose.identification.diagnosis.result import Alarm, Diagnosis, Form, Proof, Quantity, Remainder
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.summary import FitSummary
from truepose.identification.report.results import diagnosis_json
from truepose.models.machine.machine import Machine

SECTIONS = (
    "verdict",
    "fit",
    "residuals",
    "constants",
    "uncertainty",
    "weighing",
    "limits",
    "origin",
    "truth",
)


@pytest.fixture(scope="module")
def diagnosis(machine: Machine) -> Diagnosis:
    return synthetic(machine)


@pytest.fixture(scope="module")
def page(diagnosis: Diagnosis) -> str:
    return report_html(diagnosis)


def test_sections_stand_in_order(page: str) -> None:
    found = re.findall(r'<section id="([^"]+)"', own_markup(page))
    assert found == list(SECTIONS[:-1])


def test_unknown_verdict_tells_the_remainder(machine: Machine) -> None:
    left = Remainder(("q2",), "q2", Form("curve"), 2.1)
    plain = synthetic(machine)
    page = own_markup(
        report_html(
            replace(
                plain,
                verdict="unknown",
                findings=(),
                terms=(),
                after=plain.before,
                proof=None,
                remainder=left,
            )
        )
    )
    assert "lacks something whose place and driver are not known" in page
    assert "seems to follow q2" in page
    assert "q2 errs as a smooth curve in q2; hypothesised" in page
    assert "nothing to prove" in page


def test_adequate_verdict(machine: Machine) -> None:
    plain = synthetic(machine)
    page = own_markup(
        report_html(
            replace(
                plain,
                verdict="adequate",
                concealed=False,
                findings=(),
                terms=(),
                after=plain.before,
                proof=None,
            )
        )
    )
    assert "The model of arm is adequate" in page
    assert "Concealed" not in page


def test_an_alarm_that_is_raised_under_an_adequate_verdict_is_explained(machine: Machine) -> None:
    plain = synthetic(machine)
    calm = replace(
        plain, verdict="adequate", concealed=False, findings=(), terms=(), after=plain.before, proof=None
    )
    page = own_markup(report_html(calm))
    assert "raised, but no explanation is likelier than none" in page
    assert not re.search(r"<td>raised</td>", page)
    found = own_markup(report_html(plain))
    assert "raised" in found and "no explanation is likelier" not in found


def test_the_constants_are_copied_with_all_digits(page: str, diagnosis: Diagnosis) -> None:
    copied = re.search(r'data-csv="([^"]*)"', page)
    assert copied is not None
    table, whole = pd.read_csv(io.StringIO(unescape(copied[1]))), diagnosis.after.to_frame()
    assert table["parameter"].tolist() == whole["parameter"].tolist()
    assert table["unit"].astype(str).tolist() == whole["unit"].tolist()
    for name in ("value", "std", "nominal", "tolerance"):
        np.testing.assert_array_equal(table[name].to_numpy(float), whole[name].to_numpy(float))


def test_doubts_are_said(machine: Machine) -> None:
    weak = replace(gear_finding(), parameters={"a": Quantity(1e-5, 1e-4, "rad")})
    proof = Proof("blocks", (), 0.98, (0.9, 1.05), 8.0, 0.95, False)
    said = own_markup(report_html(synthetic(machine, proof=proof, findings=(weak,))))
    for doubt in (
        "twice its own uncertainty",
        "no certain gain",
        "placebo",
        "black box does as well",
        "not recognised",
    ):
        assert doubt in " ".join(said.split())


def test_sets_and_what_each_effect_is_worth_are_in_tables(page: str) -> None:
    said = " ".join(own_markup(page).split())
    assert "transmission-error at q1; empirical at q2" in said and "no effect" in said
    assert said.index("transmission-error at q1; empirical at q2") < said.index(
        "no effect", said.index("transmission-error at q1; empirical at q2")
    )
    assert "with this very law, in all sets together" in said


def test_the_document_has_sets_and_inclusion_families_and_halves(machine: Machine) -> None:
    """Keys of diagnosis.json, with what has no name called empirical."""
    one = replace(gear_finding(), family="transmission-error")
    left = Remainder(("q2",), "q2", Form("curve"), 2.1, {"position": 0.004})
    found = diagnosis_json(synthetic(machine, findings=(one,), remainder=left))
    assert found["sets"] == [
        {"effects": [["transmission-error", ["q1"]]], "probability": 0.6},
        {"effects": [["transmission-error", ["q1"]], ["empirical", ["q2"]]], "probability": 0.3},
        {"effects": [], "probability": 0.01},
    ]
    assert found["inclusion"] == [
        {"effect": "transmission-error", "place": ["q1"], "probability": 0.93},
        {"effect": "empirical", "place": ["q2"], "probability": 0.3},
    ]
    first, *rows = found["findings"]
    assert first["family"] == "transmission-error"
    assert first["replication"] == {"halves": [0.97, 0.9], "agree": True}
    assert [f["family"] for f in rows] == [f["replication"] for f in rows] == [None]
    assert found["remainder"]["gain"] == {"position": {"value": 0.004, "unit": "mm"}}
    assert (found["disagreement"], found["noise"]) == (0.01, 1.0)
    plain = replace(gear_finding(), replication=None)
    bare = diagnosis_json(synthetic(machine, findings=(plain,), remainder=replace(left, gain={})))
    assert bare["findings"][0]["family"] is bare["findings"][0]["replication"] is None
    assert bare["remainder"]["gain"] is None


def test_a_gain_of_the_remainder_is_told(machine: Machine) -> None:
    left = Remainder(("q2",), "q2", Form("curve"), 2.1, {"position": 0.004})
    page = " ".join(own_markup(report_html(synthetic(machine, remainder=left))).split())
    assert "modelling it lowers the rms of held-out rows by 4.00 µm (position) more" in page


def test_truth_page_only_with_truth(diagnosis: Diagnosis) -> None:
    truth = {
        "effect": {"effect": "transmission-error", "place": ["q1"]},
    }
    assert '<section id="truth"' not in report_html(diagnosis)
    page = own_markup(report_html(diagnosis, truth))
    assert re.findall(r'<section id="([^"]+)"', page) == list(SECTIONS)
    assert "all of it was found" in page
    assert "not found under that name" in report_html(
        diagnosis, {"effect": {"effect": "backlash", "place": ["q2"]}}
    )
    assert '<section id="truth"' in report_html(diagnosis, {})


@pytest.mark.parametrize("with_free", [True, False])
def test_calibration_report(machine: Machine, with_free: bool) -> None:
    recording = recorded(machine)
    fit = fitted(machine, recording)
    free = fitted(machine, recording, away=50.0) if with_free else None
    method = {"estimator": "map", "solver": "gn"}
    page = own_markup(calibration_html(Calibration(fit, free, recording, ("a note",), method)))
    parts = ["fit", "residuals", "constants", "uncertainty", "limits", "origin"]
    assert re.findall(r'<section id="([^"]+)"', page) == parts
    assert "truepose calibrate arm.yaml" in page and "a note" in page
    assert "arm is calibrated" in page
    assert ("ordinary fit" in page) is with_free
    assert "What the data cannot tell" in page


def test_page_loads_nothing(page: str) -> None:
    assert not re.search(r"<script[^>]*\ssrc\s*=", page)
    assert not re.search(r"<link\b|<img\b|<iframe\b|@import|url\(", page)
    assert not re.search(r"https?://", page)
    assert page.count('<svg class="chart"') > 12


def test_same_bytes_each_time(page: str, machine: Machine) -> None:
    assert page == report_html(synthetic(machine))


def test_text_from_users_is_escaped(machine: Machine) -> None:
    name = "arm<script>alert(1)</script>"
    bad = "leg</script><b>"
    noted = replace(recorded(machine), notes=(bad,))
    page = own_markup(report_html(synthetic(replace(machine, name=name), recording=noted)))
    assert "alert(1)</script>" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert bad not in page


def test_missing_numbers_do_not_break_the_page(machine: Machine) -> None:
    plain = synthetic(machine)
    hollow = FitSummary({"position": NAN}, NAN, None, NAN, "q1.d", float("inf"))
    broken = replace(plain.after, residual=np.full_like(plain.after.residual, NAN))
    page = report_html(
        replace(
            plain,
            fits={"free": hollow, "before": hollow, "after": hollow},
            after=broken,
            proof=Proof("role", (), NAN, (NAN, NAN), None, None, None),
            evidence_map={},
            candidates=(),
            alarms={"residual": Alarm(NAN, NAN)},
            findings=(
                replace(gear_finding(), flip_lambda=None, probability=NAN, equivalents=(), parameters={}),
            ),
        )
    )
    assert not re.search(r"\bnan\b", own_markup(page), re.IGNORECASE)
    assert page_data(page)["rows"]


def test_large_recordings_are_thinned(machine: Machine) -> None:
    plain = synthetic(machine)
    recording = recorded(machine, 5000)
    bare, full = fitted(machine, recording), fitted(machine, recording, plain.terms)
    large = replace(plain, recording=recording, free=bare, before=bare, after=full)
    whole = report_html(large)
    page = own_markup(whole)
    drawn = page_data(whole)["rows"]
    assert f"Of 5,000 rows {len(drawn):,} are drawn" in page
    assert 500 < len(drawn) < 5_000
    assert len(whole) < 1_500_000
