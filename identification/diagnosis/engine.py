"""The whole procedure: detect, locate, name or abstain, model, prove.

``diagnose`` is the one entry; every step is a module of this package.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.align import aligned_start
from truepose.identification.diagnosis import alarms, classes, doubt, outliers, remainder, summary
from truepose.identification.diagnosis.candidates import Catalogue, catalogue
from truepose.identification.diagnosis.findings import alternative, merge_findings
from truepose.identification.diagnosis.proof import prove
from truepose.identification.diagnosis.result import Alternative, Diagnosis, Finding, Remainder
from truepose.identification.diagnosis.selection import (
    THRESHOLD,
    WIDE,
    Ranking,
    Selection,
    only,
    rank,
    select,
)
from truepose.identification.diagnosis.signatures import Linearisation, Signatures
from truepose.identification.estimate import FREE_WIDENING, Estimate, estimate
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.models.machine import Machine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
CONCEALED = 1.3
"""Free-fit chi2 per degree of freedom below which an ordinary fit looks good."""
UNKNOWN_P = 1e-3
SIGMA_OFF = 3.0


@dataclass(frozen=True)
class _Fits:
    free: Estimate
    before: Estimate
    outliers: Mask


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
    return _conclude(selection.signatures, selection.catalogue, fits, selection)


def _null_fits(machine: Machine, recording: Recording) -> _Fits:
    known = machine.effects
    predictor = Predictor(machine, recording, known)
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


def _conclude(signatures: Signatures, cat: Catalogue, fits: _Fits, found: Selection) -> Diagnosis:
    machine, recording = signatures.machine, signatures.recording
    free, before = fits.free, fits.before
    rival = remainder.unnamed(cat, found.accepted, found.fit)
    selection, named_terms = _name(signatures, cat, fits, found, rival)
    after = selection.fit
    lin = signatures.linearise(before)
    stated = dict.fromkeys(cat.stated, WIDE)
    screened = rank(
        lin, cat, selection.grid, stated, [i for i in range(len(cat.candidates)) if i not in stated]
    )
    inflation = dict(zip(selection.grid.classes, screened.evidence.inflation, strict=True))
    raised, structure = _alarms(fits, recording, lin)
    left = alarms.structure_alarm(after, recording) if selection.accepted else structure
    findings = _findings(machine, cat, selection, named_terms)
    after_alarms = _alarms_after(selection, recording, left)
    findings = doubt.doubted(machine, findings, rival, doubt.fails(rival, after_alarms))
    verdict = _verdict(findings, rival, left, lin, free, inflation, raised["residual"])
    channels = Predictor(machine, recording).channels
    named = verdict == "missing-physics"
    return Diagnosis(
        machine=machine,
        recording=recording,
        verdict=verdict,
        concealed=verdict != "adequate" and free.chi2_per_dof < CONCEALED,
        alarms=raised,
        alarms_after=after_alarms if named else raised,
        structure=left,
        findings=findings if named else (),
        remainder=_remainder(verdict, rival, after, recording, left),
        candidates=_candidates(cat, screened),
        evidence_map=_map(cat, screened),
        untestable=cat.untestable,
        free=free,
        before=before,
        after=after if named else before,
        fits={
            name: summary.summarise(fit, channels, recording.validation)
            for name, fit in (("free", free), ("before", before), ("after", after if named else before))
        },
        proof=prove(
            before, after, recording, fits.outliers, signatures, cat, selection.grid, selection.accepted
        )
        if named
        else None,
        terms=(after if named else before).fitted_effects(),
        outlier_rows=tuple(int(recording.source_row[k]) for k in np.flatnonzero(fits.outliers)),
        notes=_notes(recording, before, screened, inflation),
    )


def _alarms(
    fits: _Fits, recording: Recording, lin: Linearisation
) -> tuple[dict[str, alarms.Alarm], alarms.Structure]:
    noise = float(np.sqrt(max(fits.free.chi2_per_dof, 1e-300)))
    structure = alarms.structure_alarm(fits.before, recording)
    raised = {
        "residual": alarms.residual_alarm(fits.free, recording),
        "prior_conflict": alarms.prior_conflict(lin, max(noise, 1.0)),
        "structure": structure.alarm,
    }
    return raised, structure


def _alarms_after(
    selection: Selection, recording: Recording, left: alarms.Structure
) -> dict[str, alarms.Alarm]:
    """The same three alarms with the effects found."""
    fit = selection.fit
    noise = float(np.sqrt(max(fit.chi2_per_dof, 1.0)))
    return {
        "residual": alarms.residual_alarm(fit, recording),
        "prior_conflict": alarms.prior_conflict(selection.linearisation, noise),
        "structure": left.alarm,
    }


def _name(
    signatures: Signatures, cat: Catalogue, fits: _Fits, found: Selection, rival: Remainder | None
) -> tuple[Selection, list[classes.Named]]:
    """Terms of the catalogue whose class is certain, fitted without the others; their classes.

    A name beside something unnamed on the same part is likely half of it, and is not given.
    """
    kept = [
        i
        for i in found.accepted
        if i in cat.stated
        or (cat.named(i) and not doubt.same_part(signatures.machine, cat.candidates[i].place, rival))
    ]
    while True:
        selection = only(signatures, cat, found, fits.outliers, kept)
        after = selection.fit
        excess = max(after.chi2 - (after.readings - after.effective_parameters), 0.0)
        unexplained = 0.5 * excess / max(after.chi2_per_dof, 1.0)
        named = [
            classes.name_term(
                selection.linearisation, cat, selection.grid, selection.accepted, i, unexplained
            )
            for i in selection.accepted
            if i not in cat.stated
        ]
        certain = [n.index for n in named if n.certainty >= classes.CERTAIN]
        if len(certain) == len(named):
            return selection, named
        kept = [*cat.stated, *certain]


def _findings(
    machine: Machine, cat: Catalogue, selection: Selection, named: Sequence[classes.Named]
) -> tuple[Finding, ...]:
    lin, grid, accepted = selection.linearisation, selection.grid, selection.accepted
    flips = [classes.flip_inflation(lin, cat, grid, accepted, n.index, THRESHOLD) for n in named]
    return merge_findings(machine, cat, selection.fit, named, flips)


def _verdict(
    findings: Sequence[Finding],
    rival: Remainder | None,
    left: alarms.Structure,
    lin: Linearisation,
    free: Estimate,
    inflation: Mapping[str, float],
    residual: alarms.Alarm,
) -> str:
    """Names where there are any; ``unknown`` where something is left and nothing has a name; else adequate."""
    if findings:
        return "missing-physics"
    noise = max(float(np.sqrt(free.chi2_per_dof)), 1.0)
    widened = {part: max(value, 1.0) for part, value in inflation.items()}
    conflict = alarms.prior_conflict(lin, noise, widened).p < UNKNOWN_P
    return "unknown" if rival or left.alarm.p < UNKNOWN_P or conflict or _lacks_fit(residual) else "adequate"


def _lacks_fit(alarm: alarms.Alarm) -> bool:
    """More misfit than replicates allow; without any, than a stated sigma that is wrong by three would make."""
    return alarm.p < UNKNOWN_P and (alarm.about == "replicates" or alarm.statistic > SIGMA_OFF**2)


def _remainder(
    verdict: str, rival: Remainder | None, after: Estimate, recording: Recording, left: alarms.Structure
) -> Remainder | None:
    if verdict == "adequate":
        return None
    if rival is not None:
        return rival
    return remainder.describe(after, recording, left) if verdict == "unknown" or left.alarm.raised else None


def _candidates(cat: Catalogue, ranking: Ranking) -> tuple[Alternative, ...]:
    """Every screened candidate, best first, weighed alone against the model without effects."""
    odds = np.append(ranking.odds, 0.0)
    share = np.exp(odds - np.logaddexp.reduce(odds))
    order = [i for i in np.argsort(-ranking.odds) if cat.named(int(i))]
    return tuple(alternative(cat, int(i), float(share[i]), float(ranking.gain[i])) for i in order)


def _map(cat: Catalogue, ranking: Ranking) -> dict[str, float]:
    """Largest log Bayes factor at each single place; constants count for the part they belong to."""
    out: dict[str, float] = {}
    for i, gain in zip(ranking.indices, ranking.gain, strict=True):
        place = cat.candidates[i].place
        if len(place) == 1 and cat.named(i):
            part = place[0].partition(".")[0]
            out[part] = max(out.get(part, -np.inf), float(gain))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def _tolerance_notes(inflation: Mapping[str, float]) -> list[str]:
    """Which tolerances look too small; one line where all do alike."""
    values = list(inflation.values())
    if len(values) > 1 and min(values) > 1.5 and max(values) < 1.2 * min(values):
        return [f"without effects, all tolerances look {max(values):.1f} times too small"]
    return [
        f"without effects, {_class_words(label)} tolerances look {value:.1f} times too small"
        for label, value in inflation.items()
        if value > 1.5
    ]


def _class_words(label: str) -> str:
    """``length:leg.a``: the length (leg.a)."""
    kind, _, group = label.partition(":")
    return f"{kind} ({group})" if group else kind


def _notes(
    recording: Recording, before: Estimate, screened: Ranking, inflation: Mapping[str, float]
) -> tuple[str, ...]:
    notes = list(recording.notes)
    notes += [
        f"row {recording.source_row[k]} of {recording.files[recording.source_file[k]]} cannot be assembled and was left out"
        for k in before.unassembled
    ]
    if not 0.8 < screened.evidence.noise < 1.25:
        notes.append(
            f"without effects the readings scatter {screened.evidence.noise:.2g} times the stated sigma"
        )
    return (*notes, *_tolerance_notes(inflation))
