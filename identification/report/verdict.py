"""The verdict of a diagnosis in sentences: what it is, why, what speaks against it, and what could not be tested."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from truepose.identification.diagnosis.result import NOTABLE, Diagnosis, Proof
from truepose.identification.fit.standing_out import FAR, Left, column_words, row_words
from truepose.identification.posterior.posterior import AGREED
from truepose.identification.report.experiments import what_would_tell
from truepose.identification.report.finding_words import against_words, fault_words, follows, lead_words
from truepose.identification.report.phrases import (
    known,
    named,
    p_value,
    percent,
    several,
    significant,
    times,
    told,
)
from truepose.identification.signatures.untestable import Missing, Untestable
from truepose.models.effects.common import OF_ROWS
from truepose.shown.document import Tone
from truepose.wording import joined

LEADS = 3
"""Most of what leads that the headline names."""
HIGH, LOW = 1.3, 0.77
"""chi2 per degree of freedom beyond which it is said: far from 1."""
ALIKE = 1.25
"""Factor within which the square of the noise that was found is the misfit."""
OWN_TOLERANCE = 1.0
"""Tolerances from its drawing within which no constant speaks against a model, however little the readings move it."""
NOTHING = ("the recording holds one session only", "nothing to vary")
"""Reasons why an effect cannot be tested where nothing is amiss."""
ALARMS = {
    "residual": "lack of fit",
    "prior_conflict": "conflict with tolerances",
    "structure": "structure in residuals",
}


def headline(diagnosis: Diagnosis) -> tuple[str, Tone]:
    """The verdict in one sentence, and its tone."""
    model = f"The model of {diagnosis.nominal.name}"
    misfit = misfit_clause(diagnosis)
    hidden = " The ordinary fit looked good." if diagnosis.concealed else ""
    if diagnosis.verdict == "missing-physics" and diagnosis.findings:
        experiment = what_would_tell(diagnosis.findings)
        return f"{model} {fault_words(diagnosis.findings)}{misfit}.{hidden}{experiment}", "warn"
    if diagnosis.verdict == "unknown":
        left, leads = diagnosis.remainder, diagnosis.leading[:LEADS]
        where = f" What is left seems to {follows(left)}." if left is not None else ""
        first = f" Leading: {'; '.join(map(lead_words, leads))}." if leads else ""
        said = f"{model} lacks something whose place and driver are not known{misfit}.{where}{first}{hidden}"
        return said, "warn"
    beside = [named(f) for f in diagnosis.findings]
    rest = f" Apart from {joined(beside)}, these" if beside else " These"
    return f"{model} is adequate{misfit}.{rest} readings show nothing that it leaves out.", "good"


def misfit_clause(diagnosis: Diagnosis) -> str:
    """A misfit far from noise alone: how large, and whether it speaks for a misstated sigma or something missing."""
    chi2 = diagnosis.fits["after"].chi2_per_dof
    if not known(chi2) or LOW <= chi2 <= HIGH:
        return ""
    size = significant(chi2**0.5, 2)
    if chi2 < LOW:
        reason = (
            f"a stated sigma that is too large (residuals are {size} of it), or readings that were averaged"
        )
    elif diagnosis.verdict == "unknown" or not 1.0 / ALIKE < chi2 / diagnosis.noise**2 < ALIKE:
        reason = "something missing: noise does not explain it"
    elif diagnosis.findings:
        reason = (
            f"a stated sigma that is too small ({size} times), or for something smaller beside what is named"
        )
    else:
        reason = f"a stated sigma that is too small ({size} times): noise of that size explains it, and no effect does"
    return f", with chi2 per degree of freedom {significant(chi2)}, which speaks for {reason}"


def concealed_words(diagnosis: Diagnosis) -> str:
    """That an ordinary fit would have looked good, and where the missing physics went."""
    free = diagnosis.fits["free"]
    return (
        f"Concealed: an ordinary fit would have looked good (chi2/dof {significant(free.chi2_per_dof)}), because its free"
        f" constants swallowed what is missing: {free.worst_parameter} left its drawing by"
        f" {significant(free.worst_parameter_sigma)} tolerances."
    )


def reasons(diagnosis: Diagnosis) -> list[str]:
    """Why the verdict is what it is, strongest first."""
    before, after = diagnosis.fits["before"], diagnosis.fits["after"]
    adequate, out = diagnosis.verdict == "adequate", []
    if diagnosis.findings and not adequate:
        best = max(diagnosis.findings, key=lambda f: f.log_bayes_factor)
        out.append(
            f"The readings are {times(best.log_bayes_factor)} likelier with {told(best)} than without it, geometry free within"
            f" its tolerances in both cases (log Bayes factor {significant(best.log_bayes_factor)})."
        )
    ended = f" without effects and {significant(after.chi2_per_dof)} with them" if diagnosis.terms else ""
    if adequate or diagnosis.terms:
        out.append(
            "With parameters held to their tolerances, misfit chi2/dof is"
            f" {significant(before.chi2_per_dof)}{'' if adequate else ended}; 1 is noise alone."
        )
    if diagnosis.terms and not adequate:
        out.append(_worst(diagnosis))
    if misfit_clause(diagnosis):
        out.append(f"Beside all effects, noise of {significant(diagnosis.noise)} stated sigmas is likeliest.")
    if diagnosis.proof is not None and not adequate:
        out.append(_held_out(diagnosis.proof))
    out += _alarm_words(diagnosis, adequate=adequate)
    return [*out, *(_best_candidate(diagnosis) if adequate else [])]


def _alarm_words(diagnosis: Diagnosis, *, adequate: bool) -> list[str]:
    """Return which alarms are raised; of an adequate model which are not, and what explains the others."""
    raised = [ALARMS[name] for name, alarm in diagnosis.alarms.items() if alarm.raised]
    quiet = [ALARMS[name] for name, alarm in diagnosis.alarms.items() if not alarm.raised]
    if not adequate:
        lead = "Alarms that a true model raises once in a hundred recordings"
        return [f"{lead}: {joined(raised)}."] if raised else []
    out = [f"Quiet: {joined(quiet)}."] if quiet else []
    if raised:
        wide = max(diagnosis.inflation.values(), default=1.0)
        out.append(
            f"Raised: {joined(raised)}; but no explanation is likelier than none: noise of"
            f" {significant(diagnosis.noise, 2)} and tolerances of {significant(wide, 2)} times the stated explain it."
        )
    return out


def _best_candidate(diagnosis: Diagnosis) -> list[str]:
    candidates = [c for c in diagnosis.candidates if c.effect not in OF_ROWS]
    if not candidates:
        return []
    best = max(candidates, key=lambda c: c.log_bayes_factor)
    return [
        f"The best of {several(len(diagnosis.candidates), 'explanation')} weighed, {named(best)}, reaches a log Bayes factor of"
        f" {significant(best.log_bayes_factor)}: after its share of prior probability, too little for a name."
    ]


def _worst(diagnosis: Diagnosis) -> str:
    before, after = diagnosis.fits["before"], diagnosis.fits["after"]
    if not known(after.worst_allowed):
        return "No parameter has a finite tolerance, so none can be judged against its drawing."
    where = "within" if after.worst_parameter_sigma <= after.worst_allowed else "still above"
    return (
        f"Without effects the readings push {before.worst_parameter} {significant(before.worst_parameter_sigma)} tolerances"
        f" from its drawing; with them the farthest is {after.worst_parameter} at {significant(after.worst_parameter_sigma)},"
        f" {where} the {significant(after.worst_allowed)} that a true model keeps to in 99 of 100 cases."
    )


def _held_out(proof: Proof) -> str:
    low, high = proof.ratio_interval
    what = "the validation rows" if proof.held_out == "role" else f"rows held out in turn ({proof.held_out})"
    return (
        f"On {what}, never fitted, rms falls to {significant(proof.ratio)} of what it was (95 % interval {significant(low)} to"
        f" {significant(high)}).{'' if high < 1.0 else ' That is no certain gain.'}"
    )


def doubts(diagnosis: Diagnosis) -> list[str]:
    """What speaks against the findings, said plainly."""
    out, after = [], diagnosis.fits["after"]
    if diagnosis.terms and after.worst_parameter_sigma > max(after.worst_allowed, OWN_TOLERANCE):
        out.append(
            f"{after.worst_parameter} still stands {significant(after.worst_parameter_sigma)} tolerances from its drawing,"
            f" beyond the {significant(after.worst_allowed)} that a true model allows."
        )
    out += [
        f"No amplitude of {named(f)} is twice its own uncertainty: the readings want the effect, not any one of its"
        " coefficients."
        for f in diagnosis.findings
        if f.parameters and not any(abs(q.value) > 2.0 * q.std for q in f.parameters.values())
    ]
    out += [f"{named(f)}: {said}" for f in diagnosis.findings for said in against_words(f)]
    if diagnosis.disagreement > AGREED:
        ended = "; they ended with their budget of work, before they were as long as usual"
        out.append(
            f"Probabilities are known to {percent(diagnosis.disagreement)} only: so far do the chains differ that they were"
            f" drawn from{ended if diagnosis.budget_spent else ''}."
        )
    structure = diagnosis.structure
    if diagnosis.findings and structure.raised:
        driver = "the order of rows" if structure.about == "order" else structure.about
        out.append(
            f"Residuals still follow {driver} (p = {p_value(structure.p)}; {percent(structure.share)} of them): something"
            " smaller is left."
        )
    return out if diagnosis.proof is None else [*out, *_proof_doubts(diagnosis.proof)]


def _proof_doubts(proof: Proof) -> list[str]:
    placebo, box = proof.placebo_gain, proof.black_box_ratio
    out = [
        f"Held out, the {b.name} ({several(b.rows, 'row')}) get worse: rms rises to {significant(b.ratio)} of what it was."
        for b in proof.blocks
        if known(b.ratio) and b.ratio > 1.0
    ]
    if known(proof.ratio_interval[1]) and proof.ratio_interval[1] >= 1.0:
        out.append("Held-out rows show no certain gain.")
    if placebo is not None and placebo > NOTABLE:
        out.append(
            f"A placebo (the same effect with shuffled drivers) gains {significant(placebo)} too, which chance should not give."
        )
    if box is not None and known(box) and box <= proof.ratio:
        out.append(f"An equally flexible black box does as well on held-out rows ({significant(box)}).")
    if proof.injected_recovered is False:
        out.append(
            "The effect, put into simulated readings at the size found here, was not recognised first of all."
        )
    return out


def left_words(diagnosis: Diagnosis) -> str:
    """Return the rows that stand out and what is wrong with them, else by how much each column is off."""
    fit, recording = diagnosis.after, diagnosis.recording
    places = np.flatnonzero(~recording.validation & np.isfinite(fit.residual).all(axis=1))
    left = Left.of(fit.residual[places], places, FAR)
    return row_words(fit.nominal, recording, left) or column_words(fit.nominal, left)


Names = Callable[[str], str]
"""How an effect is called by its slug."""


def missing_words(missing: Sequence[Missing], names: Names = str) -> list[str]:
    """``joint-compliance and link-bending: no `gravity:` in kr6.yaml; add `gravity: [0, 0, -9.80665]` ``, a line each."""
    return [
        f"{one.what or joined([names(slug) for slug in one.effects])}: {one.why}; {one.add}"
        for one in missing
    ]


def untestable_lines(
    untestable: Sequence[Untestable], told_already: Sequence[Missing] = (), names: Names = str
) -> list[str]:
    """Effects that could not be tested by the reason why, those that a line or a column would change first."""
    past = {slug for one in told_already for slug in one.effects}
    groups: dict[str, list[str]] = {}
    for one in untestable:
        reason = _reason(one.why)
        if reason not in NOTHING and one.effect not in past:
            groups.setdefault(reason, []).append(one.effect)
    ranked = sorted(groups.items(), key=lambda item: "`" not in item[0])
    return [f"{joined([names(slug) for slug in slugs])}: {reason}" for reason, slugs in ranked]


def _reason(why: str) -> str:
    """The first of several reasons, without the place that it is of: others are alike."""
    first = why.split("; ", maxsplit=1)[0] if "`" not in why else why
    head, _, rest = first.partition(": ")
    return rest if rest and " " not in head else first
