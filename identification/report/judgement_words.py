"""A fit that is no calibration, in words: they come first wherever it is told."""

from __future__ import annotations

from collections.abc import Mapping

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.absurd import Judgement, Misfit, judged_diagnosis
from truepose.identification.report.json_text import Json
from truepose.identification.report.numbers import measure, significant
from truepose.wording import joined

MOST = 3
"""Most constants that are named."""
REFUSED = "NOT CALIBRATED"


def why(judgement: Judgement, units: Mapping[str, str]) -> list[str]:
    """The reasons, a sentence each; ``units`` of residuals by kind. Empty where a fit may be called a calibration."""
    misfit = [] if judgement.misfit is None else [_misfit(judgement.misfit, units)]
    return misfit + ([_departures(judgement.departures)] if judgement.departures else [])


def refusal(judgement: Judgement, units: Mapping[str, str]) -> str:
    """The first words of what is told of such a fit; nothing of another."""
    said = why(judgement, units)
    return f"{REFUSED}: {'; '.join(said)}" if said else ""


def judgement_json(judgement: Judgement, units: Mapping[str, str]) -> Json:
    """The same for ``fit.json``, ``diagnosis.json`` and ``--json``."""
    return {"calibrated": judgement.calibrated, "why": why(judgement, units)}


def diagnosis_judgement(diagnosis: Diagnosis) -> Judgement:
    """The judgement of the model that a diagnosis ends with."""
    named = any(not finding.nameless for finding in diagnosis.findings)
    return judged_diagnosis(diagnosis.before, diagnosis.after, named=named)


def _misfit(misfit: Misfit, units: Mapping[str, str]) -> str:
    rms = [f"{kind} {measure(value, units[kind])}" for kind, value in misfit.rms.items()]
    return (
        f"it leaves {joined(rms)} rms, {significant(misfit.sigmas)} sigma, where the drawing's tolerances allow"
        f" {significant(misfit.expected)}"
    )


def _departures(departures: tuple[tuple[str, float], ...]) -> str:
    told = [f"{name} by {significant(value)}" for name, value in departures[:MOST]]
    more = [f"{len(departures) - MOST} more"] if len(departures) > MOST else []
    return f"it left its drawing, {joined([*told, *more])} tolerances"


__all__ = ["REFUSED", "diagnosis_judgement", "judgement_json", "refusal", "why"]
