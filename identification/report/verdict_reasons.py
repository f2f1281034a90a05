"""Why the verdict is what it is, and what speaks against it, in plain sentences."""

from __future__ import annotations

from truepose.identification.diagnosis.result import NOTABLE, Diagnosis, Proof
from truepose.identification.posterior.posterior import AGREED
from truepose.identification.report.diagnosis_words import (
    against_words,
    alarm_name,
    named,
    several,
    told,
)
from truepose.identification.report.misfit_words import misfit_clause
from truepose.identification.report.numbers import known, p_value, percent, significant, times
from truepose.models.effects.common import OF_ROWS
from truepose.wording import joined


def reasons(diagnosis: Diagnosis) -> list[str]:
    """Why the verdict is what it is, strongest first."""
    before, after = diagnosis.fits["before"], diagnosis.fits["after"]
    if diagnosis.verdict == "adequate":
        return _reasons_adequate(diagnosis)
    out = []
    if diagnosis.findings:
        best = max(diagnosis.findings, key=lambda f: f.log_bayes_factor)
        out.append(
            f"The readings are {times(best.log_bayes_factor)} likelier with {told(best)}"
            f" than without it, geometry free to move within its tolerances in both"
            f" cases (log Bayes factor {significant(best.log_bayes_factor)})."
        )
    if diagnosis.terms:
        out.append(
            f"With parameters held to their tolerances, misfit chi2/dof is {significant(before.chi2_per_dof)}"
            f" without effects and {significant(after.chi2_per_dof)} with them; 1 is noise alone."
        )
        out.append(_worst(diagnosis))
    out += _noise(diagnosis)
    out += _held_out(diagnosis)
    raised = [name for name, alarm in diagnosis.alarms.items() if alarm.raised]
    if raised:
        out.append(
            "Alarms that a true model raises once in a hundred recordings:"
            f" {joined([alarm_name(n) for n in raised])}."
        )
    return out


def _reasons_adequate(diagnosis: Diagnosis) -> list[str]:
    before = diagnosis.fits["before"]
    quiet = [alarm_name(name) for name, alarm in diagnosis.alarms.items() if not alarm.raised]
    out = [
        f"With parameters held to their tolerances, misfit chi2/dof is {significant(before.chi2_per_dof)}; 1"
        " is noise alone."
    ]
    out += _noise(diagnosis)
    if quiet:
        out.append(f"Quiet: {joined(quiet)}.")
    best = max(
        (c for c in diagnosis.candidates if c.effect not in OF_ROWS),
        key=lambda c: c.log_bayes_factor,
        default=None,
    )
    if best is not None:
        out.append(
            f"The best of {several(len(diagnosis.candidates), 'explanation')} weighed, {named(best)}, reaches"
            f" a log Bayes factor of {significant(best.log_bayes_factor)}: after its share of prior"
            " probability, too little for a name."
        )
    return out


def _noise(diagnosis: Diagnosis) -> list[str]:
    """How large the noise is, where the misfit does not go without saying."""
    if not misfit_clause(diagnosis):
        return []
    return [f"Beside all effects, noise of {significant(diagnosis.noise)} stated sigmas is likeliest."]


def _worst(diagnosis: Diagnosis) -> str:
    before, after = diagnosis.fits["before"], diagnosis.fits["after"]
    if not known(after.worst_allowed):
        return "No parameter has a finite tolerance, so none can be judged against its drawing."
    back = after.worst_parameter_sigma <= after.worst_allowed
    where = (
        "back within"
        if back and before.worst_parameter_sigma > before.worst_allowed
        else "within"
        if back
        else "still above"
    )
    return (
        f"Without effects the readings push {before.worst_parameter}"
        f" {significant(before.worst_parameter_sigma)} tolerances from its drawing; with them the farthest is"
        f" {after.worst_parameter} at {significant(after.worst_parameter_sigma)}, {where} the"
        f" {significant(after.worst_allowed)} that a true model keeps to in 99 of 100 cases."
    )


def _held_out(diagnosis: Diagnosis) -> list[str]:
    proof = diagnosis.proof
    if proof is None:
        return []
    low, high = proof.ratio_interval
    what = (
        "the recording's validation rows"
        if proof.held_out == "role"
        else f"rows held out in turn ({proof.held_out})"
    )
    gain = "" if high < 1.0 else " That is no certain gain"
    return [
        f"On {what}, never fitted, rms falls to {significant(proof.ratio)} of what it was "
        f"(95 % interval {significant(low)} to {significant(high)}).{gain + '.' if gain else ''}"
    ]


OWN_TOLERANCE = 1.0
"""Tolerances from its drawing within which no constant speaks against a model, however little the readings move it."""
_ENDED = "; they ended with their budget of work, before they were as long as usual"


def doubts(diagnosis: Diagnosis) -> list[str]:
    """What speaks against the findings, said plainly."""
    out = []
    after, proof = diagnosis.fits["after"], diagnosis.proof
    if diagnosis.terms and after.worst_parameter_sigma > max(after.worst_allowed, OWN_TOLERANCE):
        out.append(
            f"{after.worst_parameter} still stands {significant(after.worst_parameter_sigma)} tolerances from"
            f" its drawing, beyond the {significant(after.worst_allowed)} that a true model allows."
        )
    out += [
        f"No amplitude of {named(f)} is twice its own uncertainty: the readings want the effect, not any one"
        " of its coefficients."
        for f in diagnosis.findings
        if f.parameters and not any(abs(q.value) > 2.0 * q.std for q in f.parameters.values())
    ]
    out += [f"{named(f)}: {said}" for f in diagnosis.findings for said in against_words(f)]
    if diagnosis.disagreement > AGREED:
        out.append(
            f"Probabilities are known to {percent(diagnosis.disagreement)} only: so far do the chains differ that"
            f" they were drawn from{_ENDED if diagnosis.budget_spent else ''}."
        )
    if diagnosis.findings and diagnosis.structure.raised:
        out.append(
            f"Residuals still follow {_driver(diagnosis.structure.about)} (p ="
            f" {p_value(diagnosis.structure.p)}; {percent(diagnosis.structure.share)} of them):"
            " something smaller is left."
        )
    if proof is not None:
        out += _worse_blocks(proof)
        out += _proof_doubts(
            proof.ratio,
            proof.ratio_interval[1],
            proof.placebo_gain,
            proof.black_box_ratio,
            proof.injected_recovered,
        )
    return out


def _driver(name: str) -> str:
    return "the order of rows" if name == "order" else name


def _worse_blocks(proof: Proof) -> list[str]:
    """Rows held out together on which the model found does worse than the one without effects."""
    return [
        f"Held out, the {b.name} ({several(b.rows, 'row')}) get worse: rms rises to {significant(b.ratio)} of what"
        " it was."
        for b in proof.blocks
        if known(b.ratio) and b.ratio > 1.0
    ]


def _proof_doubts(
    ratio: float, high: float, placebo: float | None, box: float | None, injected: bool | None
) -> list[str]:
    out = []
    if known(high) and high >= 1.0:
        out.append("Held-out rows show no certain gain.")
    if placebo is not None and placebo > NOTABLE:
        out.append(
            f"A placebo (the same effect with shuffled drivers) gains {significant(placebo)} too, which"
            " chance should not give."
        )
    if box is not None and known(box) and box <= ratio:
        out.append(f"An equally flexible black box does as well on held-out rows ({significant(box)}).")
    if injected is False:
        out.append(
            "The effect, put into simulated readings at the size found here, was not recognised first of all."
        )
    return out
