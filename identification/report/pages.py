"""Whole reports of a diagnosis and of a calibration: which parts, in which order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import judged, summarise
from truepose.identification.recording.recording import Recording
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report import render
from truepose.identification.report.calibration_words import calibrated_headline
from truepose.identification.report.document import Block, Document, Items, Section, Text, Tone
from truepose.identification.report.figures.residuals import Drawn, picked
from truepose.identification.report.fits import fit_column
from truepose.identification.report.judgement_words import diagnosis_judgement
from truepose.identification.report.opening import calibration_opening, diagnosis_opening
from truepose.identification.report.scene.scene import scene_of
from truepose.identification.report.sections.evidence import evidence_section
from truepose.identification.report.sections.findings import findings_section
from truepose.identification.report.sections.fit import fit_blocks, fit_section
from truepose.identification.report.sections.limits import limits_blocks, limits_section
from truepose.identification.report.sections.origin import calibration_origin, diagnosis_origin
from truepose.identification.report.sections.parameters import (
    constants_blocks,
    correlation_blocks,
    parameter_blocks,
    parameter_section,
)
from truepose.identification.report.sections.residuals import (
    diagnosis_fits,
    residual_blocks,
    residual_section,
    series_of,
)
from truepose.identification.report.sections.truth import truth_section
from truepose.identification.report.sections.uncertainty import uncertainty_section
from truepose.models.file.machine_file import ExpectedPose

SUSPICIOUS = 1.3
"""Misfit chi2 per degree of freedom above which a calibration alone does not explain the readings."""

_VERDICTS = {"missing-physics": "physics is missing", "unknown": "something is missing"}


def report_html(
    diagnosis: Diagnosis, truth: Mapping[str, Any] | None = None, cautions: Sequence[str] | None = None
) -> str:
    """The report of a diagnosis as one HTML file that loads nothing.

    ``truth`` (bundled demonstrations only) adds a last page; ``cautions`` of a check stand above all.
    """
    document = _diagnosis_document(diagnosis, truth, checked=cautions is not None)
    return render.html(replace(document, cautions=tuple(cautions or ())))


def calibration_html(
    calibration: Calibration,
    warnings: Sequence[str] = (),
    cautions: Sequence[str] = (),
    pose: ExpectedPose | None = None,
) -> str:
    """The report of a fit alone. ``warnings`` stand on its first screen, ``cautions`` above all.

    ``pose``: what the fit is worth to the tool, where that was judged.
    """
    return render.html(replace(_calibration_document(calibration, warnings, pose), cautions=tuple(cautions)))


def _diagnosis_document(
    diagnosis: Diagnosis, truth: Mapping[str, Any] | None, *, checked: bool = False
) -> Document:
    machine, recording = diagnosis.nominal, diagnosis.recording
    rows = picked(len(recording), series_of(machine, recording, len(diagnosis_fits(diagnosis))))
    parts = [
        findings_section(diagnosis, rows),
        fit_section(diagnosis),
        residual_section(diagnosis, rows),
        parameter_section(diagnosis),
        uncertainty_section(diagnosis.after, recording, diagnosis.before),
        evidence_section(diagnosis),
        limits_section(diagnosis),
        diagnosis_origin(diagnosis),
    ]
    if truth is not None:
        parts.append(truth_section(diagnosis, truth))
    said, tone = words.headline(diagnosis, brief=True)
    refused = diagnosis_judgement(diagnosis).refusal
    if refused:
        said, tone = f"{refused}. {said}", "warn"
    facts = [
        ("verdict", _VERDICTS.get(diagnosis.verdict, diagnosis.verdict)),
        *_facts(machine.name, recording, diagnosis.before),
    ]
    title = f"truepose: diagnosis of {machine.name}"
    opening = diagnosis_opening(diagnosis, checked=checked)
    return Document(title, said, tone, facts, parts, (), opening, rows.tolist())


def _facts(machine: str, recording: Recording, fit: Estimate) -> list[tuple[str, str]]:
    rows = (
        f"{int(fit.used.sum())} fitted, {int(recording.validation.sum())} for validation, of {len(recording)}"
    )
    names = ", ".join(Path(name).name for name in recording.files)
    return [("machine", machine), ("recording", names), ("rows", rows)]


def _calibration_document(
    calibration: Calibration, warnings: Sequence[str], pose: ExpectedPose | None
) -> Document:
    estimate, free, recording = calibration.fit, calibration.free, calibration.recording
    machine = estimate.nominal
    fits = {"calibrated": estimate} if free is None else {"free": free, "calibrated": estimate}
    summaries = {key: summarise(fit, recording.validation) for key, fit in fits.items()}
    own = summaries["calibrated"]
    drawn = [Drawn("calibrated", "after", estimate.residual, estimate.used | recording.validation)]
    rows = picked(len(recording), series_of(machine, recording, 1))
    notes = [Items(calibration.notes, title="Notes")] if calibration.notes else []
    columns = [fit_column(key, fit, summaries[key], recording.validation) for key, fit in fits.items()]
    constants: list[Block] = [
        *constants_blocks(estimate, "calibrated.yaml"),
        *parameter_blocks(machine, fits, own.worst_allowed),
        *correlation_blocks(estimate),
    ]
    parts = [
        Section("fit", "Fit", [*(Text(said, "warn") for said in warnings), *fit_blocks(machine, columns)]),
        Section("residuals", "Residuals", residual_blocks(machine, recording, drawn, [], rows)),
        Section("constants", "Calibrated constants", constants),
        uncertainty_section(estimate, recording, None),
        Section("limits", "What the data cannot tell", [*limits_blocks(estimate), *notes]),
        calibration_origin(calibration),
    ]
    said, well = calibrated_headline(machine, own)
    refused = judged(estimate).refusal
    if refused:
        said, well = f"{refused}.", False
    tone: Tone = "good" if well else "warn"
    title, facts = f"truepose: calibration of {machine.name}", _facts(machine.name, recording, estimate)
    opening = replace(
        calibration_opening(calibration, own, pose, warnings), scene=scene_of(estimate, None, recording, [])
    )
    return Document(title, said, tone, facts, parts, (), opening, rows.tolist())
