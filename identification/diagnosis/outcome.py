"""From a posterior to what is said and what is applied: names, the verdict, and the models that stand behind both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.applied import Choice, Model, chosen_model, refit, told
from truepose.identification.diagnosis.average import averaged
from truepose.identification.diagnosis.holdout import Comparison, held_out_blocks
from truepose.identification.diagnosis.judgement import Judgement, judged
from truepose.identification.diagnosis.model import remainder_shapes
from truepose.identification.diagnosis.naming import NAMED
from truepose.identification.diagnosis.proof import prove
from truepose.identification.diagnosis.result import WHOLE, Applied, Proof
from truepose.identification.diagnosis.search import Found, chosen
from truepose.identification.diagnosis.summary import SURE, Summary, summarised, verdict
from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.summary import summarise
from truepose.identification.prior import STATED

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Fits:
    """The ordinary fit, the one under tolerances, both without effects, and the rows (n,) that both leave out."""

    free: Estimate
    before: Estimate
    outliers: Mask

    @property
    def rms(self) -> float:
        """Of the whitened residual of the worse of both."""
        return float(np.sqrt(max(self.before.chi2_per_dof, self.free.chi2_per_dof)))


@dataclass(frozen=True)
class Outcome:
    """What is said, what has no name, and the verdict.

    likeliest: the fit with the likeliest set, which findings and proof speak of; after: the one that is applied. raised, left:
    the alarms before and after; gain: what forms without a name add on held-out rows, by kind of reading (mm, rad).
    """

    summary: Summary
    nameless: tuple[int, ...]
    likeliest: Estimate
    after: Estimate
    proof: Proof | None
    verdict: str
    raised: Judgement
    left: Judgement
    gain: Mapping[str, float]
    applied: Applied


def concluded(fits: Fits, found: Found) -> Outcome:
    """What is said, and what is applied."""
    recording = found.signatures.recording
    raised = judged(fits.free, fits.before, found.linearisation_before, recording)
    model = _likeliest(fits, found)
    found = _there(found, model)
    summary, nameless = summarised(found, model.fit), model.nameless(found)
    choice = Choice.of(
        found,
        fits.before,
        fits.outliers,
        held_out_blocks(recording, fits.before.used),
        _known(found, summary),
    )
    whole = choice.compared(model.fit)
    main = next((i for n in summary.laws for i in n.candidates), next(iter(nameless), None))
    proof = None if main is None else prove(fits.before, model.fit, whole, found, main, fits.outliers)
    said = verdict(summary, raised)
    if said == "adequate":
        same = choice.plain.against(choice.plain)
        applied = told("plain", same, same)
        return Outcome(summary, (), fits.before, fits.before, None, said, raised, raised, {}, applied)
    names = _names(fits, found, model)
    after, applied = _applied(choice, model, names, summary, whole)
    left = judged(after, after, found.linearisation, recording)
    gain = _gain(choice, names, whole) if nameless else {}
    proof = proof if summary.laws else None
    return Outcome(summary, nameless, model.fit, after, proof, said, raised, left, gain, applied)


def _there(found: Found, model: Model) -> Found:
    """Linear at the likeliest model's own fit, so that the form of everything it holds is tested."""
    held = {effect.label for effect in model.fit.effects}
    if held == {effect.label for effect in found.fit.effects}:
        return found
    return replace(found, fit=model.fit, linearisation=found.signatures.linearise(model.fit))


def _known(found: Found, summary: Summary) -> list[str]:
    """Labels of terms that are likely there by name, and act at their place by their driver for sure."""
    sure = [
        i for n in summary.laws if n.levels.driver >= SURE and n.probability >= NAMED for i in n.candidates
    ]
    return [found.catalogue.candidates[i].label for i in sure]


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
    choice: Choice, model: Model, names: Model | None, summary: Summary, whole: Comparison
) -> tuple[Estimate, Applied]:
    """What is applied: averaged over explanations where all that was found may be, else the largest model that may."""
    sure = [i for n in summary.laws if n.levels.driver >= SURE for i in n.candidates]
    label, less, held = chosen_model(choice, model, names, sure, whole)
    if less is None:
        return choice.before, told(label, held, whole)
    if label != WHOLE:
        return less.fit, told(label, held, whole)
    after = averaged(choice.found, model.fit)
    seen = choice.as_it_is(after)
    if seen is None:
        return after, told(label, held, whole)
    return (model.fit, told(label, held, whole)) if seen.worse else (after, told(label, seen, seen))


def _gain(choice: Choice, names: Model | None, whole: Comparison) -> Mapping[str, float]:
    """By how much forms without a name lower the rms of held-out rows beside the names, by kind of reading (mm, rad)."""
    without = 1.0 if names is None else choice.judged(names.fit).ratio
    if whole.ratio >= without:
        return {}
    summary = summarise(choice.before, choice.found.signatures.recording.validation)
    rms = summary.validation_rms or summary.rms
    return {kind: (without - whole.ratio) * value for kind, value in rms.items()}
