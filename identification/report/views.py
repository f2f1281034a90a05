"""Results as they show themselves in a session and in a notebook, in the words of the terminal and the report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from truepose.identification.compensation.compensate import Compensation
from truepose.identification.compensation.inverse import Inverse, Reach
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import FitSummary, summarise
from truepose.identification.identifiability.analysis import Identifiability
from truepose.identification.report import diagnosis_words, pictures
from truepose.identification.report.applied_words import applied_words
from truepose.identification.report.calibration_words import calibrated_words
from truepose.identification.report.compensation_words import error_sentence
from truepose.identification.report.identifiability_words import (
    poses_line,
    quantity,
    rank_lines,
    status_lines,
)
from truepose.identification.report.level_words import levels_words
from truepose.identification.report.notes import diagnosis_notes, worded
from truepose.identification.report.numbers import measure, percent, significant, unit_symbol
from truepose.identification.report.row_words import excluded_words
from truepose.identification.report.unseen_words import unseen_sentences
from truepose.identification.report.untestable_words import untestable_lines
from truepose.identification.report.verdict_reasons import doubts
from truepose.models.machine.machine import Machine
from truepose.shown.result import frame, view
from truepose.shown.view import View
from truepose.wording import shortened

MOST = 12


@view.register
def _(found: Estimate) -> View:
    told = summarise(found, ~found.used & False)
    rms = _rms(found.nominal, told.rms)
    title = f"Estimate of {found.nominal.name}: misfit chi2/dof {significant(found.chi2_per_dof)}, rms {rms}"
    return View(title, _fit_facts(found), *_constants(found), picture=partial(pictures.tolerances, found))


@view.register
def _(found: Calibration) -> View:
    told = summarise(found.fit, found.recording.validation)
    title, _ = calibrated_words(found.fit.nominal.name, told)
    facts = (
        f"rms: {_rms(found.fit.nominal, told.rms)}{_held_out(found.fit.nominal, told)}",
        *_fit_facts(found.fit),
        f"method: {', '.join(f'{key} {value}' for key, value in found.method.items())}",
        *(f"note: {note}" for note in found.notes),
    )
    return View(title, facts, *_constants(found.fit), picture=partial(pictures.tolerances, found.fit))


def _rms(machine: Machine, rms: Mapping[str, float]) -> str:
    units = machine.residual_units
    return ", ".join(f"{kind} {measure(value, units[kind])}" for kind, value in rms.items())


def _held_out(machine: Machine, told: FitSummary) -> str:
    if told.validation_rms is None:
        return ""
    return f"; on the validation rows {_rms(machine, told.validation_rms)}"


def _fit_facts(found: Estimate) -> tuple[str, ...]:
    rows = f"{int(found.used.sum())} rows fitted, {found.n_observations} readings"
    lost = f", {len(found.unassembled)} rows cannot be assembled" if found.unassembled else ""
    effects = [effect.label for effect in found.effects]
    return (
        f"{rows}{lost}; the readings see {found.rank} of {len(found.prior.free)} directions of the free constants",
        *([f"effects: {shortened(effects, MOST)}"] if effects else []),
    )


def _constants(found: Estimate) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...], str]:
    """Head, rows and what is beyond them: constants, the farthest from the drawing first."""
    table = frame(found)
    order = table["in_tolerances"].abs().sort_values(ascending=False, na_position="last", kind="stable").index
    rows = [
        (
            str(row["parameter"]),
            f"{row['value']:.6g}",
            f"{row['std']:.2g}",
            f"{row['nominal']:.6g}",
            unit_symbol(str(row["unit"])),
            f"{row['tolerance']:.3g}",
            "" if np.isnan(row["in_tolerances"]) else f"{row['in_tolerances']:.2f}",
        )
        for _, row in table.loc[order].iterrows()
    ]
    head = ("farthest from drawing", "value", "1-sigma", "drawing", "unit", "tolerance", "in tolerances")
    return head, tuple(rows), "to_frame() has all constants"


@view.register
def _(found: Diagnosis) -> View:
    said, _ = diagnosis_words.headline(found)
    before, after, machine = found.fits["before"], found.fits["after"], found.nominal
    gain = f"rms {_rms(machine, before.rms)}{_held_out(machine, before)}"
    if found.terms:
        gain = f"before: {gain}; after: {_rms(machine, after.rms)}{_held_out(machine, after)}"
    misfit = ", ".join(f"{name} {significant(fit.chi2_per_dof)}" for name, fit in found.fits.items())
    concealed = ["concealed: an ordinary fit would have looked good"] if found.concealed else []
    return View(
        f"Diagnosis of {machine.name}: {found.verdict}. {said}",
        facts=(
            gain,
            f"chi2 per degree of freedom: {misfit}",
            *concealed,
            *applied_words(found.applied),
            *([excluded_words(found.outlier_rows, MOST)] if found.outlier_rows else []),
            *(f"speaks against it: {text}" for text in doubts(found)),
            *(f"cannot be tested: {text}" for text in untestable_lines(found.untestable)),
            *(f"note: {text}" for text in diagnosis_notes(found)),
        ),
        head=("finding", "law", "place", "driver", "varies with", "or else"),
        rows=tuple(_finding_row(one) for one in found.findings),
        more="to_frame() has all findings, report('diagnosis.html') everything",
        picture=partial(pictures.before_and_after, found),
    )


def _finding_row(one: Finding) -> tuple[str, ...]:
    law = "" if one.nameless else percent(one.probability)
    others = str(len(one.equivalents)) if one.equivalents else ""
    name = f"{one.effect} {diagnosis_words.place_words(one.place)}".strip()
    return name, law, percent(one.levels.place), percent(one.levels.driver), one.levels.kind, others


@view.register
def _(found: Finding) -> View:
    alike = [f"{diagnosis_words.named(other)} ({percent(other.probability)})" for other in found.equivalents]
    return View(
        f"Finding {diagnosis_words.named(found)}: {diagnosis_words.explanation(found)}",
        facts=(
            levels_words(found),
            diagnosis_words.tolerance_words(found),
            *([f"could also be: {shortened(alike, 4)}"] if alike else []),
            f"what would separate it: {diagnosis_words.separating_experiment(found)}",
        ),
        head=("coefficient", "value", "1-sigma", "unit"),
        rows=tuple(
            (name, f"{q.value:.6g}", f"{q.std:.2g}", unit_symbol(q.unit))
            for name, q in found.parameters.items()
        ),
        more="to_frame() has all coefficients",
    )


@view.register
def _(found: Identifiability) -> View:
    blind = unseen_sentences(found.unseen)
    facts = [
        *rank_lines(found),
        *(f"no reading sees: {text}" for text in blind),
        *status_lines(found),
        *(f"note: {text}" for text in worded(found.notes)),
    ]
    order = sorted(found.parameters, key=lambda p: -_left(p.std, p.tolerance))
    return View(
        f"Identifiability of {poses_line(replace(found, files=tuple(Path(name).name for name in found.files)))}",
        facts=tuple(text.strip() for text in facts),
        head=("least known", "tolerance", "1-sigma to expect", "status"),
        rows=tuple((p.name, quantity(p.tolerance, p.unit), quantity(p.std, p.unit), p.status) for p in order),
        more="to_frame() has all constants",
        picture=partial(pictures.sights, found),
    )


def _left(std: float, tolerance: float) -> float:
    """What is left of a tolerance, to what is no rounding; more than anything where nothing decides."""
    return round(std / tolerance, 6) if np.isfinite(tolerance) else float(np.inf if np.isinf(std) else 0.0)


@view.register
def _(found: Compensation) -> View:
    change = np.abs(found.command - found.nominal).max(axis=0, initial=0.0)
    title = f"Compensation of {len(found.command)} rows, solved by {found.solved_by}"
    return View(
        title if not len(found.command) else f"{title}; {error_sentence(found)}",
        head=("joint", "largest correction (mm, rad)"),
        rows=tuple((name, f"{value:.4g}") for name, value in zip(found.readings, change, strict=True)),
        more="to_frame() has every row",
        picture=partial(pictures.path_errors, found),
    )


@view.register
def _(found: Inverse) -> View:
    ends = Counter(Reach(int(status)).name.lower().replace("_", " ") for status in found.status)
    told = ", ".join(f"{count} {name}" for name, count in ends.items()) or "none"
    left = [
        f"{value:.4g}" for value in (np.max(found.position, initial=0.0), np.max(found.rotation, initial=0.0))
    ]
    table = frame(found)
    return View(
        f"Inverse kinematics of {len(found.q)} poses: {told}",
        facts=(f"left to the pose at most: {left[0]} mm, {left[1]} rad; joints in mm and rad",),
        head=tuple(map(str, table.columns)),
        rows=tuple(
            tuple(value if isinstance(value, str) else f"{value:.6g}" for value in row)
            for row in table.itertuples(index=False)
        ),
        more="to_frame() has all poses",
    )
