"""What is named: causes of the likeliest set, each with the class of explanations that may stand in its slot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification import prior
from truepose.identification.diagnosis.inclusion import Inclusion
from truepose.identification.diagnosis.levels import UNKNOWN, Levels, Presence, driver_of, parts_of
from truepose.identification.diagnosis.likeness import forms_hold
from truepose.identification.diagnosis.search import Found
from truepose.identification.posterior.state import slot_odds, supports
from truepose.models.effects.empirical import Empirical
from truepose.models.placed import EffectAtPlace

NAMED = 0.5
"""Probability that a place with its driver, or a class, needs to be said."""
LEADING = 0.1
"""Probability from which on what is less probable than not is shown as leading."""
CERTAIN = 0.95
"""Probability from which on a name is said without its look-alikes."""
SHOWN = 0.02
"""Share of a slot from which on an explanation belongs to its class."""
CLASS_LIMIT = 8
FAMILY = 3
"""Places of one effect from which on they are told as a family."""


@dataclass(frozen=True)
class Rival:
    """Another explanation of a class: its cause, how probable it is, the log Bayes factor of it in the slot; whether it could
    be tested."""

    cause: EffectAtPlace
    probability: float
    gain: float
    tested: bool = True


@dataclass(frozen=True)
class Named:
    """A cause of the likeliest set: its candidates that the fit holds, how probable it is, and its class.

    ``certainty`` is the probability of the whole class; ``gain`` the log Bayes factor of the set with it against without.
    ``family``: the slug, where it is said of several places. levels: what is known of where it is and of what
    drives it; tested: whether its form was. A cause ``empirical`` has no law, and its ``probability`` is 0.
    """

    cause: EffectAtPlace
    candidates: tuple[int, ...]
    probability: float
    certainty: float
    equivalents: tuple[Rival, ...]
    gain: float = 0.0
    family: str = ""
    levels: Levels = UNKNOWN
    tested: bool = True

    @property
    def nameless(self) -> bool:
        """Whether only its place and its driver are known."""
        return self.cause.effect == Empirical.slug

    @property
    def said(self) -> bool:
        """Whether it is more probable than not: its place with its driver, or one of the names of its class."""
        return max(self.levels.driver, self.certainty) >= NAMED


def named(found: Found, said: Inclusion) -> tuple[Named, ...]:
    """Causes of the mode, the best supported first; then what has a place and a driver only.

    Not all of them are more probable than not (``Named.said``).
    """
    problem = found.problem
    causes = dict.fromkeys(int(problem.spike_slab.terms.cause[term]) for term, _ in found.mode.members)
    single = [_single(found, k) for k in causes if problem.causes[k].effect != Empirical.slug]
    presence = Presence(found.signatures.machine, found.catalogue, problem, found.posterior)
    names = [_with_levels(found, presence, n) for n in _supported(found, said, single)]
    own = {n.cause for n in names if n.said}
    told = sorted((told_once(n, said, own) for n in names), key=lambda n: -n.gain)
    of_effect = Counter(cause.effect for cause in own)
    together = [
        replace(n, family=n.cause.effect) if n.said and of_effect[n.cause.effect] >= FAMILY else n
        for n in told
    ]
    return (*together, *_nameless(found, presence, together))


def _with_levels(found: Found, presence: Presence, one: Named) -> Named:
    kind = found.catalogue.candidates[one.candidates[0]].kind
    levels = presence.levels(one.cause.effect, one.cause.place, kind, one.probability)
    return replace(one, levels=levels)


def _nameless(found: Found, presence: Presence, names: Sequence[Named]) -> list[Named]:
    """Forms of the mode whose place and driver are known and that no name speaks of, the largest first."""
    cat, machine = found.catalogue, found.signatures.machine
    spoken = {
        (part, driver_of(n.levels.kind))
        for n in names
        if n.said
        for part in parts_of(machine, n.cause.effect, n.cause.place)
    }
    groups: dict[tuple[tuple[str, ...], str], list[int]] = {}
    for term, _ in found.mode.members:
        i = found.problem.candidates[term]
        placed = cat.candidates[i]
        if not cat.named(i) and (placed.place[0], driver_of(placed.kind)) not in spoken:
            groups.setdefault((placed.place, driver_of(placed.kind)), []).append(i)
    if not groups:
        return []
    gains = supports(found.problem.spike_slab, found.mode, [_places(found, own) for own in groups.values()])
    out = []
    for ((place, _), own), gain in zip(groups.items(), gains, strict=True):
        levels = presence.levels(Empirical.slug, place, cat.candidates[own[0]].kind, 0.0)
        if levels.driver >= NAMED:
            cause = EffectAtPlace(Empirical.slug, place)
            out.append(Named(cause, tuple(own), 0.0, 0.0, (), gain, levels=levels))
    return sorted(out, key=lambda n: -n.gain)


def as_named(said: Inclusion, names: Sequence[Named]) -> Inclusion:
    """Each cause with the probability that its name has: less than there is by what is only like it."""
    own = {n.cause: n.probability for n in names if not n.nameless}
    ranked = sorted({**said.places, **own}.items(), key=lambda item: -item[1])
    return replace(said, places=dict(ranked))


def _supported(found: Found, said: Inclusion, names: Sequence[Named]) -> list[Named]:
    """With the log Bayes factor of each name and of its class, and with what is only like it or a part of something else."""
    if not names:
        return []
    alone = supports(found.problem.spike_slab, found.mode, [_places(found, n.candidates) for n in names])
    gains = [max(gain, _least(found, n)) for gain, n in zip(alone, names, strict=True)]
    held = forms_hold(found, said.nameless, [n.candidates for n in names])
    return [
        replace(_beside_alike(name, gain, like.itself), tested=like.tested)
        for name, gain, like in zip(names, gains, held, strict=True)
    ]


def _least(found: Found, one: Named) -> float:
    """Log Bayes factor that a name has at least: from its prior odds beside the others to those that it was drawn with.

    What the likeliest state says of it may be less: other states hold it, too.
    """
    spike_slab, members = found.problem.spike_slab, found.mode.members
    own = [m for m in members if found.problem.candidates[m[0]] in one.candidates]
    if len(own) != 1:
        return -np.inf
    prior_odds = spike_slab.terms.log_prior_of(own) + slot_odds(prior.RICHNESS, len(members) - 1)
    sweeps = found.posterior.sweeps  # so many draws tell no more than one in so many
    drawn = (one.probability * sweeps + 1.0) / (sweeps + 2.0)
    return float(np.log(drawn / (1.0 - drawn)) - prior_odds)


def _beside_alike(one: Named, gain: float, held: float) -> Named:
    """A name with its log Bayes factor, where it is the thing itself with a probability ``held``."""
    members = [replace(m, probability=held * m.probability, gain=gain + m.gain) for m in one.equivalents]
    alike = (1.0 - held) * one.probability
    if alike > SHOWN:
        cause = EffectAtPlace(Empirical.slug, one.cause.place)
        members.append(Rival(cause, alike, gain + float(np.log((1.0 - held) / held))))
    return replace(
        one,
        probability=held * one.probability,
        certainty=held * one.certainty,
        gain=gain,
        equivalents=tuple(members),
    )


def told_once(one: Named, said: Inclusion, own: Collection[EffectAtPlace]) -> Named:
    """One probability for each cause: another explanation is as probable as it is at all, in this stead or beside it.

    ``own``: what is named for itself, and so no other explanation of anything.
    """
    others = [m for m in one.equivalents if m.cause not in own]
    twice = sum(m.probability for m in one.equivalents if m.cause in own)
    as_told = [
        m
        if m.cause.effect == Empirical.slug
        else replace(m, probability=max(m.probability, said.of(m.cause)))
        for m in others
    ]
    ranked = tuple(sorted(as_told, key=lambda m: -m.probability))
    return replace(one, certainty=max(one.certainty - twice, one.probability), equivalents=ranked)


def _single(found: Found, number: int) -> Named:
    """A cause of the mode with what else may be in its slot."""
    problem, posterior = found.problem, found.posterior
    row, own = posterior.beside[number], float(posterior.causes[number])
    rivals = [k for k in np.argsort(-row) if k != number and row[k] > SHOWN][:CLASS_LIMIT]
    others = sum(min(row[k], 1.0) for k in rivals)
    # all that may be in the slot, what has no name included
    certainty = min(1.0, own + sum(row[k] for k in rivals if problem.causes[k].effect != Empirical.slug))
    kept = float(min(1.0, max(1.0 - own, 0.0) / others)) if others > 0.0 else 1.0
    shown = tuple(
        Rival(
            problem.causes[k],
            kept * float(min(row[k], 1.0)),
            float(np.log(min(row[k], 1.0) / max(row[number], 1e-9))),
        )
        for k in rivals
    )
    terms = [t for t, _ in found.mode.members if int(problem.spike_slab.terms.cause[t]) == number]
    return Named(problem.causes[number], tuple(problem.candidates[t] for t in terms), own, certainty, shown)


def _places(found: Found, wanted: Collection[int]) -> NDArray[np.intp]:
    """Places of the coefficients of some candidates among the columns of the mode's members."""
    problem, owner = found.problem, list[int]()
    for term, _ in found.mode.members:
        i = problem.candidates[term]
        owner += [i] * len(found.catalogue.candidates[i].coefficients)
    return np.flatnonzero(np.isin(owner, list(wanted)))
