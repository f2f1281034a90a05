"""What may be there in a name's stead: something that is only like it, or something that could not be tested.

What the catalogue does not know often resembles something that it knows. Such a thing is the name's signal, modulated by a
joint or driver far more than a formula is ever wrong. Both are weighed for every name, beside all others of the likeliest set.
Where a formula has terms that bend it, what these carry is an error of form that was found.

What could not be tested keeps its share: without ``gravity:`` no effect of weight is a candidate, and what it does to the
readings leaves its evidence to whatever resembles it most, often a wave of the same joint. So each name is compared with what
a compliance of each joint would make if gravity pulled along the base's -z: a share R^2 of the name's signal, all geometry free
in its tolerances. Had it been tested, it would have lost (1 - R^2) E / (2 (1 + f^2 E)) nats against the name: E is the sum of
squares of that signal in the noise, f the error of form (a tenth) that every formula has.

A compliance is often taken for a wave of its joint *and* curves without a name beside it. So the name's signal together with
theirs is compared, too; a compliance alone would then be as much likelier beforehand as those curves were unlikely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification import prior
from truepose.identification.diagnosis.posterior_summary import SHOWN, Named, Rival, parts_of
from truepose.identification.diagnosis.result import Levels
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import design_with_forms
from truepose.identification.posterior.marginal import marginal
from truepose.identification.prior import FORM_ERROR, OFF_FORM, POOR
from truepose.identification.signatures.linearisation import PAIR, Linearisation
from truepose.identification.signatures.signatures import Signatures
from truepose.identification.signatures.untestable import GRAVITY, places_of
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import element_of
from truepose.models.machine.placed import EffectAtPlace

COMPLIANCE = "joint-compliance"
FINER = (0, -2, -4, -8)
"""Steps of the noise at which all is weighed: with more freedom it can only be smaller."""


class Likeness(NamedTuple):
    """Probability that something like a name is the thing itself, and whether its form could be tested at all."""

    itself: float
    tested: bool


def forms_hold(found: Found, nameless: float, names: Sequence[Sequence[int]]) -> list[Likeness]:
    """Whether each name (its candidates), if something like it is there, is the thing itself.

    ``nameless``: that something without a name is there anyway; what resembles a name is then likelier a part of it. A name
    larger than its physics usually is costs what its prior says: something else knows no usual size.
    """
    if not names:
        return []
    odds = (1.0 - nameless) * prior.ONLY_ALIKE + nameless * prior.PART_OF_IT
    every = _gains(found, [_modulated(found, name) for name in names])
    out = list[Likeness]()
    for gains, name in zip(every, names, strict=True):
        rarer = odds * prior.beyond_usual(_size(found, name))
        out.append(Likeness(held_probability(gains, rarer, _bent(found, name)), bool(len(gains))))
    return out


def _size(found: Found, name: Sequence[int]) -> float:
    """Fitted size of a name's straight terms: root mean square of their coefficients, each in its largest usual size."""
    lin, cat = found.linearisation, found.catalogue
    own = [i for i in name if not cat.candidates[i].bent] or list(name)
    amplitudes = lin.departure[lin.free + np.array(lin.indices(own), dtype=np.intp)]
    return float(np.sqrt(np.sum(amplitudes**2) / sum(len(cat.candidates[i].coefficients) for i in own)))


def _bent(found: Found, name: Sequence[int]) -> float:
    """Share of a name's fitted signal that its formula does not follow, only terms that bend it; 0 without any."""
    lin, cat = found.linearisation, found.catalogue
    if not any(cat.candidates[i].bent for i in name):
        return 0.0
    cause = cat.cause(name[0])
    straight = [i for i, c in enumerate(cat.candidates) if cat.cause(i) == cause and not c.bent]
    own, base = (lin.free + np.array(lin.indices(some), dtype=np.intp) for some in (name, straight))
    amplitude = lin.departure[own]
    whole = float(amplitude @ lin.among(own) @ amplitude)
    across = lin.among(base, own) @ amplitude
    followed = float(across @ np.linalg.lstsq(lin.among(base), across, rcond=None)[0])
    return float(np.sqrt(max(1.0 - followed / whole, 0.0))) if whole > 0.0 else 0.0


def _modulated(found: Found, name: Sequence[int]) -> list[Index]:
    """Columns of F of a name's signals by each source; its own joint says how it works, not that it is another thing."""
    lin, cat = found.linearisation, found.catalogue
    own = {element_of(part) for i in name for part in cat.candidates[i].place}
    signals = [k for k, own in enumerate(lin.bent) if set(own) & set(name)]
    each = PAIR * len(lin.sources)
    return [
        np.array([k * each + PAIR * s + i for k in signals for i in range(PAIR)], dtype=np.intp)
        for s, source in enumerate(lin.sources)
        if signals and source not in own
    ]


def _gains(found: Found, wanted: Sequence[Sequence[Index]]) -> list[Array]:
    """(sources, shares) for each name: log Bayes factors of its modulated signal beside the likeliest set."""
    problem, lin = found.problem, found.linearisation
    columns, sizes = problem.spike_slab.columns(found.mode.members)
    part = design_with_forms(lin, found.catalogue, problem, columns)
    first, scale = len(columns), np.array(OFF_FORM) * np.sqrt(len(lin.sources)) / FORM_ERROR
    plain, best = -np.inf, [np.full((len(own), len(OFF_FORM)), -np.inf) for own in wanted]
    for step in (step for step in FINER if min(found.mode.point.noise) + step >= 0):
        point = found.mode.point.louder(step)
        root = marginal(part, problem.spike_slab.unknowns, problem.spike_slab.terms, point)
        there = root.including(np.arange(first), sizes)
        plain = max(plain, there.log_evidence)
        for gains, own in zip(best, wanted, strict=True):
            new = [[there.gain(first + at, np.full(len(at), size)) for size in scale] for at in own]
            if new:
                gains[:] = np.maximum(gains, there.log_evidence + np.array(new))
    return [gains - plain for gains in best]


def held_probability(gains: Array, odds: float, bent: float = 0.0) -> float:
    """From prior odds of the rival and log Bayes factors (sources, shares), sources all as likely; without any, untested.

    ``bent``: the share of the signal that bends the formula; it is a source of its own, already in the set.
    """
    if not len(gains):
        return 1.0 / (1.0 + odds)
    if bent > 0.0:
        shares = np.array([FORM_ERROR, *OFF_FORM])
        likely = -0.5 * (bent / shares) ** 2 - np.log(shares)
        gains = np.vstack([gains, likely[1:] - likely[0]])
    by_share = np.logaddexp.reduce(gains, axis=0) - np.log(len(gains))
    itself = np.logaddexp(np.log(1.0 - POOR), np.log(POOR) + by_share[0])
    other = np.logaddexp.reduce(by_share[1:]) - np.log(len(by_share) - 1)
    return float(1.0 / (1.0 + odds * np.exp(np.clip(other - itself, -700.0, 700.0))))


def beside_untested(found: Found, names: Sequence[Named]) -> tuple[Named, ...]:
    """Names with the share that deflections have which nobody could test; as they are where gravity is stated."""
    machine = found.signatures.machine
    if machine.gravity is not None or all(n.nameless for n in names):
        return tuple(names)
    there = replace(machine, gravity=GRAVITY)
    unseen = _deflections(there, found)
    if not unseen:
        return tuple(names)
    signatures = Signatures(there, found.signatures.recording, (*found.fit.effects, *unseen))
    lin = signatures.linearise(found.fit)
    left = _left_by_geometry(lin, float(found.problem.spike_slab.unknowns.scales(found.mode.point)[0]))
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
    candidates = (*_beside(found, name)[0], *name.candidates)
    others = tuple(sorted((*name.equivalents, itself), key=lambda m: -m.probability))
    cause = EffectAtPlace(Empirical.slug, name.cause.place[:1])
    levels = Levels(name.levels.place, "load", min(driver, name.levels.place))
    return Named(cause, candidates, 0.0, name.certainty, others, name.gain, name.family, levels, tested=False)


def _deflections(machine: Machine, found: Found) -> list[PlacedEffect]:
    """A compliance of every joint, at every load that may be meant; not of joints whose measured torque tested it."""
    effect, recording = effects.get(COMPLIANCE, "untested")(), found.signatures.recording
    tested = {c.place for c in found.catalogue.candidates if c.effect.slug == COMPLIANCE}
    made = list[PlacedEffect]()
    for place in (place for place in places_of(effect, machine) if place not in tested):
        settings = effect.settings(machine, place, recording)
        made += [PlacedEffect.at(effect, machine, place, one) for one in settings]
    return [placed for placed in made if not placed.bent]


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
    # prior odds of a compliance of one of so many joints against the name at its place
    alike = {c.place for c in found.catalogue.candidates if c.effect.slug == name.cause.effect}
    commonness, own = (
        unseen[0].effect.commonness,
        found.catalogue.candidates[name.candidates[0]].effect.commonness,
    )
    rarer = commonness / len(odds) * max(len(alike), 1) / own
    return _with_rivals(found, name, {place: rarer * worth for place, worth in odds.items()})


def _beside(found: Found, name: Named) -> tuple[tuple[int, ...], float]:
    """Candidates without a name that the likeliest set has at the name's parts, and the log prior of their terms."""
    machine, cat, problem = found.signatures.machine, found.catalogue, found.problem
    parts, held = set(parts_of(machine, *name.cause)), {e.label for e in found.fit.effects}
    terms = {problem.candidates[term]: term for term, _ in found.mode.members}
    nameless = [i for i in terms if not cat.named(i) and cat.candidates[i].label in held]
    own = [i for i in nameless if parts & set(parts_of(machine, *cat.cause(i)))]
    return tuple(own), sum(float(problem.spike_slab.terms.log_first[terms[i]]) for i in own)


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


def _with_rivals(found: Found, name: Named, odds: dict[tuple[str, ...], float]) -> Named:
    machine, total = found.signatures.machine, sum(odds.values())
    kept, parts = 1.0 / (1.0 + total), set(parts_of(machine, *name.cause))
    here = sum(worth for place, worth in odds.items() if parts & set(parts_of(machine, COMPLIANCE, place)))
    likely = ((place, name.probability * worth * kept) for place, worth in odds.items())
    causes = ((EffectAtPlace(COMPLIANCE, place), p) for place, p in likely if p > SHOWN)
    rivals = [Rival(cause, p, name.gain, tested=False) for cause, p in causes]
    levels = Levels(name.levels.place * (1.0 + here) * kept, name.levels.kind, name.levels.driver * kept)
    alike = tuple(replace(m, probability=m.probability * kept) for m in name.equivalents)
    ranked = sorted((*alike, *rivals), key=lambda m: -m.probability)
    return replace(name, probability=name.probability * kept, equivalents=tuple(ranked), levels=levels)
