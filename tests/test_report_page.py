"""The page of a report: one file that loads nothing, always the same, whole whatever it is given."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.reports import NAN, arm, fitted, gear_finding, own_markup, recorded, synthetic
from truepose.identification.diagnosis.alarms import Alarm
from truepose.identification.diagnosis.result import Diagnosis, FitSummary, Proof
from truepose.identification.report import report_html, write_report
from truepose.models.machine import Machine


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return arm(tmp_path_factory.mktemp("machine"))


@pytest.fixture(scope="module")
def diagnosis(machine: Machine) -> Diagnosis:
    return synthetic(machine)


@pytest.fixture(scope="module")
def page(diagnosis: Diagnosis) -> str:
    return report_html(diagnosis)


def test_page_loads_nothing(page: str) -> None:
    assert not re.search(r"<script[^>]*\ssrc\s*=", page)
    assert not re.search(r"<link\b|<img\b|<iframe\b|@import", own_markup(page))
    assert not re.search(r"https?://", own_markup(page))
    assert page.count("Plotly.newPlot(") > 5


def test_same_bytes_each_time(page: str, machine: Machine) -> None:
    assert page == report_html(synthetic(machine))


def test_written_file_is_the_page(diagnosis: Diagnosis, page: str, tmp_path: Path) -> None:
    path = write_report(diagnosis, tmp_path / "report.html")
    assert path.read_text(encoding="utf-8") == page


def test_text_from_users_is_escaped(machine: Machine) -> None:
    name = "arm<script>alert(1)</script>"
    bad = "leg</script><b>"
    page = own_markup(
        report_html(synthetic(replace(machine, name=name), evidence_map={bad: 4.0}, notes=(bad,)))
    )
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
    assert not re.search(
        r"\bnan\b", re.sub(r"<script.*?</script>", "", own_markup(page), flags=re.DOTALL), re.IGNORECASE
    )
    assert "NaN" not in "".join(re.findall(r"Plotly.newPlot.*", page))


def test_large_recordings_are_thinned(machine: Machine) -> None:
    plain = synthetic(machine)
    recording = recorded(machine, 5000)
    bare, full = fitted(machine, recording), fitted(machine, recording, plain.terms)
    large = replace(plain, recording=recording, free=bare, before=bare, after=full)
    page = own_markup(report_html(large))
    assert "Of 5,000 rows 2,000 are drawn" in page
    assert len(page) < 2_500_000
