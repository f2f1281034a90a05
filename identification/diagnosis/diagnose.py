"""The whole walk of a diagnosis, in the order in which it is done: detect, locate, name or abstain, model, prove."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from truepose.identification.diagnosis.alarms import alarms_of, misfits
from truepose.identification.diagnosis.averaging import deploy
from truepose.identification.diagnosis.findings import (
    evidence_map,
    findings_of,
    ranked_alternatives,
    remainder_of,
)
from truepose.identification.diagnosis.naming import Summary, Supported, keep_supported, summarised
from truepose.identification.diagnosis.null_fits import Fits, null_fits
from truepose.identification.diagnosis.posterior_summary import SURE, Inclusion, Sums
from truepose.identification.diagnosis.proof import prove, replications
from truepose.identification.diagnosis.refit import Choice, likeliest_model
from truepose.identification.diagnosis.result import NAMED, Alarm, Alternative, Diagnosis, Lead
from truepose.identification.diagnosis.search import Found, first, further, stages
from truepose.identification.fit.reading_errors import estimate_reading_errors
from truepose.identification.fit.set_ups import with_set_ups
from truepose.identification.fit.summary import summarise
from truepose.identification.learned_prior import FleetPrior, LearnedPrior
from truepose.identification.recording.load import with_measured_loads
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.untestable import missing_inputs, with_assumed_gravity
from truepose.models.machine.machine import Machine
from truepose.threads import run_both

CONCEALED = 1.3
"""Free-fit chi2 per degree of freedom below which an ordinary fit looks good."""
NOTHING: Mapping[str, Any] = {"concealed": False, "findings": (), "remainder": None, "proof": None}
"""What is said where nothing is missing."""
Examine = Callable[[Found, Inclusion], Any]
"""What else is to be said of a posterior before its matrices are let go."""


def diagnose(
    machine: Machine,
    recording: Recording,
    *,
    prior: LearnedPrior | None = None,
    progress: Callable[[str], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
    examine: Examine | None = None,
) -> Diagnosis:
    """Say what physics the model of ``machine`` leaves out of ``recording``, model it and prove it.

    ``prior``: what a fleet of machines leaves for this one (``truepose.identification.learned_prior``). ``stop`` is asked now
    and then: once it returns True, the search
    ends, and what it found by then is named and proved (``Diagnosis.stopped``). ``examine``: its result is
    ``Diagnosis.examined``. Raises InputError for unusable input and ConvergenceError when the fit without effects finds no
    minimum.
    """
    stated = with_measured_loads(with_set_ups(machine, recording), recording)
    machine = with_assumed_gravity(stated)
    progress("fitting without effects")
    every = stages(machine, estimate_reading_errors(machine, recording))
    fits, cat = null_fits(machine, every[0]), catalogue(machine, recording, stated)
    if prior is not None:
        cat = replace(cat, learned=FleetPrior(prior, machine.mechanism_type))
    progress(f"weighing {len(cat.candidates)} explanations")
    fits, near = first(fits, cat, stop)
    for rows in every[1:]:
        fits, near = further(near, fits, rows, progress)
    found = [near.found()]
    del near  # and what its chains remember
    stopped = stop()
    progress("naming and proving")
    said = conclude(fits, found.pop(), stated, examine)  # whose matrices are let go there
    return replace(said, stopped=stopped)


def conclude(fits: Fits, found: Found, stated: Machine, examine: Examine | None = None) -> Diagnosis:
    """Turn a posterior into names, a verdict, the model to deploy, its proof, and findings.

    ``stated``: the machine without what is assumed of it.
    """
    model = likeliest_model(fits, found)
    there = found  # linear at the likeliest model's own fit, so that the form of all that it holds is tested
    if {e.label for e in model.fit.effects} != {e.label for e in found.fit.effects}:
        found = replace(found, linearisation=found.linearisation.bare())  # large: let go before the next
        there = replace(found, fit=model.fit, linearisation=found.signatures.linearise(model.fit))
        found = replace(found, linearisation=there.linearisation)  # and only its columns are asked for
    said, choice = run_both(lambda: summarised(there, model.fit), lambda: Choice.of(there, fits))
    supported = keep_supported(said, there, model.fit, partial(replications, found, rms=fits.rms))
    summary, recording = supported.summary, found.signatures.recording
    sure = {found.catalogue.candidates[i].label for i in summary.sure(NAMED)}
    spoken = [i for n in (*summary.names, *summary.leading) if not n.nameless for i in n.candidates]
    choice = replace(choice, known=choice.known | sure, laws=frozenset((*spoken, *found.catalogue.stated)))
    quiet = conclude_nothing(fits, found, supported, choice, stated, examine)
    if quiet.verdict == "adequate":
        return quiet
    whole, names = run_both(lambda: choice.compared(model.fit), lambda: choice.names(model))
    main = next((i for n in summary.laws for i in n.candidates), None)  # of the best supported law
    (after, applied), proof = run_both(
        lambda: deploy(choice, model, names, summary.sure(), whole, said.firm),
        lambda: None if main is None else prove(fits.before, model.fit, whole, there, main, fits.outliers),
    )
    nameless = tuple(i for i in model.held(there) if not found.catalogue.named(i))
    gain = choice.gain_of_forms(names, whole) if nameless else {}
    left, findings = run_both(
        lambda: alarms_of(after, after, there.linearisation, recording),
        lambda: findings_of(found, supported, model.fit, after),
    )
    return replace(
        quiet,
        concealed=fits.free.chi2_per_dof < CONCEALED,
        alarms_after=left,
        findings=findings,
        remainder=remainder_of(there, quiet.verdict, nameless, after, left["structure"], gain),
        after=after,
        fits={**quiet.fits, "after": summarise(after, recording.validation)},
        proof=proof,
        terms=after.fitted_effects(),
        applied=applied,
    )


def conclude_nothing(
    fits: Fits, found: Found, supported: Supported, choice: Choice, stated: Machine, examine: Examine | None
) -> Diagnosis:
    """Return what the posterior says, with plain calibration applied: where nothing is missing, this is all."""
    cat, machine, recording = found.catalogue, found.signatures.machine, found.signatures.recording
    raised = alarms_of(fits.free, fits.before, found.linearisation_before, recording)
    summary, unknowns, plain = supported.summary, found.problem.spike_slab.unknowns, choice.drawing_alone
    wider = found.typical(lambda point: unknowns.widening[point.widening]).tolist()
    every = {"free": fits.free, "before": fits.before, "after": choice.drawing}
    return Diagnosis(
        nominal=stated,
        recording=recording,
        verdict=verdict(summary, raised),
        alarms=raised,
        alarms_after=raised,
        candidates=ranked_alternatives(cat, found.alone),
        evidence_map=evidence_map(cat, found.alone),
        untestable=(*cat.untestable, *supported.unseen),
        missing=missing_inputs(stated, recording),
        free=fits.free,
        before=fits.before,
        after=choice.drawing,
        fits={name: summarise(fit, recording.validation) for name, fit in every.items()},
        terms=choice.drawing.fitted_effects(),
        outlier_rows=tuple(int(recording.source_row[k]) for k in np.flatnonzero(fits.outliers)),
        noise=float(found.typical(lambda point: unknowns.noise[0].values[point.noise[0]])),
        inflation=dict(zip(found.problem.classes, wider, strict=True)),
        sets=summary.inclusion.sets,
        inclusion=tuple(Alternative(*place, p, 0.0) for place, p in summary.inclusion.places.items()),
        leading=tuple(Lead(*one.cause, one.levels, one.probability) for one in summary.leading),
        disagreement=found.posterior.disagreement,
        budget_spent=found.posterior.cut,
        applied=choice.applied("plain", plain, plain),
        together=Sums(machine, cat, found.problem, found.posterior).together(),
        examined=None if examine is None else examine(found, summary.inclusion),
        **NOTHING,
        prior_notes=() if cat.learned is None else cat.learned.notes(c.at_place for c in cat.candidates),
    )


def verdict(summary: Summary, raised: Mapping[str, Alarm]) -> str:
    """Return ``missing-physics`` where a place with its driver, or a class of names, is known; ``unknown`` where neither is
    and something is surely there, or noise alone cannot make the misfit."""
    if summary.names:
        return "missing-physics"
    return "unknown" if summary.inclusion.nameless > SURE or misfits(raised) else "adequate"
