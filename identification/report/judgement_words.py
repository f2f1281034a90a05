"""A result that is no calibration, as data: ``fit.json``, ``diagnosis.json`` and ``--json`` say it alike."""

from __future__ import annotations

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.summary import Judgement, judged_diagnosis
from truepose.identification.report.json_text import Json


def judgement_json(judgement: Judgement) -> Json:
    """Whether it may be called a calibration, and why not."""
    return {"calibrated": judgement.calibrated, "why": judgement.why}


def diagnosis_judgement(diagnosis: Diagnosis) -> Judgement:
    """The judgement of the model that a diagnosis ends with."""
    named = any(not finding.nameless for finding in diagnosis.findings)
    return judged_diagnosis(diagnosis.before, diagnosis.after, named=named)
