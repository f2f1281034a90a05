"""The whole procedure: detect, locate, name or abstain, model, prove.

``diagnose`` is the one entry; every step is a module of this package.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import classes, doubt, outliers, remainder
from truepose.identification.diagnosis.candidates import Catalogue, catalogue
from truepose.identification.diagnosis.effect_selection import (
    THRESHOLD,
    WIDE,
    Ranking,
    Selection,
    rank,
    restricted,
    select,
)
from truepose.identification.diagnosis.findings import (
    evidence_map,
    merge_findings,
    ranked_alternatives,
)
from truepose.identification.diagnosis.judgement import Judgement, explained, judged, likely_inflation
from truepose.identification.diagnosis.naming import name_terms
from truepose.identification.diagnosis.proof import prove
from truepose.identification.diagnosis.result import Diagnosis, Finding, Remainder
from truepose.identification.diagnosis.signatures import Signatures
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import FREE_WIDENING, Estimate, estimate
from truepose.identification.fit.summary import summarise
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.selection.tolerance_classes import PartClass
from truepose.models.machine import Machine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
CONCEALED = 1.3
"""Free-fit chi2 per degree of freedom below which an ordinary fit looks good."""


@dataclass(frozen=True)
class _Fits:
    free: Estimate
    before: Estimate
    outliers: Mask


@dataclass(frozen=True)
class _Outcome:
    """The terms that were given names and the fit with them, and all that is said of them."""

    selection: Selection
    findings: tuple[Finding, ...]
    verdict: str
    rival: Remainder | None
    raised: Judgement
    left: Judgement
    screened: Ranking
    inflation: dict[PartClass, float]


def diagnose(
    machine: Machine, recording: Recording, *, progress: Callable[[str], None] = lambda _: None
) -> Diagnosis:
    """Say what physics the model of ``machine`` leaves out of ``recording``, model it and prove it.

    Raises InputError for unusable input and ConvergenceError when the fit without effects finds no minimum.
    """
    progress("fitting without effects")
    fits = _null_fits(machine, recording)
    cat = catalogue(machine, recording)
    progress(f"weighing {len(cat.candidates)} explanations")
    signatures = Signatures(machine, recording, cat.candidates)
    selection = _select(signatures, cat, fits)
    again = outliers.outlying_rows(selection.fit, ~recording.validation)
    if not np.array_equal(again, fits.outliers):
        fits = _refit_null(machine, recording, fits, again)
        selection = _select(selection.signatures, selection.catalogue, fits, selection)
    progress("naming and proving")
    return _conclude(fits, _judge(fits, selection))


def _null_fits(machine: Machine, recording: Recording) -> _Fits:
    known = machine.effects
    predictor = Predictor(machine, recording, known, visits=FIT)
    start = aligned_start(predictor)
    rough = estimate(machine, recording, known, start=start, loss="huber", predictor=predictor)
    far = outliers.outlying_rows(rough, ~recording.validation)
    before = estimate(machine, recording, known, start=rough.p, exclude=far, predictor=predictor)
    free = _free(machine, recording, before, far, before.p)
    return _Fits(free, before, far)


def _free(machine: Machine, recording: Recording, before: Estimate, far: Mask, start: Array) -> Estimate:
    """The ordinary fit beside it; where its valley has no bottom, with tolerances less wide."""
    for factor in (FREE_WIDENING, FREE_WIDENING / 3, FREE_WIDENING / 10):
        try:
            return estimate(machine, recording, before.effects, start=start, widen=factor, exclude=far)
        except ConvergenceError:
            start = before.p
    return before


def _refit_null(machine: Machine, recording: Recording, fits: _Fits, far: Mask) -> _Fits:
    known = machine.effects
    before = estimate(machine, recording, known, start=fits.before.p, exclude=far)
    free = _free(machine, recording, before, far, fits.free.p)
    return _Fits(free, before, far)


def _select(signatures: Signatures, cat: Catalogue, fits: _Fits, first: Selection | None = None) -> Selection:
    rms = float(np.sqrt(max(fits.before.chi2_per_dof, fits.free.chi2_per_dof)))
    return select(signatures, cat, fits.before, fits.outliers, rms, first)


def _judge(fits: _Fits, found: Selection) -> _Outcome:
    """Names, what is left beside them, and the verdict."""
    signatures, cat = found.signatures, found.catalogue
    machine, recording = signatures.machine, signatures.recording
    rival = remainder.strongest_unnamed(cat, found.accepted, found.fit)
    selection, named_terms = name_terms(found, fits.outliers, rival)
    lin, stated = signatures.linearise(fits.before), dict.fromkeys(cat.stated, WIDE)
    others = [i for i in range(len(cat.candidates)) if i not in stated]
    screened = rank(lin, cat, selection.grid, stated, others)
    inflation = dict(zip(selection.grid.classes, screened.evidence.inflation, strict=True))
    raised = judged(fits.free, fits.before, lin, inflation, recording)
    left = _left(selection, recording) if selection.accepted else raised
    names = _findings(selection, named_terms)
    failing = rival is not None or left.leaves
    # a misfit that may be a sigma stated too small is not what the names should have explained
    share = explained(fits.before, selection.fit) if rival is not None or left.fails else 1.0
    findings = doubt.doubted(machine, names, rival, failing=failing, explained=share)
    if names and not findings:
        rival = rival or remainder.of_pile(names, fits.before, raised.structure)
        selection = restricted(selection, fits.outliers, cat.stated)
        left = raised
    verdict = "missing-physics" if findings else "unknown" if rival or raised.fails else "adequate"
    return _Outcome(selection, findings, verdict, rival, raised, left, screened, inflation)


def _left(selection: Selection, recording: Recording) -> Judgement:
    """What the model with the effects found leaves."""
    fit, inflation = selection.fit, likely_inflation(selection)
    return judged(fit, fit, selection.linearisation, inflation, recording)


def _conclude(fits: _Fits, outcome: _Outcome) -> Diagnosis:
    selection, raised, left, verdict = outcome.selection, outcome.raised, outcome.left, outcome.verdict
    signatures, cat = selection.signatures, selection.catalogue
    machine, recording = signatures.machine, signatures.recording
    free, before, named = fits.free, fits.before, verdict == "missing-physics"
    after = selection.fit if named else before
    stages = {"free": free, "before": before, "after": after}
    proof = prove(before, selection, fits.outliers) if named else None
    return Diagnosis(
        machine=machine,
        recording=recording,
        verdict=verdict,
        concealed=verdict != "adequate" and free.chi2_per_dof < CONCEALED,
        alarms=raised.alarms,
        alarms_after=left.alarms if named else raised.alarms,
        structure=left.structure,
        findings=outcome.findings,
        remainder=_remainder(outcome),
        candidates=ranked_alternatives(cat, outcome.screened),
        evidence_map=evidence_map(cat, outcome.screened),
        untestable=cat.untestable,
        free=free,
        before=before,
        after=after,
        fits={name: summarise(fit, recording.validation) for name, fit in stages.items()},
        proof=proof,
        terms=after.fitted_effects(),
        outlier_rows=tuple(int(recording.source_row[k]) for k in np.flatnonzero(fits.outliers)),
        noise=outcome.screened.evidence.noise,
        inflation=outcome.inflation,
    )


def _findings(selection: Selection, named: Sequence[classes.Named]) -> tuple[Finding, ...]:
    machine, cat = selection.signatures.machine, selection.catalogue
    lin, grid, accepted = selection.linearisation, selection.grid, selection.accepted
    flips = [classes.flip_inflation(lin, cat, grid, accepted, n.index, THRESHOLD) for n in named]
    return merge_findings(machine, cat, selection.fit, named, flips)


def _remainder(outcome: _Outcome) -> Remainder | None:
    if outcome.verdict == "adequate":
        return None
    if outcome.rival is not None:
        return outcome.rival
    left, fit = outcome.left.structure, outcome.selection.fit
    told = outcome.verdict == "unknown" or left.alarm.raised
    return remainder.describe(fit, outcome.selection.signatures.recording, left) if told else None
