"""Reports: one page that loads nothing, and what it says of a diagnosis, of its truth and of a calibration."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from html import unescape
from typing import Any

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
from truepose.models.machine.machine import Machine

SECTIONS = ["verdict", "residuals", "constants", "uncertainty", "limits", "origin"]


@pytest.fixture(scope="module")
def diagnosis(machine: Machine) -> Diagnosis:
    return synthetic(machine)


@pytest.fixture(scope="module")
def page(diagnosis: Diagnosis) -> str:
    return report_html(diagnosis)


def test_sections_stand_in_order(page: str) -> None:
    assert re.findall(r'<section id="([^"]+)"', own_markup(page)) == SECTIONS


@pytest.mark.parametrize(
    ("changes", "said", "unsaid"),
    [
        (
            {"verdict": "unknown", "remainder": Remainder(("q2",), "q2", Form("curve"), 2.1, {"position": 0.004})},
            ["lacks something whose place and driver are not known", "seems to follow q2",
             "q2 errs as a smooth curve in q2; hypothesised",
             "modelling it lowers the rms of held-out rows by 4.00 µm (position) more"],
            "is adequate",
        ),
        (
            {"verdict": "adequate", "concealed": False},
            ["The model of arm is adequate", "Raised: conflict with tolerances; but no explanation is likelier than none"],
            "Concealed",
        ),
    ],
)  # fmt: skip
def test_a_verdict_without_findings_is_told(
    machine: Machine, changes: dict[str, Any], said: list[str], unsaid: str
) -> None:
    plain = synthetic(machine)
    bare = replace(plain, findings=(), terms=(), after=plain.before, proof=None, **changes)
    page = " ".join(own_markup(report_html(bare)).split())
    assert all(text in page for text in said) and unsaid not in page


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
    said = " ".join(own_markup(report_html(synthetic(machine, findings=(weak,)))).split())
    assert (
        "twice its own uncertainty" in said and "eccentric encoder disc" in said and "turn the disc" in said
    )


@pytest.mark.parametrize("with_free", [True, False])
def test_calibration_report(machine: Machine, with_free: bool) -> None:
    recording = recorded(machine)
    fit = fitted(machine, recording)
    free = fitted(machine, recording, away=50.0) if with_free else None
    method = {"estimator": "map", "solver": "gn"}
    page = own_markup(calibration_html(Calibration(fit, free, recording, ("a note",), method)))
    parts = ["residuals", "constants", "uncertainty", "limits", "origin"]
    assert re.findall(r'<section id="([^"]+)"', page) == parts
    assert "truepose calibrate arm.yaml" in page and "a note" in page
    assert "arm is calibrated" in page
    assert ("free fit" in page) is with_free
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
