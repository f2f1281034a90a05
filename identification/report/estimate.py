"""A calibration as a document, top to bottom, and an estimate on one screen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import FitSummary, judged, summarise
from truepose.identification.recording.recording import Recording
from truepose.identification.report import verdict
from truepose.identification.report.applied_words import fit_gains
from truepose.identification.report.closing import (
    calibration_steps,
    limits_section,
    origin_section,
    uncertainty_section,
)
from truepose.identification.report.constants import constants_section, farthest_table, mount_words
from truepose.identification.report.phrases import far_row_words, measure, significant
from truepose.identification.report.residuals import picked, residual_section
from truepose.identification.report.results import calibration_json
from truepose.identification.report.scene import scene_of
from truepose.shown.document import Document, Items, Section
from truepose.shown.result import document
from truepose.wording import shortened

MOST = 12


@document.register
def _(found: Calibration) -> Document:
    return calibration_document(found, calibration_json(found)["rows_that_do_not_fit"])


def calibration_document(
    found: Calibration,
    far: Sequence[Mapping[str, Any]],
    output: Path | None = None,
) -> Document:
    """Return the document of a calibration.

    far: ``rows_that_do_not_fit`` of ``fit.json``; output: the folder of the results, None for a page.
    """
    fit, recording = found.fit, found.recording
    machine, told = fit.nominal, summarise(fit, recording.validation)
    good = not (told.worst_parameter_sigma > told.worst_allowed or told.chi2_per_dof > verdict.HIGH)
    said = (
        f"{machine.name} is calibrated: nothing speaks against the fit."
        if good
        else f"{machine.name} was fitted, but the fit leaves more than noise: something may be missing."
    )
    refused = judged(fit).refusal
    rows = picked(machine, recording, 1)
    summary = [
        Items(far_row_words(far), "Rows that do not fit", "warn"),
        Items([*_figures(found, told), *mount_words(fit)], "How sure", weight=2),
    ]
    return Document(
        f"truepose: calibration of {machine.name}",
        f"{refused}." if refused else said,
        "good" if good and not refused else "warn",
        document_facts(machine.name, recording, fit),
        fit_gains(machine, told, found.pose),
        [one for one in summary if one.items],
        calibration_steps(machine, recording.files, output, calibrated=not refused, doubtful=not good),
        found.notes,
        more="see report.html",
        sections=lambda: _sections(found, told),
        scene=lambda: scene_of(fit, None, recording, []),
        rows=rows.tolist(),
    )


def document_facts(machine: str, recording: Recording, fit: Estimate) -> list[tuple[str, str]]:
    """Return what stands below the headline of a page: machine, recordings, rows."""
    rows = (
        f"{int(fit.used.sum())} fitted, {int(recording.validation.sum())} for validation, of {len(recording)}"
    )
    names = ", ".join(Path(name).name for name in recording.files)
    return [("machine", machine), ("recording", names), ("rows", rows)]


def _figures(found: Calibration, told: FitSummary) -> list[str]:
    """Return misfit, farthest parameter, directions that are seen, and the method."""
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


def _sections(found: Calibration, told: FitSummary) -> list[Section]:
    fit, recording, machine = found.fit, found.recording, found.fit.nominal
    fits = {"calibrated": fit} if found.free is None else {"free": found.free, "calibrated": fit}
    usual = {"estimator": "map", "solver": "gn"}
    options = [f"--{k} {found.method[k]}" for k, v in usual.items() if found.method.get(k, v) != v]
    return [
        residual_section(machine, recording, {"calibrated": fit}, [], picked(machine, recording, 1)),
        constants_section(fit, "calibrated.yaml", fits, told.worst_allowed),
        uncertainty_section(fit, recording, None),
        limits_section(fit, found.notes),
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
    )
