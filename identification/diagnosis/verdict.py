"""The verdict, and what stands behind it: from a posterior to names, to the model that is applied, to the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from truepose.arrays import Array, Mask
from truepose.identification.diagnosis.alarms import alarms_of, misfits
from truepose.identification.diagnosis.averaging import averaged
from truepose.identification.diagnosis.evidence import evidence
from truepose.identification.diagnosis.findings import (
    evidence_map,
    finding,
    ranked_alternatives,
    remainder_of_form,
    remainder_of_residuals,
)
from truepose.identification.diagnosis.holdout import Comparison
from truepose.identification.diagnosis.naming import Summary, Supported, keep_supported, summarised
from truepose.identification.diagnosis.null_fits import Fits
from truepose.identification.diagnosis.posterior_summary import Named, Presence
from truepose.identification.diagnosis.proof import flip_inflation, prove, replications
from truepose.identification.diagnosis.refit import Choice, Model, chosen_model, refit, remainder_shapes
from truepose.identification.diagnosis.result import (
    NAMED,
    WHOLE,
    Alarm,
    Alternative,
    Applied,
    Diagnosis,
    Finding,
    Lead,
    Proof,
    Remainder,
)
from truepose.identification.diagnosis.search import Found, chosen
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import FitSummary, summarise
from truepose.identification.posterior.design import GridPoint
from truepose.identification.prior import STATED
from truepose.identification.signatures.untestable import missing_inputs
from truepose.threads import in_order, run_both

SURE = 0.9
"""Probability from which on something without a name is said to be there, and a driver is known."""
CONCEALED = 1.3
"""Free-fit chi2 per degree of freedom below which an ordinary fit looks good."""


def verdict(summary: Summary, raised: Mapping[str, Alarm]) -> str:
    """``missing-physics`` where a place with its driver, or a class of names, is known; ``unknown`` where neither is and
    something is surely there, or noise alone cannot make the misfit."""
    if summary.names:
        return "missing-physics"
    return "unknown" if summary.inclusion.nameless > SURE or misfits(raised) else "adequate"


def concluded(fits: Fits, found: Found) -> Diagnosis:
    """What is said, and what is applied."""
    model = _likeliest(fits, found)
    there = found
    if {e.label for e in model.fit.effects} != {e.label for e in found.fit.effects}:
        # linear at the likeliest model's own fit, so that the form of everything it holds is tested
        found = replace(found, linearisation=found.linearisation.bare())  # large: let go before the next
        there = replace(found, fit=model.fit, linearisation=found.signatures.linearise(model.fit))
        found = replace(found, linearisation=there.linearisation)  # and only its columns are asked for
    halves = partial(replications, found, rms=fits.rms)
    said, choice = run_both(lambda: summarised(there, model.fit), lambda: Choice.of(there, fits))
    supported = keep_supported(said, there, model.fit, halves)
    summary, nameless = supported.summary, model.nameless(there)
    choice = choice.with_known(_sure(summary, NAMED))
    quiet = _quiet(fits, found, supported, choice)
    if quiet.verdict == "adequate":
        return quiet
    whole, names = run_both(lambda: choice.compared(model.fit), lambda: _names(fits, there, model))
    firm = tuple(i for n in said.laws if n.probability > NAMED for i in n.candidates)
    (after, applied), proof = run_both(
        lambda: _applied(choice, model, names, summary, whole, firm),
        lambda: _proof(fits, there, model, summary, whole),
    )
    gain = _gain(choice, names, whole) if nameless else {}
    left, findings = run_both(
        lambda: alarms_of(after, after, there.linearisation, found.signatures.recording),
        lambda: _findings(found, supported, model.fit, after),
    )
    return replace(
        quiet,
        concealed=fits.free.chi2_per_dof < CONCEALED,
        alarms_after=left,
        findings=findings,
        remainder=_remainder(there, quiet.verdict, nameless, after, left, gain),
        after=after,
        fits=_summaries(fits, after, found.signatures.recording.validation),
        proof=proof,
        terms=after.fitted_effects(),
        applied=applied,
    )


def _proof(fits: Fits, found: Found, model: Model, summary: Summary, whole: Comparison) -> Proof | None:
    """Prove the best supported law; None where nothing has a name."""
    main = next((i for n in summary.laws for i in n.candidates), None)
    return None if main is None else prove(fits.before, model.fit, whole, found, main, fits.outliers)


def _quiet(fits: Fits, found: Found, supported: Supported, choice: Choice) -> Diagnosis:
    """What the posterior says, with plain calibration applied: where nothing is missing, this is all."""
    summary = supported.summary
    cat, machine, recording = found.catalogue, found.signatures.machine, found.signatures.recording
    raised = alarms_of(fits.free, fits.before, found.linearisation_before, recording)
    alone, unknowns = found.alone, found.problem.spike_slab.unknowns
    wider = _typical(found, lambda point: unknowns.widening[point.widening]).tolist()
    plain = choice.drawing_alone
    places, anywhere = evidence(found, summary.inclusion)
    return Diagnosis(
        nominal=machine,
        recording=recording,
        verdict=verdict(summary, raised),
        concealed=False,
        alarms=raised,
        alarms_after=raised,
        findings=(),
        remainder=None,
        candidates=ranked_alternatives(cat, alone),
        evidence_map=evidence_map(cat, alone),
        untestable=(*cat.untestable, *supported.unseen),
        missing=missing_inputs(machine, recording),
        free=fits.free,
        before=fits.before,
        after=choice.drawing,
        fits=_summaries(fits, choice.drawing, recording.validation),
        proof=None,
        terms=choice.drawing.fitted_effects(),
        outlier_rows=tuple(int(recording.source_row[k]) for k in np.flatnonzero(fits.outliers)),
        noise=float(_typical(found, lambda point: unknowns.noise[0].values[point.noise[0]])),
        inflation=dict(zip(found.problem.classes, wider, strict=True)),
        sets=summary.inclusion.sets,
        inclusion=tuple(Alternative(*place, p, 0.0) for place, p in summary.inclusion.places.items()),
        leading=tuple(Lead(*one.cause, one.levels, one.probability) for one in summary.leading),
        disagreement=found.posterior.disagreement,
        budget_spent=found.posterior.cut,
        applied=_told(choice, "plain", plain, plain),
        together=Presence(machine, cat, found.problem, found.posterior).together(),
        evidence=places,
        evidence_anywhere=anywhere,
        prior_notes=() if cat.learned is None else cat.learned.notes(c.at_place for c in cat.candidates),
    )


def _typical(found: Found, value: Callable[[GridPoint], ArrayLike]) -> Array:
    """Geometric mean over the posterior of what a point of the grid stands for."""
    logs = [share * np.log(value(point)) for point, share in found.posterior.points]
    return np.asarray(np.exp(sum(logs[1:], logs[0])))


def _summaries(fits: Fits, after: Estimate, held_out: Mask) -> dict[str, FitSummary]:
    stages = {"free": fits.free, "before": fits.before, "after": after}
    return {name: summarise(fit, held_out) for name, fit in stages.items()}


def _findings(
    found: Found, supported: Supported, likeliest: Estimate, after: Estimate
) -> tuple[Finding, ...]:
    """Return the findings; what is more probable than not has the size that the deployed fit has, where it has any."""
    machine, cat, names = found.signatures.machine, found.catalogue, supported.summary.names
    inferred, deployed = found.signatures.recording.inferred, {e.label for e in after.effects}

    def fit_of(one: Named) -> Estimate:
        firm = one.probability >= NAMED
        return after if firm and {cat.candidates[i].label for i in one.candidates} <= deployed else likeliest

    inflations = in_order(partial(flip_inflation, found), names)
    return tuple(
        finding(machine, cat, fit_of(one), one, inflation, half, inferred)
        for one, half, inflation in zip(names, supported.replications, inflations, strict=True)
    )


def _remainder(
    found: Found,
    said: str,
    nameless: Sequence[int],
    after: Estimate,
    left: Mapping[str, Alarm],
    gain: Mapping[str, float],
) -> Remainder | None:
    """What has no name: the form that carries most of it; else what the structure tests say of the residuals."""
    if nameless:
        return replace(remainder_of_form(found.catalogue, nameless[0], after), gain=gain)
    if said == "unknown" or left["structure"].raised:
        return remainder_of_residuals(after, found.signatures.recording, left["structure"])
    return None


def _sure(summary: Summary, probability: float = 0.0) -> tuple[int, ...]:
    """Candidates that act at their place by their driver for sure, of names as probable as that."""
    sure = [n for n in summary.laws if n.levels.driver >= SURE and n.probability >= probability]
    return tuple(i for n in sure for i in n.candidates)


def _likeliest(fits: Fits, found: Found) -> Model:
    """Where no minimum is found with the likeliest set, the fit of the last expansion point stands, and what it holds."""
    accepted = dict.fromkeys(found.catalogue.stated, STATED) | chosen(found.problem, found.mode)
    shapes = remainder_shapes(found)
    if not accepted and not shapes:
        return Model(accepted, (), fits.before)
    model = refit(found, accepted, shapes, fits.outliers)
    return Model(dict(found.accepted), (), found.fit) if model is None else model


def _names(fits: Fits, found: Found, model: Model) -> Model | None:
    """The model with names alone; itself where it has nothing else, None where it has no names."""
    own = {i: s for i, s in model.accepted.items() if found.catalogue.named(i)}
    if not own:
        return None
    return refit(found, own, (), fits.outliers) if model.nameless(found) else model


def _applied(
    choice: Choice,
    model: Model,
    names: Model | None,
    summary: Summary,
    whole: Comparison,
    firm: Sequence[int],
) -> tuple[Estimate, Applied]:
    """Return what is deployed: averaged over sets with the ``firm`` candidates where that is all that was found."""
    label, less, held = chosen_model(choice, model, names, _sure(summary), whole)
    if less is None or label != WHOLE:
        return choice.drawing if less is None else less.fit, _told(choice, label, held, whole)
    after = averaged(choice.found, model.fit, firm)
    seen = choice.as_it_is(after)
    if seen is None or seen.worse:
        return after if seen is None else model.fit, _told(choice, label, held, whole)
    return after, _told(choice, label, seen, seen)


def _told(choice: Choice, label: str, held: Comparison, whole: Comparison) -> Applied:
    held_out = held.split, held.pose, held.ratio
    return Applied(label, *held_out, whole.pose, whole.ratio, choice.baselines)


def _gain(choice: Choice, names: Model | None, whole: Comparison) -> Mapping[str, float]:
    """By how much forms without a name lower the rms of held-out rows beside the names, by kind of reading (mm, rad)."""
    without = 1.0 if names is None else choice.judged(names.fit).ratio
    if whole.ratio >= without:
        return {}
    summary = summarise(choice.drawing, choice.found.signatures.recording.validation)
    rms = summary.validation_rms or summary.rms
    return {kind: (without - whole.ratio) * value for kind, value in rms.items()}
