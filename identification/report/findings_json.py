"""Findings and their rivals as JSON: what ``diagnosis.json`` says of each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose.identification.diagnosis.null_fits import fringes_by_row
from truepose.identification.diagnosis.result import (
    Alternative,
    Diagnosis,
    Finding,
    Lead,
    Levels,
    Quantity,
    Replication,
)
from truepose.identification.report.diagnosis_words import explanation, separating_experiment
from truepose.identification.report.json_text import Json
from truepose.identification.signatures.untestable import Missing, Untestable
from truepose.models.effects.base import effects
from truepose.models.effects.empirical import Empirical


def finding_json(finding: Finding) -> Json:
    """What was found at a place, with its rivals and how it was judged."""
    return {
        "effect": finding.effect,
        "place": list(finding.place),
        "probability": finding.probability,
        "certainty": finding.certainty,
        "log_bayes_factor": finding.log_bayes_factor,
        "equivalents": [alternative_json(a) for a in finding.equivalents],
        "parameters": {name: _quantity(q) for name, q in finding.parameters.items()},
        "settings": [dict(s) for s in finding.settings],
        "levels": levels_json(finding.levels, law_of(finding)),
        "law_tested": finding.tested,
        "prior_dependent": finding.prior_dependent,
        "flip_lambda": finding.flip_lambda,
        "family": finding.family or None,
        "replication": finding.replication and _replication(finding.replication),
        "explanation": explanation(finding),
        "separating_experiment": separating_experiment(finding),
    }


def law_of(one: Finding | Lead) -> float | None:
    """The probability of a law; None where there is none."""
    return None if one.effect == Empirical.slug else one.probability


def levels_json(levels: Levels, law: float | None) -> Json:
    """What is known of where something is, of what drives it, and of its law."""
    driver = {"kind": levels.kind, "probability": levels.driver}
    return {"place": levels.place, "driver": driver, "law": law}


def outliers_json(diagnosis: Diagnosis) -> list[Json]:
    """Rows that were left out, as findings of their own; they do not change the verdict."""
    rows = fringes_by_row(diagnosis.after, diagnosis.recording, diagnosis.outlier_rows)
    others = [row for row in diagnosis.outlier_rows if row not in rows]
    told = ", ".join(f"row {row}: {count:+d}" for row, count in rows.items())
    found = [_row_finding(diagnosis, "fringe-miscount", list(rows), f" Half wavelengths too many: {told}.")]
    found.append(_row_finding(diagnosis, "outliers", others))
    return [finding for finding in found if finding["place"]]


def _row_finding(diagnosis: Diagnosis, slug: str, rows: Sequence[int], more: str = "") -> Json:
    """A finding of rows."""
    after, recording = diagnosis.after, diagnosis.recording
    left_out = ~after.used & ~recording.validation & np.isfinite(after.residual).all(axis=1)
    left_out &= np.isin(recording.source_row, rows)
    far = after.residual[left_out] ** 2 / max(after.chi2_per_dof, 1.0)
    effect, place = effects.get(slug, slug)(), tuple(str(row) for row in rows)
    return {
        "effect": slug,
        "place": list(place),
        "probability": 0.999,
        "certainty": 0.999,
        "log_bayes_factor": 0.5 * float(np.sum(far[far != 0.0] - 1.0)),  # a lost reading says nothing
        "equivalents": [],
        "parameters": {},
        "settings": [],
        "levels": {"place": 0.999, "driver": {"kind": "sensor", "probability": 0.999}, "law": 0.999},
        "law_tested": False,
        "prior_dependent": False,
        "flip_lambda": None,
        "family": None,
        "replication": None,
        "explanation": effect.explain(diagnosis.nominal, place) + more,
        "separating_experiment": effect.experiment,
    }


def alternative_json(other: Alternative) -> Json:
    """Another explanation of the same readings."""
    out: Json = {"effect": other.effect, "place": list(other.place)}
    out |= {"probability": other.probability, "log_bayes_factor": other.log_bayes_factor}
    return out if other.tested else out | {"tested": False}


def untestable_json(one: Untestable, missing: Sequence[Missing]) -> Json:
    """Why an effect could not be tested, and what to ``add`` where a line or a column would change that."""
    add = next((m.add for m in missing if one.effect in m.effects), None)
    return {"effect": one.effect, "why": one.why} | ({} if add is None else {"add": add})


def _replication(halves: Replication) -> Json:
    return {"halves": list(halves.halves), "agree": halves.agree}


def _quantity(quantity: Quantity) -> Json:
    return {"value": quantity.value, "std": quantity.std, "unit": quantity.unit}
