"""The whole procedure: detect, locate, name or abstain, model, prove.

``diagnose`` is the one entry; every step is a module of this package.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.align import aligned_start
from truepose.identification.diagnosis import alarms, classes, outliers, remainder, summary
from truepose.identification.diagnosis.candidates import Catalogue, catalogue
from truepose.identification.diagnosis.findings import merge_findings, alternative
from truepose.identification.diagnosis.proof import prove
from truepose.identification.diagnosis.result import Alternative, Diagnosis, Finding, Proof
from truepose.identification.diagnosis.selection import Ranking, Selection, rank, select
from truepose.identification.diagnosis.signatures import Signatures
from truepose.identification.estimate import FREE_WIDENING, Estimate, estimate
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.models.machine import Machine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
CONCEALED = 1.3
"""Free-fit chi2 per degree of freedom below which an ordinary fit looks good."""
CERTAIN = 0.95
UNKNOWN_P = 1e-3
EXPLAINED = 0.5
"""Share of the misfit that findings must explain before their names are believed."""


@dataclass(frozen=True)
class _Fits:
    free: Estimate
    before: Estimate
    outliers: Mask


def diagnose(machine: Machine, recording: Recording, *, progress: Callable[[str], None] = lambda _: None) -> Diagnosis:
    """Say what physics the model of ``machine`` leaves out of ``recording``, model it and prove it.

    Raises InputError for unusable input and ConvergenceError when the fit without effects finds no minimum.
    """
    progress("fitting without effects")
    fits = _null_fits(machine, recording)
    cat = catalogue(machine, recording)
    progress(f"weighing {len(cat.candidates)} explanations")
    selection = _select(machine, recording, cat, fits)
    again = outliers.outlying_rows(selection.fit, ~recording.validation)
    if not np.array_equal(again, fits.outliers):
        fits = _refit_null(machine, recording, fits, again)
        selection = _select(machine, recording, cat, fits, selection)
    progress("naming and proving")
    return _conclude(machine, recording, cat, fits, selection)


def _null_fits(machine: Machine, recording: Recording) -> _Fits:
    predictor = Predictor(machine, recording)
    start = aligned_start(predictor)
    rough = estimate(machine, recording, start=start, loss="huber", predictor=predictor)
    far = outliers.outlying_rows(rough, ~recording.validation)
    before = estimate(machine, recording, start=rough.p, exclude=far, predictor=predictor)
    free = estimate(machine, recording, start=before.p, widen=FREE_WIDENING, exclude=far, predictor=predictor)
    return _Fits(free, before, far)


def _refit_null(machine: Machine, recording: Recording, fits: _Fits, far: Mask) -> _Fits:
    before = estimate(machine, recording, start=fits.before.p, exclude=far)
    free = estimate(machine, recording, start=fits.free.p, widen=FREE_WIDENING, exclude=far)
    return _Fits(free, before, far)


def _select(
    machine: Machine, recording: Recording, cat: Catalogue, fits: _Fits, first: Selection | None = None
) -> Selection:
    rms = float(np.sqrt(max(fits.before.chi2_per_dof, fits.free.chi2_per_dof)))
    return select(machine, recording, cat, fits.before, fits.outliers, rms, first)


def _conclude(machine: Machine, recording: Recording, cat: Catalogue, fits: _Fits, selection: Selection) -> Diagnosis:
    free, before, after = fits.free, fits.before, selection.fit
    signatures = Signatures(machine, recording, cat.candidates)
    lin = signatures.linearise(before)
    screened = rank(lin, cat, selection.grid, {}, list(range(len(cat.candidates))))
    noise = float(np.sqrt(max(free.chi2_per_dof, 1e-300)))
    inflation = dict(zip(selection.grid.classes, screened.evidence.inflation, strict=True))
    structure = alarms.structure_alarm(before, recording)
    raised = {
        "residual": alarms.residual_alarm(free, recording),
        "prior_conflict": alarms.prior_conflict(lin, max(noise, 1.0) if noise < CONCEALED else noise),
        "structure": structure.alarm,
    }
    left = alarms.structure_alarm(after, recording) if selection.accepted else structure
    named = [classes.name_term(selection.linearisation, cat, selection.grid, selection.accepted, i) for i in selection.accepted]
    flips = [classes.flip_inflation(selection.linearisation, cat, selection.grid, selection.accepted, n.index, 3.0) for n in named]
    findings = merge_findings(machine, cat, after, named, flips)
    believed = _believed(findings, before, after, raised, left)
    unexplained = left.alarm.p < UNKNOWN_P or (not selection.accepted and _conflict(lin, noise, inflation))
    verdict = "missing-physics" if believed else ("unknown" if unexplained or findings else "adequate")
    channels = Predictor(machine, recording).channels
    fits_summary = {name: summary.summarise(fit, channels, recording.validation) for name, fit in (("free", free), ("before", before), ("after", after))}
    proof = _prove(before, after, recording, fits.outliers, signatures, cat, selection) if selection.accepted else None
    outlier_rows = tuple(int(recording.source_row[k]) for k in np.flatnonzero(fits.outliers))
    return Diagnosis(
        machine=machine,
        recording=recording,
        verdict=verdict,
        concealed=verdict != "adequate" and free.chi2_per_dof < CONCEALED,
        alarms=raised,
        structure=left,
        findings=findings if believed else (),
        remainder=remainder.describe(after, recording, left) if verdict == "unknown" or left.alarm.raised else None,
        candidates=_candidates(machine, cat, screened),
        evidence_map=_map(cat, screened),
        untestable=cat.untestable,
        free=free,
        before=before,
        after=after,
        fits=fits_summary,
        proof=proof,
        terms=after.fitted_effects(),
        outlier_rows=outlier_rows,
        notes=_notes(recording, before, screened, inflation),
    )


def _prove(before: Estimate, after: Estimate, recording: Recording, far: Mask, signatures: Signatures, cat: Catalogue, selection: Selection) -> Proof:
    return prove(before, after, recording, far, signatures, cat, selection.grid, selection.accepted)


def _believed(findings: Sequence[Finding], before: Estimate, after: Estimate, raised: Mapping[str, alarms.Alarm], left: alarms.Structure) -> bool:
    """Names are believed when the class is certain and what they leave is small against what they explain."""
    if not findings or max(f.certainty for f in findings) < CERTAIN:
        return False
    gained = before.chi2 + _prior_cost(before) - after.chi2 - _prior_cost(after)
    excess = max(after.chi2 - (after.readings - after.effective_parameters), 0.0)
    return not (left.alarm.p < UNKNOWN_P and excess > gained)


def _prior_cost(fit: Estimate) -> float:
    free = fit.prior.free
    known = np.isfinite(fit.prior.sigma[free]) & (free < len(fit.machine.parameters))
    at = free[known]
    return float(np.sum(((fit.p[at] - fit.prior.mean[at]) / fit.prior.sigma[at]) ** 2))


def _conflict(lin: object, noise: float, inflation: Mapping[str, float]) -> bool:
    """Whether parameters conflict with tolerances even after the likeliest inflation of whole classes."""
    from truepose.identification.diagnosis.signatures import Linearisation

    assert isinstance(lin, Linearisation)
    return alarms.prior_conflict(lin, max(noise, 1.0), {k: max(v, 1.0) for k, v in inflation.items()}).p < UNKNOWN_P


def _candidates(machine: Machine, cat: Catalogue, ranking: Ranking) -> tuple[Alternative, ...]:
    """Every screened candidate, best first, weighed alone against the model without effects."""
    odds = np.append(ranking.odds, 0.0)
    share = np.exp(odds - np.logaddexp.reduce(odds))
    order = np.argsort(-ranking.odds)
    return tuple(alternative(cat, int(i), float(share[i]), float(ranking.gain[i])) for i in order)


def _map(cat: Catalogue, ranking: Ranking) -> dict[str, float]:
    """Largest log Bayes factor at each single place."""
    out: dict[str, float] = {}
    for i, gain in zip(ranking.indices, ranking.gain, strict=True):
        place = cat.candidates[i].place
        if len(place) == 1:
            out[place[0]] = max(out.get(place[0], -np.inf), float(gain))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def _notes(recording: Recording, before: Estimate, screened: Ranking, inflation: Mapping[str, float]) -> tuple[str, ...]:
    notes = list(recording.notes)
    notes += [f"row {recording.source_row[k]} of {recording.files[recording.source_file[k]]} cannot be assembled and was left out" for k in before.unassembled]
    if not 0.8 < screened.evidence.noise < 1.25:
        notes.append(f"without effects the readings scatter {screened.evidence.noise:.2g} times the stated sigma")
    notes += [f"without effects, {part} tolerances look {value:.1f} times too small" for part, value in inflation.items() if value > 1.5]
    return tuple(notes)
