"""Results as JSON: ``diagnosis_json`` for ``diagnosis.json``, ``fit_json`` for ``fit.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType

import numpy as np

from truepose.errors import InputError
from truepose.identification.diagnosis.null_fits import FarRow, far_rows, fringes_by_row
from truepose.identification.diagnosis.result import (
    Alarm,
    Alternative,
    Applied,
    Diagnosis,
    Finding,
    Lead,
    Levels,
    PoseError,
    Remainder,
)
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Estimate, check_estimate
from truepose.identification.fit.summary import FitSummary, Judgement, judged, judged_diagnosis, summarise
from truepose.identification.identifiability.observability import Knowledge, identifiable, unseen
from truepose.identification.recording.recording import Recording
from truepose.identification.report.experiments import IMPROVED, experiments_json
from truepose.identification.report.finding_words import explanation, form_words, separating_experiment
from truepose.identification.report.identifiability_words import meaning
from truepose.identification.report.json_text import Json, attributes, finite
from truepose.identification.report.notes import diagnosis_notes
from truepose.identification.signatures.untestable import Missing, Untestable
from truepose.models.effects.base import effects
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.machine import Machine

DIAGNOSIS_SCHEMA = "truepose/diagnosis/1"
FIT_SCHEMA = "truepose/fit/1"
_SURE = 0.999
"""Probability of rows that were left out."""
_FINE = {"mm": ("um", 1e3), "rad": ("urad", 1e6)}
"""Units that ``diagnosis.json`` gives residuals in; all others, as ``fit.json``, in their own."""


def diagnosis_json(diagnosis: Diagnosis) -> Json:
    """The content of ``diagnosis.json`` (interface, section 4)."""
    if not isinstance(diagnosis, Diagnosis):
        raise InputError(
            f"diagnosis: found {type(diagnosis).__name__}, expected a Diagnosis, as diagnose returns it"
        )
    left, proof, units = diagnosis.remainder, diagnosis.proof, diagnosis.nominal.residual_units
    out = {
        "schema": DIAGNOSIS_SCHEMA,
        "judgement": attributes(diagnosis_judgement(diagnosis), "calibrated", "why"),
        "machine": diagnosis.nominal.name,
        "files": list(diagnosis.recording.files),
        **attributes(diagnosis, "verdict", "concealed"),
        "alarms": _alarms(diagnosis.alarms),
        "alarms_after": _alarms(diagnosis.alarms_after),
        "findings": [*(finding_json(f) for f in diagnosis.findings), *outliers_json(diagnosis)],
        **_probabilities(diagnosis),
        **attributes(diagnosis, "disagreement", "budget_spent", "stopped", "noise"),
        "remainder": left and _remainder(left, units),
        "candidates": [alternative_json(c) for c in diagnosis.candidates],
        "evidence_map": dict(diagnosis.evidence_map),
        "untestable": [untestable_json(u, diagnosis.missing) for u in diagnosis.untestable],
        "fit": {name: _summary(fit, units, before=name != "free") for name, fit in diagnosis.fits.items()},
        "proof": proof
        and {**asdict(proof), "blocks": [attributes(b, "name", "rows", "ratio") for b in proof.blocks]},
        "applied": diagnosis.applied and _applied(diagnosis.applied),
        "parameters": parameters_json(diagnosis.after),
        "notes": list(diagnosis_notes(diagnosis)),
        "experiments": experiments_json(diagnosis, Path(IMPROVED)),
    }
    return dict(finite(out))


def diagnosis_summary(diagnosis: Diagnosis, command: str, files: Sequence[str]) -> Json:
    """What ``--json`` prints of a diagnosis: its document's main parts, and the files."""
    improved = Path(next((name for name in files if name.endswith(IMPROVED)), IMPROVED))
    whole = {**diagnosis_json(diagnosis), "experiments": experiments_json(diagnosis, improved)}
    main = (
        "judgement", "verdict", "concealed", "alarms", "findings", "leading", "sets", "remainder", "untestable", "fit",
        "proof", "applied", "experiments",
    )  # fmt: skip
    return {"command": command, **{key: whole[key] for key in main}, "files": list(files)}


def _probabilities(diagnosis: Diagnosis) -> Json:
    """How likely effects are: the leading ones, sets of them, places of one driver together, each one alone."""
    return {
        "leading": [
            attributes(one, "effect", "place", "probability")
            | {"levels": levels_json(one.levels, law_of(one))}
            for one in diagnosis.leading
        ],
        "sets": [asdict(one) for one in diagnosis.sets],
        "together": [asdict(one) for one in diagnosis.together],
        "inclusion": [attributes(one, "effect", "place", "probability") for one in diagnosis.inclusion],
    }


def fit_json(
    fit: Estimate,
    recording: Recording,
    free: Estimate | None = None,
    *,
    notes: Sequence[str] = (),
    method: Mapping[str, str] | None = None,
    far: Sequence[FarRow] = (),
) -> Json:
    """The content of ``fit.json``: lengths in mm, angles in rad.

    ``free``: tolerances hardly hold it; ``far``: rows that do not fit.
    """
    check_estimate(fit)
    out = {
        "schema": FIT_SCHEMA,
        "judgement": attributes(judged(fit), "calibrated", "why"),
        "machine": fit.nominal.name,
        "method": dict(method or {}),
        "files": list(recording.files),
        **_figures(fit, recording),
        "rows_that_do_not_fit": [asdict(one) for one in far],
        "unseen": [{"parts": dict(d.parts), "meaning": meaning(d)} for d in unseen(Knowledge.of(fit))],
        "parameters": parameters_json(fit),
        "effects": [_effect(fit, k) for k in range(len(fit.effects))],
        "free": free and _figures(free, recording),
        "notes": list(notes),
    }
    return dict(finite(out))


def calibration_json(found: Calibration, far: Sequence[FarRow] | None = None) -> Json:
    """The same of a whole calibration; ``far``: rows that do not fit, by default those of the fit."""
    far = far_rows(found) if far is None else far
    return fit_json(found.fit, found.recording, found.free, notes=found.notes, method=found.method, far=far)


def parameters_json(fit: Estimate) -> Json:
    """Every free parameter of the machine: value, std, nominal (mm, rad), unit, tolerance, identifiable."""
    seen, std, drawing = identifiable(fit), fit.std, drawing_of(fit.nominal)
    open_ended = unbounded(fit)
    return {
        p.name: {
            "value": float(fit.p[k]),
            "std": None if p.name in open_ended else float(std[k]),
            "nominal": drawing.get(p.name, p.nominal),
            "unit": p.unit,
            "tolerance": p.tolerance,
            "identifiable": seen[p.name],
        }
        for k, p in enumerate(fit.nominal.parameters)
        if fit.prior.sigma[k] > 0
    }


def drawing_of(machine: Machine) -> Mapping[str, float]:
    """Drawing values (mm, rad) by parameter, where a calibrated file has them."""
    return machine.file.nominal if machine.file else {}


def unbounded(fit: Estimate) -> set[str]:
    """Parameters that neither readings nor tolerances hold: their 1-sigma is infinite."""
    std, free = fit.std, fit.prior.free
    return {fit.prior.names[k] for k in free if std[k] > 1e9 * fit.prior.scale[k]}


def _figures(fit: Estimate, recording: Recording) -> Json:
    told, units = summarise(fit, recording.validation), fit.nominal.residual_units
    return {
        "status": fit.solution.status.name.lower(),
        "message": fit.solution.status.value,
        "iterations": fit.solution.iterations,
        "rows": int(fit.used.sum()),
        "rows_left_out": [recording.where(k) for k in fit.unassembled],
        "readings": fit.n_observations,
        **attributes(fit, "effective_parameters", "chi2", "chi2_per_dof"),
        "rms": _rms(told.rms, units),
        "validation_rms": _rms(told.validation_rms, units),
        "free_parameters": len(fit.prior.free),
        "rank": fit.rank,
        **_worst(told),
    }


def _effect(fit: Estimate, k: int) -> Json:
    effect = fit.fitted_effects()[k]
    std = dict(zip(fit.prior.names, fit.std.tolist(), strict=True))
    parameters = {
        c.name: {"value": effect.values[c.name], "std": std[f"{effect.label}:{c.name}"], "unit": c.unit}
        for c in effect.coefficients
    }
    return {
        "effect": effect.effect.slug,
        "place": list(effect.place),
        "settings": dict(effect.settings),
        "parameters": parameters,
    }


def _remainder(left: Remainder, units: Mapping[str, str]) -> Json:
    """``gain``: by how much modelling it lowers the rms of held-out rows, null where that is not known."""
    return {
        "place": list(left.place),
        "driver": left.driver,
        "form": form_words(left),
        "size_sigma": left.size_sigma,
        "gain": _rms(left.gain or None, units),
    }


def _alarms(alarms: Mapping[str, Alarm]) -> Json:
    return {name: attributes(alarm, "statistic", "p", "raised", "about") for name, alarm in alarms.items()}


def _applied(applied: Applied) -> Json:
    """Which model ``improved.yaml`` holds, and its errors on held-out rows beside plain calibration's."""

    def pose(error: PoseError | None) -> Json | None:
        return None if error is None else {**asdict(error), "unit": "mm"}

    return {
        "model": applied.model,
        "held_out": applied.held_out,
        "pose": pose(applied.pose),
        "readings_ratio": applied.ratio,
        "baselines": {**applied.baselines, "unit": "mm"} if applied.baselines else None,
        "all_that_was_found": {"pose": pose(applied.whole_pose), "readings_ratio": applied.whole_ratio},
    }


def _summary(fit: FitSummary, units: Mapping[str, str], *, before: bool) -> Json:
    return {
        "rms": _rms(fit.rms, units, _FINE),
        "chi2_per_dof": fit.chi2_per_dof,
        "validation_rms": _rms(fit.validation_rms, units, _FINE),
        **(_worst(fit) if before else {}),
    }


def _worst(fit: FitSummary) -> Json:
    return {
        "worst_parameter_sigma": fit.worst_parameter_sigma,
        "worst_parameter": fit.worst_parameter,
        "worst_parameter_allowed": fit.worst_allowed,
    }


def _rms(
    rms: Mapping[str, float] | None,
    units: Mapping[str, str],
    shown: Mapping[str, tuple[str, float]] = MappingProxyType({}),
) -> Json | None:
    if rms is None:
        return None
    scaled = {kind: (value, *shown.get(units[kind], (units[kind], 1.0))) for kind, value in rms.items()}
    return {kind: {"value": factor * value, "unit": unit} for kind, (value, unit, factor) in scaled.items()}


def diagnosis_judgement(diagnosis: Diagnosis) -> Judgement:
    """The judgement of the model that a diagnosis ends with."""
    named = any(not finding.nameless for finding in diagnosis.findings)
    return judged_diagnosis(diagnosis.before, diagnosis.after, named=named)


def finding_json(finding: Finding) -> Json:
    """What was found at a place, with its rivals and how it was judged."""
    halves = finding.replication
    return {
        **attributes(finding, "effect", "place", "probability", "certainty", "log_bayes_factor"),
        "equivalents": [alternative_json(a) for a in finding.equivalents],
        "parameters": {name: asdict(q) for name, q in finding.parameters.items()},
        "settings": [dict(s) for s in finding.settings],
        "levels": levels_json(finding.levels, law_of(finding)),
        "law_tested": finding.tested,
        **attributes(finding, "prior_dependent", "flip_lambda"),
        "family": finding.family or None,
        "replication": halves and attributes(halves, "halves", "agree"),
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
    evidence = 0.5 * float(np.sum(far[far != 0.0] - 1.0))  # a lost reading says nothing
    told = effect.explain(diagnosis.nominal, place, {}) + more
    levels = Levels(_SURE, "sensor", _SURE)
    return finding_json(
        Finding(
            effect=slug,
            place=place,
            probability=_SURE,
            certainty=_SURE,
            log_bayes_factor=evidence,
            equivalents=(),
            parameters={},
            settings=(),
            flip_lambda=None,
            explanation=told,
            experiment=effect.experiment,
            levels=levels,
            tested=False,
        )
    )


def alternative_json(other: Alternative) -> Json:
    """Another explanation of the same readings."""
    out = attributes(other, "effect", "place", "probability", "log_bayes_factor")
    return out if other.tested else out | {"tested": False}


def untestable_json(one: Untestable, missing: Sequence[Missing]) -> Json:
    """Why an effect could not be tested, and what to ``add`` where a line or a column would change that."""
    add = next((m.add for m in missing if one.effect in m.effects), None)
    return {"effect": one.effect, "why": one.why} | ({} if add is None else {"add": add})
