"""Results in a few plain lines for a terminal, and in brief for ``--json``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from truepose.identification.diagnosis.result import Alternative, Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.report.applied_words import applied_words
from truepose.identification.report.diagnosis_words import LEADS, explanation, form_words, set_words
from truepose.identification.report.level_words import driver_clauses, lead_words, level_of, levels_words
from truepose.identification.report.misfit_words import misfit_clause
from truepose.identification.report.results import diagnosis_json
from truepose.identification.report.untestable_words import untestable_lines
from truepose.identification.report.verdict_reasons import doubts

SHOWN, SETS = 6, 3


def diagnosis_summary(result: Diagnosis, command: str, files: list[str]) -> dict[str, object]:
    """What ``--json`` prints of a diagnosis: its document's main parts, and the files."""
    whole = diagnosis_json(result)
    kept = {
        key: whole[key]
        for key in (
            "verdict",
            "concealed",
            "alarms",
            "findings",
            "leading",
            "sets",
            "remainder",
            "fit",
            "proof",
            "applied",
        )
    }
    return {"command": command, **kept, "files": files}


def diagnosis_lines(result: Diagnosis, output: Path) -> list[str]:
    """A few plain lines: verdict, findings, fits, where the report is."""
    words = {
        "adequate": "the model is adequate",
        "missing-physics": "physics is missing",
        "unknown": "something is missing; neither its place nor its driver is known",
    }
    hidden = ", though the ordinary fit looked good" if result.concealed else ""
    lines = [f"{result.machine.name}: {words[result.verdict]}{hidden}{misfit_clause(result)}"]
    lines += [f"  {said}" for said in applied_words(result.applied)]
    nameless = [finding for finding in result.findings if finding.nameless]
    for finding in (f for f in result.findings if not f.nameless):
        who = f"{finding.effect} at {', '.join(finding.place)}"
        lines.append(f"  {who} (probability {_percent(finding.probability)}): {explanation(finding)}")
        if level_of(finding) != "law" and finding.levels.driver:
            lines.append(f"    {levels_words(finding)}")
        shown = list(finding.parameters.items())
        for name, q in shown[:SHOWN]:
            unit = "" if q.unit == "1" else f" {q.unit}"
            lines.append(f"    {name} = {q.value:.4g} +- {q.std:.2g}{unit}")
        if len(shown) > SHOWN:
            lines.append(f"    and {len(shown) - SHOWN} more in diagnosis.json")
        if finding.equivalents:
            lines.append("    could also be: " + "; ".join(_alternative(e) for e in finding.equivalents[:4]))
    lines += [f"  without a name: {said}" for said in driver_clauses(nameless)]
    if result.leading and not result.findings:
        lines += [f"  leading: {lead_words(one)}" for one in result.leading[:LEADS]]
    if result.remainder is not None:
        lines.append(f"  remainder follows {result.remainder.driver}: {form_words(result.remainder)}")
    lines += [f"  speaks against it: {said}" for said in doubts(result)]
    if result.sets:
        told = [f"{set_words(s.effects)} ({_percent(s.probability)})" for s in result.sets[:SETS]]
        lines.append(f"  likeliest sets: {' | '.join(told)}")
    lines += [f"  cannot be tested: {said}" for said in untestable_lines(result.untestable)]
    if result.outlier_rows:
        lines.append(f"  rows left out as outliers: {', '.join(map(str, result.outlier_rows))}")
    fits = ", ".join(f"{name} {fit.chi2_per_dof:.3g}" for name, fit in result.fits.items())
    return [*lines, f"  chi2 per degree of freedom: {fits}", f"report: {output / 'report.html'}"]


def _alternative(other: Alternative) -> str:
    if other.nameless:
        return "something without a name"
    return f"{other.effect} at {', '.join(other.place)}"


def _percent(probability: float) -> str:
    return "> 99.9 %" if probability > 0.999 else f"{100 * probability:.1f} %"


def calibration_lines(result: Calibration, figures: Mapping[str, Any], output: Path) -> list[str]:
    """A few plain lines: ``figures`` of ``fit.json``, what tolerances decided, where the machine file is."""
    fit = result.fit
    seen = f"{fit.rank} of {len(fit.prior.free)} directions"
    rms = ", ".join(f"{kind} {v['value']:.4g} {v['unit']}" for kind, v in figures["rms"].items())
    flat = result.method["estimator"] in ("ols", "liu", "ridge", "pcr")
    held = "the others stay at the drawing" if flat else "tolerances decide the others"
    decided = f"; {held}" if fit.rank < len(fit.prior.free) else ""
    worst = f"{figures['worst_parameter']}, {fit.worst_parameter_sigma:.3g} tolerances"
    lines = [
        f"{fit.machine.name}: converged in {fit.solution.iterations} iterations",
        f"  chi2 per degree of freedom {fit.chi2_per_dof:.4g}; rms: {rms}",
        f"  {seen} are seen by the readings" + decided,
        f"  furthest from the drawing: {worst}",
    ]
    return [*lines, f"calibrated machine: {output / 'calibrated.yaml'}"]
