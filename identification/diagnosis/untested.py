"""What could not be tested keeps its share: a deflection where the machine file states no gravity.

Without ``gravity:`` no effect of weight is a candidate, and what it does to the readings leaves its evidence to whatever
resembles it most, often a wave of the same joint. So each name is compared with what a compliance of each joint would
make if gravity pulled along the base's -z: a share R^2 of the name's signal, all geometry free in its tolerances. Had it been
tested, it would have lost (1 - R^2) E / (2 (1 + f^2 E)) nats against the name: E is the sum of squares of that signal in the
noise, f the error of form (a tenth) that every formula has.

A compliance is often taken for a wave of its joint *and* curves without a name beside it. So the name's signal together with
theirs is compared, too; a compliance alone would then be as much likelier beforehand as those curves were unlikely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.levels import Levels, parts_of
from truepose.identification.diagnosis.naming import SHOWN, Named, Rival
from truepose.identification.diagnosis.search import Found
from truepose.identification.prior import FORM_ERROR
from truepose.identification.signatures.linearisation import Linearisation, Signatures
from truepose.identification.signatures.untestable import GRAVITY
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.effects.empirical import Empirical
from truepose.models.machine import Machine
from truepose.models.placed import EffectAtPlace

Array = NDArray[np.float64]
COMPLIANCE = "joint-compliance"


def beside_untested(found: Found, names: Sequence[Named]) -> tuple[Named, ...]:
    """Names with the share that deflections have which nobody could test; as they are where gravity is stated."""
    machine = found.signatures.machine
    if machine.gravity is not None or not any(not n.nameless for n in names):
        return tuple(names)
    there = replace(machine, gravity=GRAVITY)
    unseen = _deflections(there, found)
    if not unseen:
        return tuple(names)
    signatures = Signatures(there, found.signatures.recording, (*found.fit.effects, *unseen))
    lin = signatures.linearise(found.fit)
    left = _left_by_geometry(lin, _noise(found))
    return tuple(n if n.nameless else _shared(found, n, lin, left, unseen) for n in names)


def without_untested(found: Found, names: Sequence[Named]) -> tuple[Named, ...]:
    """Names as they are said: one that an untested deflection outweighs is a place without a law, driven by load as far as
    that is known; curves without a name beside it, which the deflection explains as well, go with it."""
    taken = {i for n in names if _outweighed(n) for i in _beside(found, n)[0]}
    kept = [n for n in names if not (n.nameless and set(n.candidates) <= taken)]
    return tuple(_lawless(found, n) if _outweighed(n) else n for n in kept)


def _outweighed(name: Named) -> bool:
    untested = [m.probability for m in name.equivalents if not m.tested]
    return not name.nameless and max(untested, default=0.0) > name.probability


def _lawless(found: Found, name: Named) -> Named:
    itself = Rival(name.cause, name.probability, name.gain)
    driver = sum(m.probability for m in name.equivalents if not m.tested)
    return replace(
        name,
        cause=EffectAtPlace(Empirical.slug, name.cause.place[:1]),
        candidates=(*_beside(found, name)[0], *name.candidates),
        probability=0.0,
        equivalents=tuple(sorted((*name.equivalents, itself), key=lambda m: -m.probability)),
        levels=Levels(name.levels.place, "load", min(driver, name.levels.place)),
        tested=False,
    )


def _deflections(machine: Machine, found: Found) -> list[PlacedEffect]:
    """A compliance of every joint, at every load that may be meant."""
    effect, recording = effects.get(COMPLIANCE, "untested")(), found.signatures.recording
    places = [tuple(place) for place in effect.places(machine) if effect.screened(machine, tuple(place))]
    made = [
        PlacedEffect.at(effect, machine, place, settings)
        for place in places
        for settings in effect.settings(machine, place, recording)
    ]
    return [placed for placed in made if not placed.bent]


def _noise(found: Found) -> float:
    unknowns = found.problem.spike_slab.unknowns
    return float(unknowns.noise[0].values[found.mode.point.noise[0]])


def _left_by_geometry(lin: Linearisation, noise: float) -> Array:
    """(w, w) Gram matrix of the columns of G in units of the noise, geometry free in its tolerances."""
    n, width = lin.free, lin.columns[-1].stop
    gram = lin.gram / noise**2
    own, across = gram[:n, :n] + np.diag(lin.weight**2), gram[:n, n : n + width]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(own), 1e-300))
    half = np.linalg.lstsq(own * scale[:, None] * scale, across * scale[:, None], rcond=1e-12)[0]
    return np.asarray(gram[n : n + width, n : n + width] - (across * scale[:, None]).T @ half)


def _shared(
    found: Found, name: Named, lin: Linearisation, left: Array, unseen: Sequence[PlacedEffect]
) -> Named:
    """A name beside each joint's compliance: less probable by how well that would explain the same signal."""
    beside, log_prior = _beside(found, name)
    wholes = [(name.candidates, 0.0), ((*name.candidates, *beside), log_prior)][: 2 if beside else 1]
    odds: dict[tuple[str, ...], float] = {}
    for placed in unseen:
        worth = sum(_worth(found, own, lin, left, placed) * np.exp(-rare) for own, rare in wholes)
        odds[placed.place] = max(odds.get(placed.place, 0.0), float(worth))
    rarer = _prior_ratio(found, name, len(odds), unseen[0].effect.commonness)
    return _with_rivals(found, name, {place: rarer * worth for place, worth in odds.items()})


def _beside(found: Found, name: Named) -> tuple[tuple[int, ...], float]:
    """Candidates without a name that the likeliest set has at the name's parts, and the log prior of their terms."""
    machine, cat, problem = found.signatures.machine, found.catalogue, found.problem
    parts, held = (
        set(parts_of(machine, name.cause.effect, name.cause.place)),
        {e.label for e in found.fit.effects},
    )
    own: list[int] = []
    log_prior = 0.0
    for term, _ in found.mode.members:
        i = problem.candidates[term]
        forms = [i] if not cat.named(i) and cat.candidates[i].label in held else []
        if forms and parts & set(parts_of(machine, Empirical.slug, cat.candidates[forms[0]].place)):
            own += forms
            log_prior += float(problem.spike_slab.terms.log_first[term])
    return tuple(own), log_prior


def _worth(found: Found, own: Sequence[int], lin: Linearisation, left: Array, placed: PlacedEffect) -> float:
    """Likelihood of a compliance over that of the candidates ``own`` whose signal it would have to explain."""
    labels = {candidate.label: k for k, candidate in enumerate(lin.candidates)}
    at = np.array(lin.indices([labels[found.catalogue.candidates[i].label] for i in own]), dtype=np.intp)
    signal = np.zeros(len(left))
    signal[at] = lin.departure[lin.free + at]
    energy = float(signal @ left @ signal)
    (column,) = lin.indices([labels[placed.label]])
    length = float(left[column, column])
    alike = float(left[column] @ signal) ** 2 / max(energy * length, 1e-300) if length > 0.0 else 0.0
    return float(np.exp(-0.5 * (1.0 - min(alike, 1.0)) * energy / (1.0 + FORM_ERROR**2 * energy)))


def _prior_ratio(found: Found, name: Named, joints: int, commonness: float) -> float:
    """Prior odds of a compliance of one of so many joints against the name at its place."""
    alike = {c.place for c in found.catalogue.candidates if c.effect.slug == name.cause.effect}
    own = found.catalogue.candidates[name.candidates[0]].effect.commonness
    return commonness / joints * max(len(alike), 1) / own


def _with_rivals(found: Found, name: Named, odds: dict[tuple[str, ...], float]) -> Named:
    machine, total = found.signatures.machine, sum(odds.values())
    kept, parts = 1.0 / (1.0 + total), set(parts_of(machine, name.cause.effect, name.cause.place))
    here = sum(worth for place, worth in odds.items() if parts & set(parts_of(machine, COMPLIANCE, place)))
    rivals = [
        Rival(EffectAtPlace(COMPLIANCE, place), name.probability * worth * kept, name.gain, tested=False)
        for place, worth in odds.items()
        if name.probability * worth * kept > SHOWN
    ]
    levels = Levels(name.levels.place * (1.0 + here) * kept, name.levels.kind, name.levels.driver * kept)
    alike = tuple(replace(m, probability=m.probability * kept) for m in name.equivalents)
    ranked = sorted((*alike, *rivals), key=lambda m: -m.probability)
    return replace(name, probability=name.probability * kept, equivalents=tuple(ranked), levels=levels)


__all__ = ["beside_untested", "without_untested"]
