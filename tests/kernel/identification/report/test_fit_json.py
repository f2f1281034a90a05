"""fit.json and diagnosis.json as data: figures of a fit, its constants, its effects, and what a diagnosis adds."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.reports import fitted, gear, recorded
from truepose.identification.diagnosis.null_fits import FarRow
from truepose.identification.diagnosis.result import Applied, Diagnosis, Lead, Levels, PoseError, Together
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.results import (
    diagnosis_json,
    fit_json,
    parameters_json,
    unbounded,
)
from truepose.identification.signatures.untestable import Missing
from truepose.models.machine.machine import Machine


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


def test_the_fit_s_document_says_what_was_done_and_to_what(
    machine: Machine, recording: Recording, fit: Estimate
) -> None:
    far = [FarRow("day/r.csv", 12, 30.0)]
    whole = fit_json(fit, recording, fit, notes=("a note",), method={"estimator": "map"}, far=far)
    assert (whole["schema"], whole["machine"], whole["files"]) == ("truepose/fit/1", "arm", ["a&b.csv"])
    assert (whole["method"], whole["notes"]) == ({"estimator": "map"}, ["a note"])
    assert whole["judgement"] == {"calibrated": True, "why": []}
    assert whole["rows_that_do_not_fit"] == [{"file": "day/r.csv", "row": 12, "sigma": 30.0}]
    assert whole["free"]["chi2"] == whole["chi2"]
    bare = fit_json(fit, recording)
    assert (bare["free"], bare["method"], bare["notes"], bare["rows_that_do_not_fit"]) == (None, {}, [], [])
    off = fit_json(fitted(machine, recording, away=500.0), recording)["judgement"]
    assert off["calibrated"] is False and off["why"]
    (blind,) = whole["unseen"]
    assert blind["meaning"].endswith("is not seen; tolerances decided") or "alone" in blind["meaning"]
    assert set(blind["parts"]) <= set(fit.prior.names)


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


def test_effects_of_a_fit_stand_with_their_sizes(fit: Estimate, recording: Recording) -> None:
    (effect,) = fit_json(fit, recording)["effects"]
    assert (effect["effect"], effect["place"]) == ("transmission-error", ["q1"])
    assert effect["settings"] == {"order": 2.0}
    std = dict(zip(fit.prior.names, fit.std, strict=True))
    told = effect["parameters"]
    assert {name: own["value"] for name, own in told.items()} == {"a": 3e-4, "b": -1e-4}
    for name, own in told.items():
        label = next(one for one in std if one.endswith(f":{name}"))
        assert own["std"] == pytest.approx(std[label]) and own["unit"] == "rad"


def test_residuals_of_a_diagnosis_are_in_micrometres_and_the_free_fit_has_no_farthest(
    plain: Diagnosis,
) -> None:
    told = diagnosis_json(plain)["fit"]
    assert told["before"] == {
        "rms": {"position": {"value": pytest.approx(12.0), "unit": "um"}},
        "chi2_per_dof": 9.0,
        "validation_rms": {"position": {"value": pytest.approx(13.0), "unit": "um"}},
        "worst_parameter_sigma": 12.0,
        "worst_parameter": "q1.d",
        "worst_parameter_allowed": 3.1,
    }
    assert list(told["free"]) == ["rms", "chi2_per_dof", "validation_rms"]
    assert list(told["after"]) == list(told["before"])


def test_alarms_proofs_leads_and_what_was_applied_are_written(plain: Diagnosis) -> None:
    lead = Lead("backlash", ("q2",), Levels(0.6, "load", 0.4), 0.3)
    error = PoseError(0.5, 0.2)
    applied = Applied("names", "role", error, 0.4, None, 0.9)
    own = replace(
        plain,
        leading=(lead, replace(lead, effect="empirical")),
        together=(Together("load", ("q1", "q2"), 0.98),),
        applied=applied,
        missing=(Missing(("thermal-expansion",), "no column", "add it"),),
    )
    told = diagnosis_json(own)
    law = {"place": 0.6, "driver": {"kind": "load", "probability": 0.4}, "law": 0.3}
    first, second = told["leading"]
    assert first == {"effect": "backlash", "place": ["q2"], "probability": 0.3, "levels": law}
    assert second["levels"] == law | {"law": None}  # which has none
    assert told["together"] == [{"driver": "load", "places": ["q1", "q2"], "probability": 0.98}]
    assert told["alarms"]["residual"] == {"statistic": 1.02, "p": 0.4, "raised": False, "about": "replicates"}
    assert told["alarms"]["prior_conflict"]["raised"] is True
    assert told["untestable"][0]["add"] == "add it" and "add" not in diagnosis_json(plain)["untestable"][0]
    pose = {"plain": 0.5, "model": 0.2, "unit": "mm"}
    assert told["applied"] == {
        "model": "names",
        "held_out": "role",
        "pose": pose,
        "readings_ratio": 0.4,
        "baselines": None,
        "all_that_was_found": {"pose": None, "readings_ratio": 0.9},
    }
    assert told["proof"]["blocks"] == [{"name": "outermost poses", "rows": 12, "ratio": 0.5}]
    assert (told["proof"]["ratio"], told["proof"]["ratio_interval"]) == (0.4, [0.3, 0.5])
    bare = diagnosis_json(replace(plain, proof=None))
    assert bare["proof"] is bare["applied"] is bare["remainder"] is None
    # no number that JSON does not have
    assert told["evidence_map"] == {"q1": 120.0, "q2": -0.5, "base": None}
