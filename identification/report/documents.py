"""Results of the kernel as documents: the first screen of each, and the pages of a diagnosis and of a calibration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from truepose.identification.compensation.inverse import Inverse, Reach
from truepose.identification.diagnosis.null_fits import far_rows, fringes_by_row
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import FitSummary, judged, summarise
from truepose.identification.fit.tool_pose import calibrated_pose
from truepose.identification.recording.recording import Recording
from truepose.identification.report import finding_words, verdict
from truepose.identification.report.applied_words import applied_words
from truepose.identification.report.closing import limits_section, origin_section, truth_section
from truepose.identification.report.constants import (
    constants_section,
    farthest_chart,
    farthest_table,
    mount_words,
    parameter_section,
)
from truepose.identification.report.finding_cards import findings_section
from truepose.identification.report.fit_tables import fit_section, fit_table
from truepose.identification.report.gains import diagnosis_gains, fit_gains
from truepose.identification.report.naming import effect_title, excluded_words, far_row_words, named
from truepose.identification.report.notes import diagnosis_notes
from truepose.identification.report.numbers import measure, percent, significant, unit_symbol
from truepose.identification.report.residuals import (
    Drawn,
    diagnosis_fits,
    picked,
    residual_section,
    size_chart,
    telling_drivers,
)
from truepose.identification.report.results import calibration_json, diagnosis_judgement
from truepose.identification.report.scene.scene import scene_of
from truepose.identification.report.steps import calibration_steps, diagnosis_steps
from truepose.identification.report.uncertainty import uncertainty_section
from truepose.identification.report.weighing import weighing_section
from truepose.models.file.sections import ExpectedPose
from truepose.shown.document import Document, Guilty, Items, Section, Table, Text
from truepose.shown.result import document, frame
from truepose.wording import joined, shortened

MOST, GUILTY = 12, 8
_VERDICTS = {"missing-physics": "physics is missing", "unknown": "something is missing"}


@document.register
def diagnosis_document(
    found: Diagnosis,
    output: Path | None = None,
    truth: Mapping[str, Any] | None = None,
    checked: bool = False,
) -> Document:
    """Of a diagnosis whose results are in the folder ``output`` (None for a page, which names files alone).

    truth: what a simulation put in; checked: whether ``check`` has looked at the files, so that nobody is sent back to it.
    """
    said, tone = verdict.headline(found)
    judgement = diagnosis_judgement(found)
    if judgement.refusal:
        said, tone = f"{judgement.refusal}. {said}", "warn"
    rows = picked(found.nominal, found.recording, 2 if found.terms else 1)
    facts = [("verdict", _VERDICTS.get(found.verdict, found.verdict))]
    return Document(
        f"truepose: diagnosis of {found.nominal.name}",
        said,
        tone,
        [*facts, *_facts(found.nominal.name, found.recording, found.before)],
        diagnosis_gains(found),
        [one for one in _summary(found) if one.items],
        diagnosis_steps(found, output, calibrated=judgement.calibrated, checked=checked),
        diagnosis_notes(found),
        more="see report.html",
        charts=lambda: [size_chart(found.recording, diagnosis_fits(found), rows)],
        sections=lambda: _diagnosis_sections(found, truth),
        scene=lambda: scene_of(
            found.before,
            found.after if found.terms else None,
            found.recording,
            [_guilty(f) for f in found.findings[:GUILTY]],
        ),
        rows=rows.tolist(),
    )


def _summary(found: Diagnosis) -> list[Items]:
    """What was found, how sure, what it is worth, what speaks against it, what could not be tested, what was left out."""
    left = found.remainder
    cannot = [
        *verdict.missing_words(found.missing, effect_title),
        *verdict.untestable_lines(found.untestable, found.missing, effect_title),
    ]
    fits = ", ".join(f"{name} {significant(fit.chi2_per_dof)}" for name, fit in found.fits.items())
    leads = [finding_words.lead_words(one) for one in found.leading[:MOST]]
    return [
        Items([finding_words.finding_item(f) for f in found.findings], "What was found", weight=3),
        Items(leads, "Leading, less probable than not", label="leading"),
        Items([finding_words.together_words(one) for one in found.together], "Together", label="together"),
        Items([] if left is None else [_remainder(found)], "What remains", label="remainder"),
        Items([*applied_words(found.applied), *mount_words(found.after)], "What improved.yaml holds"),
        Items(verdict.doubts(found), "What speaks against it", "warn", "against it"),
        Items(cannot, "What could not be tested", "warn", "could not be tested"),
        Items(_excluded(found), "Rows left out"),
        Items([f"chi2 per degree of freedom: {fits}"], "Misfit"),
    ]


def _remainder(found: Diagnosis) -> str:
    left = found.remainder
    assert left is not None
    units = found.nominal.residual_units
    worth = [f"{measure(gain, units[kind])} ({kind})" for kind, gain in left.gain.items()]
    gained = f"; modelling it lowers the rms of held-out rows by {joined(worth)} more" if worth else ""
    return f"{significant(left.size_sigma)} sigma rms, {finding_words.form_words(left)}{gained}"


def _excluded(found: Diagnosis) -> list[str]:
    if not found.outlier_rows:
        return []
    fringes = fringes_by_row(found.after, found.recording, found.outlier_rows)
    off = [f"row {row} by {count:+d}" for row, count in fringes.items()]
    more = [f"miscounted fringes, off by whole half wavelengths: {', '.join(off)}"] if off else []
    return [excluded_words(found.outlier_rows), *more]


def _guilty(finding: Finding) -> Guilty:
    said, sure = finding_words.known_words(finding)
    return Guilty(said, "" if finding.nameless else finding.effect, sure, finding.place)


def _diagnosis_sections(found: Diagnosis, truth: Mapping[str, Any] | None) -> list[Section]:
    machine, recording = found.nominal, found.recording
    fits = diagnosis_fits(found)
    rows = picked(machine, recording, len(fits))
    return [
        findings_section(found, rows),
        fit_section(found),
        residual_section(machine, recording, fits, telling_drivers(found), rows),
        parameter_section(found),
        uncertainty_section(found.after, recording, found.before),
        weighing_section(found),
        limits_section(
            found.after if found.terms else found.before, found.untestable, diagnosis_notes(found)
        ),
        origin_section(machine, recording, "diagnose"),
        *([] if truth is None else [truth_section(found, truth)]),
    ]


def _facts(machine: str, recording: Recording, fit: Estimate) -> list[tuple[str, str]]:
    rows = (
        f"{int(fit.used.sum())} fitted, {int(recording.validation.sum())} for validation, of {len(recording)}"
    )
    names = ", ".join(Path(name).name for name in recording.files)
    return [("machine", machine), ("recording", names), ("rows", rows)]


@document.register
def _(found: Calibration) -> Document:
    far = calibration_json(found, far_rows(found))["rows_that_do_not_fit"]
    return calibration_document(found, far, calibrated_pose(found.fit, found.recording, found.began))


def calibration_document(
    found: Calibration,
    far: Sequence[Mapping[str, Any]],
    pose: ExpectedPose | None,
    output: Path | None = None,
) -> Document:
    """Of a calibration. far: ``rows_that_do_not_fit`` of ``fit.json``; pose: what it is worth to the tool, if that was judged;
    output: the folder of the results, None for a page."""
    fit, recording = found.fit, found.recording
    machine, told = fit.nominal, summarise(fit, recording.validation)
    good = not (told.worst_parameter_sigma > told.worst_allowed or told.chi2_per_dof > verdict.HIGH)
    said = (
        f"{machine.name} is calibrated: nothing speaks against the fit."
        if good
        else f"{machine.name} was fitted, but the fit leaves more than noise: something may be missing."
    )
    refused = judged(fit).refusal
    calibrated = not refused
    files = recording.files
    steps = calibration_steps(machine, files, output, calibrated=calibrated, doubtful=not good)
    rows = picked(machine, recording, 1)
    drawn = [Drawn.of(fit, recording, "calibrated", "after")]
    return Document(
        f"truepose: calibration of {machine.name}",
        f"{refused}." if refused else said,
        "good" if good and calibrated else "warn",
        _facts(machine.name, recording, fit),
        fit_gains(machine, told, pose),
        [
            *_listed(far_row_words(far), "Rows that do not fit", "warn"),
            Items([*_figures(found, told), *mount_words(fit)], "How sure", weight=2),
        ],
        steps,
        found.notes,
        more="see report.html",
        charts=partial(farthest_chart, fit),
        tables=lambda: [farthest_table(fit)],
        sections=lambda: _calibration_sections(found, told, drawn),
        scene=lambda: scene_of(fit, None, recording, []),
        rows=rows.tolist(),
    )


def _listed(texts: Sequence[str], title: str, tone: str) -> list[Items]:
    return [Items(texts, title, tone)] if texts else []  # type: ignore[arg-type]


def _figures(found: Calibration, told: FitSummary) -> list[str]:
    """Misfit, farthest parameter, directions that are seen, and the method."""
    fit = found.fit
    within = "beyond" if told.worst_parameter_sigma > told.worst_allowed else "within"
    flat = found.method["estimator"] in ("ols", "liu", "ridge", "pcr")
    held = "the others stay at the drawing" if flat else "tolerances decide the others"
    farthest = (
        f"farthest parameter {told.worst_parameter} at {significant(told.worst_parameter_sigma)} tolerances ({within} the"
        f" {significant(told.worst_allowed)} that a true model allows)"
    )
    return [
        f"misfit chi2/dof {significant(told.chi2_per_dof)}; converged in {fit.solution.iterations} iterations",
        f"held as the machine file has it: all but {found.only}" if found.only else farthest,
        f"{fit.rank} of {len(fit.prior.free)} directions are seen by the readings"
        + (f"; {held}" if fit.rank < len(fit.prior.free) else ""),
    ]


def _calibration_sections(found: Calibration, told: FitSummary, drawn: Sequence[Drawn]) -> list[Section]:
    fit, free, recording = found.fit, found.free, found.recording
    machine = fit.nominal
    fits = {"calibrated": fit} if free is None else {"free": free, "calibrated": fit}
    summaries = {key: summarise(one, recording.validation) for key, one in fits.items()}
    usual = {"estimator": "map", "solver": "gn"}
    options = [f"--{k} {found.method[k]}" for k, v in usual.items() if found.method.get(k, v) != v]
    rows = picked(machine, recording, 1)
    return [
        Section("fit", "Fit", [fit_table(fits, summaries, recording.validation)]),
        residual_section(machine, recording, drawn, [], rows),
        constants_section(fit, "calibrated.yaml", fits, told.worst_allowed),
        uncertainty_section(fit, recording, None),
        limits_section(fit, (), found.notes),
        origin_section(machine, recording, "calibrate", options),
    ]


@document.register
def _(found: Estimate) -> Document:
    told = summarise(found, ~found.used & False)
    units = found.nominal.residual_units
    rms = ", ".join(f"{kind} {measure(value, units[kind])}" for kind, value in told.rms.items())
    lost = f", {len(found.unassembled)} rows cannot be assembled" if found.unassembled else ""
    effects = [effect.label for effect in found.effects]
    facts = [
        f"{int(found.used.sum())} rows fitted, {found.n_observations} readings{lost}; the readings see {found.rank} of"
        f" {len(found.prior.free)} directions of the free constants",
        *([f"effects: {shortened(effects, MOST)}"] if effects else []),
    ]
    return Document(
        f"Estimate of {found.nominal.name}",
        f"Estimate of {found.nominal.name}: misfit chi2/dof {significant(found.chi2_per_dof)}, rms {rms}",
        summary=[Items(facts), farthest_table(found)],
        more="to_frame() has all constants",
        charts=partial(farthest_chart, found),
    )


@document.register
def _(found: Finding) -> Document:
    alike = [f"could also be: {named(other)} ({percent(other.probability)})" for other in found.equivalents]
    experiment = finding_words.separating_experiment(found)
    rows = [
        [name, f"{q.value:.6g}", f"{q.std:.2g}", unit_symbol(q.unit)] for name, q in found.parameters.items()
    ]
    facts = [
        finding_words.sure_words(found),
        finding_words.tolerance_words(found),
        *alike,
        *([f"what would separate it: {experiment}"] if experiment else []),
    ]
    return Document(
        f"Finding {named(found)}",
        f"Finding {named(found)}: {finding_words.explanation(found)}",
        summary=[Items(facts), Table(["coefficient", "value", "1-sigma", "unit"], rows)],
        more="to_frame() has all coefficients",
    )


@document.register
def _(found: Inverse) -> Document:
    ends = Counter(Reach(int(status)).name.lower().replace("_", " ") for status in found.status)
    told = ", ".join(f"{count} {name}" for name, count in ends.items()) or "none"
    left = [f"{np.max(v, initial=0.0):.4g}" for v in (found.position, found.rotation)]
    return Document(
        "Inverse kinematics",
        f"Inverse kinematics of {len(found.q)} poses: {told}",
        summary=[
            Text(f"left to the pose at most: {left[0]} mm, {left[1]} rad; joints in mm and rad"),
            Table.of(frame(found)),
        ],
        more="to_frame() has all poses",
    )
