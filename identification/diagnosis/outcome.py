"""From a posterior to what is said: names, the verdict, and the models that stand behind both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.average import averaged
from truepose.identification.diagnosis.inclusion import Inclusion, inclusion
from truepose.identification.diagnosis.judgement import Judgement, judged
from truepose.identification.diagnosis.model import Shape, fitted, remainder_shapes
from truepose.identification.diagnosis.naming import NAMED, Named, as_named, named
from truepose.identification.diagnosis.proof import prove
from truepose.identification.diagnosis.result import Proof
from truepose.identification.diagnosis.search import Found, chosen
from truepose.identification.diagnosis.weighed import WIDE
from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.summary import summarise
from truepose.identification.recording.recording import Recording

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SURE = 0.9
"""Probability from which on something without a name is said to be there."""


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
    """What was named, what has no name, and the verdict.

    likeliest: the fit with the likeliest set, which findings and proof speak of; after: the one that predicts, with what
    other sets hold. raised, left: the alarms before and after; gain: what ``proof`` is worth, by kind of reading (mm, rad).
    """

    names: tuple[Named, ...]
    nameless: tuple[int, ...]
    likeliest: Estimate
    after: Estimate
    proof: Proof | None
    verdict: str
    raised: Judgement
    left: Judgement
    said: Inclusion
    gain: Mapping[str, float]


@dataclass(frozen=True)
class _Model:
    """The likeliest set: candidates with their spreads, forms of the remainder, and the fit with both."""

    accepted: Mapping[int, float]
    shapes: tuple[Shape, ...]
    fit: Estimate

    def nameless(self, found: Found) -> tuple[int, ...]:
        """What has no name and is in the fit."""
        cat, held = found.catalogue, {e.label for e in self.fit.effects}
        every = (*(i for i in self.accepted if not cat.named(i)), *(s.candidate for s in self.shapes))
        return tuple(i for i in every if cat.candidates[i].label in held)


def concluded(fits: Fits, found: Found) -> Outcome:
    """Names, what has none, and the verdict."""
    recording, said = found.signatures.recording, inclusion(found.weighed, found.posterior)
    raised = judged(fits.free, fits.before, found.linearisation_before, recording)
    model = _likeliest(fits, found)
    every = tuple(n for n in named(found, said) if set(n.candidates) <= set(model.accepted))
    said, nameless = as_named(said, every), model.nameless(found)
    main = next((i for n in every for i in n.candidates), next(iter(nameless), None))
    proof = prove(fits.before, model.fit, found, main, fits.outliers) if main is not None else None
    names = tuple(n for n in every if n.certainty >= NAMED)
    verdict = _verdict(every, raised, proof, sure=said.nameless > SURE)
    if verdict == "adequate":
        return Outcome((), (), fits.before, fits.before, None, verdict, raised, raised, said, {})
    after = averaged(found, model.fit)
    left = judged(after, after, found.linearisation, recording) if names else raised
    gain = _gain(fits.before, recording, proof) if nameless else {}
    told = proof if names else None
    return Outcome(names, nameless, model.fit, after, told, verdict, raised, left, said, gain)


def _likeliest(fits: Fits, found: Found) -> _Model:
    """Where no minimum is found with the likeliest set, the fit of the last expansion point stands, and what it holds."""
    accepted = dict.fromkeys(found.catalogue.stated, WIDE) | chosen(found.weighed, found.mode)
    shapes = remainder_shapes(found)
    fit = fitted(found, accepted, shapes, fits.outliers) if accepted or shapes else fits.before
    return _Model(dict(found.accepted), (), found.fit) if fit is None else _Model(accepted, shapes, fit)


def _gain(before: Estimate, recording: Recording, proof: Proof | None) -> Mapping[str, float]:
    """By how much the model lowers the rms of held-out rows, by kind of reading (mm, rad); nothing where it does not."""
    if proof is None or proof.ratio >= 1.0:
        return {}
    summary = summarise(before, recording.validation)
    rms = summary.validation_rms or summary.rms
    return {kind: (1.0 - proof.ratio) * value for kind, value in rms.items()}


def _verdict(every: tuple[Named, ...], raised: Judgement, proof: Proof | None, *, sure: bool) -> str:
    if any(n.certainty >= NAMED for n in every):
        return "missing-physics"
    if any(n.present >= NAMED for n in every):
        return "unknown"  # it is there, and its name is doubtful
    return _without_names(raised, proof, sure=sure)


def _without_names(raised: Judgement, proof: Proof | None, *, sure: bool) -> str:
    """``unknown`` where something ``sure`` is worth something or makes a clear misfit, or where noise alone cannot make it."""
    worth = proof is not None and proof.ratio < 1.0
    return "unknown" if (sure and (worth or raised.clear)) or raised.misfits else "adequate"
