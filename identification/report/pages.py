"""Whole reports: which sections, in which order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.absurd import judged
from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.summary import FitSummary, summarise
from truepose.identification.recording.recording import Recording
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report import render
from truepose.identification.report.document import Block, Document, Section, Text, Tone
from truepose.identification.report.figures import style
from truepose.identification.report.fits import fit_column
from truepose.identification.report.judgement_words import diagnosis_judgement
from truepose.identification.report.numbers import significant
from truepose.identification.report.sections.evidence import evidence_section
from truepose.identification.report.sections.findings import findings_section
from truepose.identification.report.sections.fit import fit_blocks, fit_section
from truepose.identification.report.sections.limits import limits_blocks, limits_section
from truepose.identification.report.sections.parameters import parameter_blocks, parameter_section
from truepose.identification.report.sections.residuals import residual_blocks, residual_section
from truepose.identification.report.sections.truth import truth_section

SUSPICIOUS = 1.3
"""Misfit chi2 per degree of freedom above which a calibration alone does not explain the readings."""


def report_html(
    diagnosis: Diagnosis, truth: Mapping[str, Any] | None = None, cautions: Sequence[str] = ()
) -> str:
    """The report of a diagnosis as one HTML file that loads nothing.

    ``truth`` (bundled demonstrations only) adds a last page; ``cautions`` stand above all.
    """
    return render.html(replace(_diagnosis_document(diagnosis, truth), cautions=tuple(cautions)))


def calibration_html(
    estimate: Estimate,
    free: Estimate | None,
    recording: Recording,
    warnings: Sequence[str] = (),
    cautions: Sequence[str] = (),
) -> str:
    """The report of a fit alone; ``free`` is the same fit with its tolerances widened.

    ``warnings`` open its first section, ``cautions`` stand above all.
    """
    document = _calibration_document(estimate, free, recording, warnings)
    return render.html(replace(document, cautions=tuple(cautions)))


def _diagnosis_document(diagnosis: Diagnosis, truth: Mapping[str, Any] | None) -> Document:
    parts = [
        findings_section(diagnosis),
        fit_section(diagnosis),
        evidence_section(diagnosis),
        residual_section(diagnosis),
        parameter_section(diagnosis),
        limits_section(diagnosis),
    ]
    if truth is not None:
        parts.append(truth_section(diagnosis, truth))
    return _document(diagnosis, parts)


def _document(diagnosis: Diagnosis, parts: list[Section]) -> Document:
    said, tone = words.headline(diagnosis)
    refused = diagnosis_judgement(diagnosis).refusal
    if refused:
        said, tone = f"{refused}. {said}", "warn"
    before = diagnosis.fits.get("before")
    after = diagnosis.fits.get("after")
    facts = [
        ("verdict", diagnosis.verdict),
        *_facts(diagnosis.machine.name, diagnosis.recording, diagnosis.before),
    ]
    if before is not None and after is not None and diagnosis.terms:
        facts.append(
            (
                "chi2/dof before, after",
                f"{significant(before.chi2_per_dof)}, {significant(after.chi2_per_dof)}",
            )
        )
    return Document(f"truepose: diagnosis of {diagnosis.machine.name}", said, tone, facts, parts)


def _facts(machine: str, recording: Recording, fit: Estimate) -> list[tuple[str, str]]:
    rows = (
        f"{int(fit.used.sum())} fitted, {int(recording.validation.sum())} for validation, of {len(recording)}"
    )
    names = ", ".join(Path(name).name for name in recording.files)
    return [("machine", machine), ("recording", names), ("rows", rows)]


def _calibration_document(
    estimate: Estimate, free: Estimate | None, recording: Recording, warnings: Sequence[str]
) -> Document:
    machine = estimate.machine
    fits = {"calibrated": estimate} if free is None else {"free": free, "calibrated": estimate}
    summaries = {key: summarise(fit, recording.validation) for key, fit in fits.items()}
    drawn = [("calibrated", style.AFTER, estimate)]
    limits: list[Block] = limits_blocks(estimate)
    if recording.notes:
        limits.append(Text(f"Notes: {'; '.join(recording.notes)}."))
    columns = [fit_column(key, fit, summaries[key], recording.validation) for key, fit in fits.items()]
    parts = [
        Section("fit", "Fit", [*(Text(said, "warn") for said in warnings), *fit_blocks(machine, columns)]),
        Section(
            "parameters",
            "Parameters against their tolerances",
            parameter_blocks(machine, fits, summaries["calibrated"].worst_allowed),
        ),
        Section("residuals", "Residuals", residual_blocks(machine, recording, drawn, [])),
        Section("limits", "What the data cannot tell", limits),
    ]
    said, well = calibrated_words(machine.name, summaries["calibrated"])
    refused = judged(estimate).refusal
    if refused:
        said, well = f"{refused}.", False
    facts = _facts(machine.name, recording, estimate)
    tone: Tone = "good" if well else "warn"
    return Document(f"truepose: calibration of {machine.name}", said, tone, facts, parts)


def calibrated_words(name: str, summary: FitSummary) -> tuple[str, bool]:
    """The outcome of a calibration in a sentence or two, and whether nothing speaks against it."""
    within = not summary.worst_parameter_sigma > summary.worst_allowed
    good = within and not summary.chi2_per_dof > SUSPICIOUS
    said = (
        f"{name} is calibrated: misfit chi2/dof {significant(summary.chi2_per_dof)}, farthest parameter"
        f" {summary.worst_parameter} at {significant(summary.worst_parameter_sigma)} tolerances"
        f" ({'within' if within else 'beyond'} the {significant(summary.worst_allowed)} that a true model"
        " allows)."
    )
    return (said if good else f"{said} Something may be missing: truepose diagnose tells what."), good
