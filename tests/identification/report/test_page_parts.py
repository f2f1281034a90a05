"""A report's page around its parts: headline and facts, what is refused, cautions, notes, small type and safe scripts."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import replace
from html import unescape
from typing import Any

import pytest

from support.reports import calibration_html, fitted, own_markup, page_data, recorded, report_html, summary
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.models.machine.machine import Machine
from truepose.shown.document import Document, Section, Text
from truepose.shown.html import page as html


def said(page: str) -> str:
    """All that the page says, without markup."""
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", own_markup(page))).split())


def headline(page: str) -> str:
    found = re.search(r"<h1[^>]*>(.*?)</h1>", own_markup(page), re.DOTALL)
    assert found is not None
    return " ".join(unescape(found[1]).split())


def calibrated(machine: Machine, away: float = 1.0, notes: tuple[str, ...] = ()) -> Calibration:
    recording = recorded(machine)
    method = {"estimator": "map", "solver": "gn"}
    return Calibration(fitted(machine, recording, away=away), None, recording, notes, method)


@pytest.mark.parametrize(
    ("verdict", "fact"),
    [
        ("missing-physics", "verdict physics is missing"),
        ("unknown", "verdict something is missing"),
        ("adequate", "verdict adequate"),
    ],
)
def test_facts_stand_under_the_headline(plain: Diagnosis, verdict: str, fact: str) -> None:
    quiet = replace(
        plain, verdict=verdict, findings=(), recording=replace(plain.recording, files=("/far/a.csv", "b.csv"))
    )
    text = said(report_html(quiet))
    for one in (fact, "machine arm", "recording a.csv, b.csv", "rows 25 fitted, 5 for validation, of 30"):
        assert one in text


def test_what_is_no_calibration_is_refused_first(machine: Machine, plain: Diagnosis) -> None:
    far = fitted(machine, plain.recording, away=500.0)
    refused = replace(plain, verdict="adequate", findings=(), terms=(), before=far, after=far)
    assert headline(report_html(refused)).startswith("NOT CALIBRATED: ")
    assert '<h1 class="warn">' in report_html(refused)
    assert not headline(report_html(plain)).startswith("NOT")
    first = headline(calibration_html(calibrated(machine, away=500.0)))
    assert first.startswith("NOT CALIBRATED: ") and first.endswith(".")
    assert headline(calibration_html(calibrated(machine))).startswith(
        "arm is calibrated: nothing speaks against the fit"
    )


def test_cautions_warnings_and_notes_are_told_where_there_are_any(machine: Machine, plain: Diagnosis) -> None:
    caution, note = "a caution of its own", "a note of the fit"
    assert caution in said(report_html(plain, cautions=[caution])) and caution not in said(report_html(plain))
    whole = said(calibration_html(calibrated(machine, notes=(note,)), [caution]))
    assert caution in whole and note in whole
    bare = said(calibration_html(calibrated(machine)))
    assert not [one for one in (caution, note) if one in bare]


def test_a_calibration_that_something_speaks_against_is_no_good_news(machine: Machine) -> None:
    for away, tone in ((0.1, "good"), (6.0, "warn"), (500.0, "warn")):
        page = calibration_html(calibrated(machine, away=away))
        assert f'<h1 class="{tone}">' in page
        assert ("something may be missing" in headline(page)) is (away == 6.0)


# -- the page itself -----------------------------------------------------------------------------------


def page_of(*texts: str, **more: Any) -> str:
    sections = [Section("a", "A", [Text(text) for text in texts])]
    return html(Document("t", "h", "good", sections=lambda: sections, **more))


def test_slugs_of_the_catalogue_are_in_small_type_and_code_is_code() -> None:
    page = page_of("joint (joint-compliance) or (2-fold)", "write `gravity: [0]` and `x` <b>")
    assert "joint <small>(joint-compliance)</small> or (2-fold)" in page
    assert "write <code>gravity: [0]</code> and <code>x</code> &lt;b&gt;" in page


def test_a_browser_is_told_to_run_the_page_s_own_scripts_alone() -> None:
    """By their digests: each script of the page has one, and there is no other."""
    page = page_of("x")
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert len(scripts) == 3
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    told = re.findall(r"'sha256-([^']+)'", unescape(policy[1]))
    digests = [base64.b64encode(hashlib.sha256(one.encode()).digest()).decode() for one in scripts]
    assert told == digests
    assert "default-src 'none'" in unescape(policy[1])


def test_the_page_s_data_cannot_end_its_script(plain: Diagnosis) -> None:
    assert page_data(page_of("x", rows=[3, 5])) == {"rows": [3, 5], "scene": None}
    bad = replace(plain, recording=replace(plain.recording, files=("</script><b>&.csv",)))
    page = report_html(bad)
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert data is not None and not re.search(r"[<>&]", data[1])
    assert (
        page_data(page)["scene"]["where"][0] == "script><b>&.csv, row 1"
    )  # what stands after the last slash
    assert page_data(report_html(replace(plain, fits={**plain.fits, "after": summary(1.0, 1.0)})))["rows"]
