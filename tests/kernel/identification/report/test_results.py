"""Results as data: figures of a fit, its constants, and rows that were left out as findings of their own."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.reports import NAN, fitted, gear, recorded, synthetic
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.json_text import finite, json_text
from truepose.identification.report.results import fit_json, outliers_json, parameters_json, unbounded
from truepose.models.machine.machine import Machine

INF = float("inf")


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


@pytest.fixture(scope="module")
def recording(machine: Machine) -> Recording:
    return recorded(machine)


@pytest.fixture(scope="module")
def fit(machine: Machine, recording: Recording) -> Estimate:
    return fitted(machine, recording, (gear(machine),))


def size(residual: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Root mean square of the distance that a row of whitened residuals is, at 0.01 mm a sigma."""
    return float(np.sqrt(np.mean(np.sum((0.01 * residual) ** 2, axis=1))))


def test_figures_of_a_fit_are_those_of_its_rows(fit: Estimate, recording: Recording) -> None:
    """Lengths in mm, those of rows that were not fitted apart."""
    whole = fit_json(replace(fit, unassembled=(2,)), recording)
    used, held = fit.residual[fit.used], fit.residual[recording.validation]
    assert (whole["rows"], whole["readings"], whole["iterations"]) == (25, 75, 3)
    assert whole["rows_left_out"] == ["a&b.csv: row 3"]
    assert whole["chi2"] == pytest.approx(float(np.sum(used**2)))
    free = 75 - whole["effective_parameters"]
    assert whole["chi2_per_dof"] == pytest.approx(whole["chi2"] / free)
    for key, part in (("rms", used), ("validation_rms", held)):
        assert whole[key]["position"] == {"value": pytest.approx(size(part)), "unit": "mm"}
    nobody = replace(recording, validation=np.zeros(30, dtype=bool))
    assert fit_json(fit, nobody)["validation_rms"] is None
    count = len(fit.prior.free)
    assert (whole["free_parameters"], whole["rank"]) == (count, count - 1)
    away = np.abs(fit.in_tolerances)
    assert whole["worst_parameter_sigma"] == pytest.approx(float(np.max(away)))
    assert whole["worst_parameter"] == fit.prior.names[int(np.argmax(away))]


def test_every_free_constant_stands_with_its_drawing_and_its_uncertainty(fit: Estimate) -> None:
    told = parameters_json(fit)
    free = [p for k, p in enumerate(fit.nominal.parameters) if fit.prior.sigma[k] > 0]
    assert list(told) == [p.name for p in free] and len(free) < len(fit.nominal.parameters)
    for k, p in enumerate(fit.nominal.parameters):
        if p.name in told:
            own = told[p.name]
            assert (own["value"], own["nominal"], own["unit"]) == (fit.p[k], p.nominal, p.unit)
            assert (own["tolerance"], own["std"]) == (p.tolerance, fit.std[k])
    assert not all(own["identifiable"] for own in told.values())  # one direction is blind


def test_what_neither_readings_nor_tolerances_hold_has_no_uncertainty() -> None:
    """A 1-sigma of more than a thousand million of what a constant is measured in; what is not free is not looked at."""
    prior = SimpleNamespace(free=[0, 1, 2], names=("a", "b", "c", "d"), scale=np.array([1.0, 1.0, 1e-3, 1.0]))
    std = np.array([0.9e9, 1.1e9, 1.1e6, np.inf])
    assert unbounded(cast(Estimate, SimpleNamespace(std=std, prior=prior))) == {"b", "c"}


def test_a_document_reads_as_it_was_given() -> None:
    text = json_text({"b": [1, 2.5], "a": {"µ": None, "no": True}})
    assert text == ('{\n  "b": [\n    1,\n    2.5\n  ],\n  "a": {\n    "µ": null,\n    "no": true\n  }\n}\n')
    third = 1.0 / 3.0
    assert json.loads(json_text({"x": third}))["x"] == third


@pytest.mark.parametrize(
    ("value", "plain"),
    [
        (NAN, None), (INF, None), (-INF, None), (np.float64(NAN), None), (np.float64(0.5), 0.5), (np.int64(3), 3),
        (np.bool_(True), True), ((1.0, NAN), [1.0, None]), ([(), "x"], [[], "x"]), ({1: {"a": INF}}, {"1": {"a": None}}),
        (False, False), (None, None), (7, 7),
    ],
)  # fmt: skip
def test_what_is_no_finite_number_is_null_at_any_depth(value: object, plain: object) -> None:
    found = finite(value)
    assert found == plain and type(found) is type(plain)
