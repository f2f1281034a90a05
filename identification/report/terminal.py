"""Results for a terminal, at most 25 lines of 110 columns, and in brief for ``--json``.

What is told stands in the order of its weight: the verdict, before and after in the sensor's unit, what was found, what
speaks against it, what could not be tested, what to do next. Where there is more than fits, the last line of a part counts it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from truepose.identification.diagnosis.result import Alternative, Diagnosis, Finding
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.report.applied_words import applied_words
from truepose.identification.report.before_after import HELD_OUT, before_after_words, rms_words
from truepose.identification.report.coefficient_words import coefficient_words
from truepose.identification.report.diagnosis_words import LEADS, form_words, set_words
from truepose.identification.report.judgement_words import diagnosis_judgement
from truepose.identification.report.level_words import (
    driver_clauses,
    known_words,
    lead_words,
    level_of,
    together_words,
)
from truepose.identification.report.lines import LINES, listed, several_lines, wrapped
from truepose.identification.report.misfit_words import HIGH as SUSPICIOUS
from truepose.identification.report.misfit_words import misfit_clause
from truepose.identification.report.mount_words import mount_words
from truepose.identification.report.next_steps import after_calibration, after_diagnosis
from truepose.identification.report.numbers import measure, percent
from truepose.identification.report.results import diagnosis_json
from truepose.identification.report.row_words import excluded_words, far_row_words
from truepose.identification.report.untestable_words import missing_words
from truepose.identification.report.verdict_reasons import doubts
from truepose.models.file.machine_file import ExpectedPose
from truepose.wording import shortened

PLACES, ROWS, RIVALS, SETS = 6, 12, 4, 3
"""Most places of a finding, rows, rivals and sets of effects that are named."""
TIGHT = (2, 1)
ROOM = ((8, 2), (4, 2), (4, 1), TIGHT)
"""Most lines of a part that is no finding (doubts, what could not be tested), and of each of its sentences: the first that
lets everything stand on a screen."""
_VERDICTS = {
    "adequate": "the model is adequate",
    "missing-physics": "physics is missing",
    "unknown": "something is missing; neither its place nor its driver is known",
}


def diagnosis_summary(result: Diagnosis, command: str, files: list[str]) -> dict[str, object]:
    """What ``--json`` prints of a diagnosis: its document's main parts, and the files."""
    whole = diagnosis_json(result)
    main = (
        "judgement", "verdict", "concealed", "alarms", "findings", "leading", "sets", "remainder", "untestable", "fit",
        "proof", "applied",
    )  # fmt: skip
    kept = {key: whole[key] for key in main}
    return {"command": command, **kept, "files": files}


def diagnosis_lines(
    result: Diagnosis, output: Path, most: int = LINES, *, checked: bool = False
) -> list[str]:
    """Verdict, before and after, findings, what speaks against them, what could not be tested, what to do next.

    ``checked``: whether ``check`` has looked at the files.
    """
    judgement = diagnosis_judgement(result)
    head = [*_verdict(result, judgement.refusal), *_worth(result)]
    steps = after_diagnosis(result, output, calibrated=judgement.calibrated, checked=checked)
    end = [*steps, f"report: {output / 'report.html'}"]
    for room in ROOM:
        foot = [*_beside(result, *room), *end]
        items = _found(result, room == TIGHT)
        if len(head) + sum(map(len, items)) + len(foot) <= most:
            break
    return [*head, *listed(items, most - len(head) - len(foot)), *foot]


def _verdict(result: Diagnosis, refused: str) -> list[str]:
    hidden = ", though the ordinary fit looked good" if result.concealed else ""
    said = f"{result.nominal.name}: {_VERDICTS[result.verdict]}{hidden}{misfit_clause(result)}"
    return wrapped(f"{refused} ({said})" if refused else said, indent=0, most=3 if refused else 2)


def _worth(result: Diagnosis) -> list[str]:
    """Before and after, and what it is worth to the tool."""
    readings = [line for text in before_after_words(result) for line in wrapped(text, most=2)]
    told = [*applied_words(result.applied), *mount_words(result.after)]
    return [*readings, *(line for text in told for line in wrapped(text))]


def _found(result: Diagnosis, tight: bool) -> list[list[str]]:
    """Findings with a name, those without, what leads, and the remainder: some lines each."""
    items = [_finding(f, tight) for f in result.findings if not f.nameless]
    nameless = [finding for finding in result.findings if finding.nameless]
    items += [wrapped(f"without a name: {said}") for said in driver_clauses(nameless)]
    if result.leading and not result.findings:
        items += [wrapped(f"leading: {lead_words(one)}", most=1) for one in result.leading[:LEADS]]
    items += [wrapped(f"together: {together_words(one)}", most=2) for one in result.together]
    left = result.remainder
    if left is not None:
        items.append(wrapped(f"remainder follows {left.driver}: {form_words(left)}"))
    return items


def _finding(finding: Finding, tight: bool) -> list[str]:
    """One or two lines of what it is; how sure the parts are, what was fitted, and its rivals."""
    if level_of(finding) == "law" or not finding.levels.driver:
        who = f"{finding.effect} at {shortened(finding.place, PLACES)}, {percent(finding.probability)}"
    else:
        known, sure = known_words(finding)
        who = f"{known} ({sure}); fitted as {finding.effect}"
    out = wrapped(f"{who}: {finding.explanation}", most=1 if tight else 2)
    sized = coefficient_words(finding.parameters)
    if sized:
        out += wrapped(sized, 4, most=1)
    rivals = list(dict.fromkeys(_alternative(e) for e in finding.equivalents))
    if rivals and not tight:
        out += wrapped(f"could also be: {'; '.join(rivals[:RIVALS])}", 4, most=1)
    return out


def _beside(result: Diagnosis, most: int, each: int) -> list[str]:
    """What speaks against it, other sets, what could not be tested, rows left out."""
    out = several_lines(doubts(result), "against it", most, each)
    if result.sets and (most, each) != TIGHT:
        told = [f"{set_words(s.effects)} ({percent(s.probability)})" for s in result.sets[:SETS]]
        out += wrapped(f"likeliest sets: {' | '.join(told)}")
    out += several_lines(missing_words(result.missing), "could not be tested", most, 2)
    if result.outlier_rows:
        out += wrapped(excluded_words(result.outlier_rows, ROWS), most=1)
    fits = ", ".join(f"{name} {fit.chi2_per_dof:.3g}" for name, fit in result.fits.items())
    return [*out, f"  chi2 per degree of freedom: {fits}"]


def _alternative(other: Alternative) -> str:
    if other.nameless:
        return "something without a name"
    return f"{other.effect} at {shortened(other.place, PLACES)}"


def calibration_lines(
    result: Calibration, figures: Mapping[str, Any], output: Path, pose: ExpectedPose | None = None
) -> list[str]:
    """``figures`` of ``fit.json``, before and after, what tolerances decided, rows that do not fit, what to do next.

    ``pose``: what the fit is worth to the tool, where that was judged.
    """
    fit, refused = result.fit, result.judgement.refusal
    flat = result.method["estimator"] in ("ols", "liu", "ridge", "pcr")
    held = "the others stay at the drawing" if flat else "tolerances decide the others"
    decided = f"; {held}" if fit.rank < len(fit.prior.free) else ""
    worst = f"{figures['worst_parameter']}, {fit.worst_parameter_sigma:.3g} tolerances"
    said = f"{fit.nominal.name}: converged in {fit.solution.iterations} iterations"
    lines = [
        *wrapped(f"{refused} ({said})" if refused else said, indent=0, most=3),
        *(line for text in far_row_words(figures["rows_that_do_not_fit"]) for line in wrapped(text)),
        *_before_after(figures, pose),
        *(line for text in mount_words(fit) for line in wrapped(text)),
        f"  chi2 per degree of freedom {fit.chi2_per_dof:.4g}",
        f"  {fit.rank} of {len(fit.prior.free)} directions are seen by the readings{decided}",
        f"  held as the machine file has it: all but {result.only}"
        if result.only
        else f"  furthest from the drawing: {worst}",
    ]
    worst_allowed = figures["worst_parameter_allowed"] or float("inf")
    doubtful = fit.chi2_per_dof > SUSPICIOUS or fit.worst_parameter_sigma > worst_allowed
    steps = after_calibration(fit.nominal, output, calibrated=not refused, doubtful=doubtful)
    return [*lines, *steps, f"calibrated machine: {output / 'calibrated.yaml'}"]


def _before_after(figures: Mapping[str, Any], pose: ExpectedPose | None) -> list[str]:
    rms, where = figures["validation_rms"], HELD_OUT
    if rms is None:
        rms, where = figures["rms"], "on the fitted rows"
    out = rms_words({k: v["value"] for k, v in rms.items()}, {k: v["unit"] for k, v in rms.items()}, where)
    if pose is not None:
        told = f"{measure(pose.before, 'mm')} before ({pose.than}), {measure(pose.after, 'mm')} after"
        out.append(f"the tool's position: {told}, on {pose.rows}, after a rigid refit")
    return [line for text in out for line in wrapped(text)]


__all__ = ["calibration_lines", "diagnosis_lines", "diagnosis_summary"]
