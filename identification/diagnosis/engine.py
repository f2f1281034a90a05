"""The whole procedure: detect, locate, name or abstain, model, prove.

``diagnose`` is the one entry; every step is a module of this package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import outliers, remainder
from truepose.identification.diagnosis.alone import flip_inflation, weighed_alone
from truepose.identification.diagnosis.findings import evidence_map, finding, lead, ranked_alternatives
from truepose.identification.diagnosis.inclusion import Inclusion
from truepose.identification.diagnosis.outcome import Fits, Outcome, concluded
from truepose.identification.diagnosis.replication import replications
from truepose.identification.diagnosis.result import (
    Alternative,
    Diagnosis,
    Finding,
    Remainder,
    SetOfEffects,
)
from truepose.identification.diagnosis.search import Found, search
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import FREE_WIDENING, Estimate, estimate
from truepose.identification.fit.summary import summarise
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.load import Sources, as_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.linearisation import Signatures
from truepose.identification.signatures.untestable import missing_inputs
from truepose.models.machine import Machine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
CONCEALED = 1.3
"""Free-fit chi2 per degree of freedom below which an ordinary fit looks good."""


def diagnose(
    machine: Machine, recording: Recording | Sources, *, progress: Callable[[str], None] = lambda _: None
) -> Diagnosis:
    """Say what physics the model of ``machine`` leaves out of ``recording``, model it and prove it.

    A path, a DataFrame or a dict of columns is a recording, too. Raises InputError for unusable input and
    ConvergenceError when the fit without effects finds no minimum.
    """
    recording = as_recording(machine, recording)
    progress("fitting without effects")
    fits = _null_fits(machine, recording)
    cat = catalogue(machine, recording)
    progress(f"weighing {len(cat.candidates)} explanations")
    signatures = Signatures(machine, recording, cat.candidates)
    near = search(signatures, cat, fits.before, fits.outliers, fits.rms)
    again = outliers.outlying_rows(near.fit, recording, ~recording.validation)
    if not np.array_equal(again, fits.outliers):
        fits = _refit_null(machine, recording, fits, again)
        near = search(signatures, cat, fits.before, fits.outliers, fits.rms)
    found = near.found()
    progress("naming and proving")
    return _conclude(fits, found, concluded(fits, found))


def _null_fits(machine: Machine, recording: Recording) -> Fits:
    known = machine.effects
    predictor = Predictor(machine, recording, known, visits=FIT)
    start = aligned_start(predictor)
    rough = estimate(machine, recording, known, start=start, loss="huber", predictor=predictor)
    far = outliers.outlying_rows(rough, recording, ~recording.validation & ~outliers.bridges(recording))
    before = estimate(machine, recording, known, start=rough.p, exclude=far, predictor=predictor)
    free = free_fit(machine, recording, before, far, before.p)
    return Fits(free, before, far)


def free_fit(machine: Machine, recording: Recording, before: Estimate, far: Mask, start: Array) -> Estimate:
    """The ordinary fit beside it; where its valley has no bottom, with tolerances less wide."""
    for factor in (FREE_WIDENING, FREE_WIDENING / 3, FREE_WIDENING / 10):
        try:
            return estimate(machine, recording, before.effects, start=start, widen=factor, exclude=far)
        except ConvergenceError:
            start = before.p
    return before


def _refit_null(machine: Machine, recording: Recording, fits: Fits, far: Mask) -> Fits:
    known = machine.effects
    before = estimate(machine, recording, known, start=fits.before.p, exclude=far)
    free = free_fit(machine, recording, before, far, fits.free.p)
    return Fits(free, before, far)


def _inflation(found: Found) -> dict[PartClass, float]:
    """How many times wider than stated the tolerances of each class of part likely are."""
    unknowns = found.problem.spike_slab.unknowns
    logs = sum(
        (
            share * np.log(np.array(unknowns.widening[point.widening]))
            for point, share in found.posterior.points
        ),
        np.zeros(len(found.problem.classes)),
    )
    return dict(zip(found.problem.classes, np.exp(logs).tolist(), strict=True))


def _noise(found: Found) -> float:
    """Of the first kind of reading, in stated sigmas."""
    values = found.problem.spike_slab.unknowns.noise[0].values
    return float(
        np.exp(sum(share * np.log(values[point.noise[0]]) for point, share in found.posterior.points))
    )


def _conclude(fits: Fits, found: Found, outcome: Outcome) -> Diagnosis:
    cat, machine, recording = found.catalogue, found.signatures.machine, found.signatures.recording
    stages = {"free": fits.free, "before": fits.before, "after": outcome.after}
    alone, said = weighed_alone(found.first, len(cat.candidates)), outcome.summary.inclusion
    return Diagnosis(
        machine=machine,
        recording=recording,
        verdict=outcome.verdict,
        concealed=outcome.verdict != "adequate" and fits.free.chi2_per_dof < CONCEALED,
        alarms=outcome.raised.alarms,
        alarms_after=outcome.left.alarms,
        structure=outcome.left.structure,
        findings=_findings(found, outcome, fits.rms),
        remainder=_remainder(found, outcome),
        candidates=ranked_alternatives(cat, alone),
        evidence_map=evidence_map(cat, alone),
        untestable=cat.untestable,
        missing=missing_inputs(machine, recording),
        free=fits.free,
        before=fits.before,
        after=outcome.after,
        fits={name: summarise(fit, recording.validation) for name, fit in stages.items()},
        proof=outcome.proof,
        terms=outcome.after.fitted_effects(),
        outlier_rows=tuple(int(recording.source_row[k]) for k in np.flatnonzero(fits.outliers)),
        noise=_noise(found),
        inflation=_inflation(found),
        sets=_sets(said),
        inclusion=tuple(Alternative(slug, place, p, 0.0) for (slug, place), p in said.places.items()),
        leading=tuple(lead(one) for one in outcome.summary.leading),
        disagreement=found.posterior.disagreement,
        applied=outcome.applied,
    )


def _sets(said: Inclusion) -> tuple[SetOfEffects, ...]:
    return tuple(
        SetOfEffects(tuple((c.effect, c.place) for c in causes), share) for causes, share in said.sets
    )


def _findings(found: Found, outcome: Outcome, rms: float) -> tuple[Finding, ...]:
    if outcome.verdict == "adequate":
        return ()
    names, machine, cat = outcome.summary.names, found.signatures.machine, found.catalogue
    halves = replications(found, names, rms)
    return tuple(
        finding(machine, cat, outcome.likeliest, one, flip_inflation(found, one), half)
        for one, half in zip(names, halves, strict=True)
    )


def _remainder(found: Found, outcome: Outcome) -> Remainder | None:
    """What has no name: the form that carries most of it; else what the structure tests say of the residuals."""
    if outcome.verdict == "adequate":
        return None
    fit, recording = outcome.after, found.signatures.recording
    if outcome.nameless:
        return replace(remainder.of_form(found.catalogue, outcome.nameless[0], fit), gain=outcome.gain)
    left = outcome.left.structure
    told = outcome.verdict == "unknown" or left.alarm.raised
    return remainder.describe(fit, recording, left) if told else None
