"""Findings as data: everything that a report says of each, and rows that were left out as findings of their own."""

from __future__ import annotations

from dataclasses import replace

import pytest

from support.reports import NAN, gear_finding, synthetic
from truepose.identification.diagnosis.result import Alternative, Diagnosis, Lead, Levels, Replication
from truepose.identification.report.finding_words import explanation, separating_experiment
from truepose.identification.report.results import (
    alternative_json,
    finding_json,
    law_of,
    outliers_json,
    untestable_json,
)
from truepose.identification.signatures.untestable import Missing, Untestable
from truepose.models.machine.machine import Machine


def test_a_finding_is_whole() -> None:
    levels = Levels(0.99, "position-periodic", 0.98)
    own = replace(gear_finding(), levels=levels, family="transmission-error", tested=False)
    document = finding_json(own)
    assert document["place"] == ["q1"] and document["effect"] == "transmission-error"
    assert (document["probability"], document["certainty"], document["log_bayes_factor"]) == (
        0.93,
        0.999,
        120.0,
    )
    assert document["levels"] == {
        "place": 0.99, "driver": {"kind": "position-periodic", "probability": 0.98}, "law": 0.93,
    }  # fmt: skip
    assert document["parameters"]["a"] == {"value": 3e-4, "std": 1e-5, "unit": "rad"}
    assert document["settings"] == [{"order": 2.0}]
    assert document["prior_dependent"] is True and document["flip_lambda"] == 3.0
    assert document["law_tested"] is False and document["family"] == "transmission-error"
    assert document["replication"] == {"halves": [0.97, 0.9], "agree": True}
    assert document["explanation"] == explanation(own)
    assert document["separating_experiment"] == separating_experiment(own)
    (rival,) = document["equivalents"]
    assert rival == {
        "effect": "encoder-eccentricity", "place": ["q1"], "probability": 0.06, "log_bayes_factor": 117.5,
    }  # fmt: skip


def test_what_is_not_there_is_null() -> None:
    bare = replace(gear_finding(), flip_lambda=None, replication=None, equivalents=())
    document = finding_json(bare)
    assert document["family"] is document["replication"] is document["flip_lambda"] is None
    assert (
        document["prior_dependent"] is False
        and document["equivalents"] == []
        and document["law_tested"] is True
    )
    apart = finding_json(replace(bare, replication=Replication((0.1, 0.2), agree=False)))
    assert apart["replication"] == {"halves": [0.1, 0.2], "agree": False}


def test_what_has_no_name_has_no_law() -> None:
    lead = Lead("backlash", ("q3",), Levels(0.46, "arrival", 0.45), 0.4)
    assert law_of(lead) == 0.4 and law_of(replace(lead, effect="empirical")) is None
    nameless = finding_json(replace(gear_finding(), effect="empirical"))
    assert nameless["levels"]["law"] is None


def test_an_explanation_that_could_not_be_tested_says_so() -> None:
    own = Alternative("backlash", ("q1", "q2"), 0.25, 3.0)
    plain = {"effect": "backlash", "place": ["q1", "q2"], "probability": 0.25, "log_bayes_factor": 3.0}
    assert alternative_json(own) == plain
    assert alternative_json(replace(own, tested=False)) == {**plain, "tested": False}
    why = Untestable("joint-compliance", "no `gravity:`")
    lacks = (
        Missing(("backlash",), "no side", "add a"),
        Missing(("latency", "joint-compliance"), "no b", "add b"),
    )
    assert untestable_json(why, lacks) == {
        "effect": "joint-compliance",
        "why": "no `gravity:`",
        "add": "add b",
    }
    assert untestable_json(why, lacks[:1]) == {"effect": "joint-compliance", "why": "no `gravity:`"}


def left_out(machine: Machine, *rows: int, lost: bool = False, validation: int | None = None) -> Diagnosis:
    """Rows (numbered from 1) with a residual of 6, 0 and 8 sigmas that were not fitted."""
    found = synthetic(machine)
    used, residual = found.after.used.copy(), found.after.residual.copy()
    held = found.recording.validation.copy()
    at = [row - 1 for row in rows]
    used[at], residual[at] = False, [6.0, 0.0, 8.0]
    used[20], residual[20] = False, 50.0  # left out for another reason
    if lost:
        residual[at[0], 0] = NAN
    if validation is not None:
        held[validation - 1] = True
    after = replace(found.after, used=used, residual=residual)
    recording = replace(found.recording, validation=held)
    return replace(found, after=after, recording=recording, outlier_rows=rows)


def test_rows_that_were_left_out_are_one_finding(machine: Machine) -> None:
    """Its evidence is what noise alone would have to explain; a reading that was lost says nothing."""
    found = left_out(machine, 3, 7)
    (document,) = outliers_json(found)
    assert (document["effect"], document["place"]) == ("outliers", ["3", "7"])
    noise = max(found.after.chi2_per_dof, 1.0)
    expected = 2 * 0.5 * (36.0 / noise - 1.0 + 64.0 / noise - 1.0)
    assert document["log_bayes_factor"] == pytest.approx(expected)
    assert document["probability"] == document["certainty"] == document["levels"]["law"] == 0.999
    assert document["levels"]["driver"] == {"kind": "sensor", "probability": 0.999}
    assert document["law_tested"] is document["prior_dependent"] is False
    assert document["explanation"] and document["separating_experiment"]
    half = pytest.approx(expected / 2)
    (lost,) = outliers_json(left_out(machine, 3, 7, lost=True))
    assert lost["log_bayes_factor"] == half and lost["place"] == ["3", "7"]
    (held,) = outliers_json(left_out(machine, 3, 7, validation=3))
    assert held["log_bayes_factor"] == half
    assert outliers_json(replace(found, outlier_rows=())) == []


def test_noise_that_was_found_counts_in_the_evidence(machine: Machine) -> None:
    """Four times the variance leaves a quarter of the squares; less than the stated noise is not believed."""
    found = left_out(machine, 3, 7)
    used = found.after.used
    for scale in (3.0, 0.1):
        residual = found.after.residual.copy()
        residual[used] *= scale
        own = replace(found, after=replace(found.after, residual=residual))
        (document,) = outliers_json(own)
        noise = max(own.after.chi2_per_dof, 1.0)
        assert (noise > 1.0) is (scale > 1.0)
        assert document["log_bayes_factor"] == pytest.approx(100.0 / noise - 2.0)


def test_miscounted_fringes_are_a_finding_beside_other_rows(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    # an interferometer's machine would have to be fitted for this: which rows are fringes is tried elsewhere
    counted = {7: -2}
    module = "truepose.identification.report.results.fringes_by_row"
    monkeypatch.setattr(module, lambda fit, recording, rows: counted)
    found = left_out(machine, 3, 7)
    fringes, others = outliers_json(found)
    assert (fringes["effect"], fringes["place"]) == ("fringe-miscount", ["7"])
    assert fringes["explanation"].endswith(" Half wavelengths too many: row 7: -2.")
    assert (others["effect"], others["place"]) == ("outliers", ["3"])
    assert "Half wavelengths" not in others["explanation"]
    counted[3] = 1
    (only,) = outliers_json(found)
    assert only["place"] == ["7", "3"] and only["explanation"].endswith(": row 7: -2, row 3: +1.")
