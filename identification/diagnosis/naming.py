"""What is named: causes of the likeliest set, each with the class of explanations that may stand in its slot."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification import prior
from truepose.identification.diagnosis.inclusion import Inclusion
from truepose.identification.diagnosis.levels import UNKNOWN, Levels, Presence, driver_of, parts_of
from truepose.identification.diagnosis.likeness import forms_hold
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.weighed import Cause
from truepose.identification.posterior.mode import slot_odds, supports
from truepose.models.effects.empirical import Empirical

NAMED = 0.5
"""Probability that a place with its driver, or a class, needs to be said."""
LEADING = 0.1
"""Probability from which on what is less probable than not is shown as leading."""
CERTAIN = 0.95
"""Probability from which on a name is said without its look-alikes."""
SHOWN = 0.02
"""Share of a slot from which on an explanation belongs to its class."""
CLASS_LIMIT = 8
TOLD = 1.0
"""Log Bayes factor that readings must give a place of a family for it to be said."""


@dataclass(frozen=True)
class Rival:
    """Another explanation of a class: its cause, how probable it is, the log Bayes factor of it in the slot; whether it could
    be tested."""

    cause: Cause
    probability: float
    gain: float
    tested: bool = True


@dataclass(frozen=True)
class Named:
    """A cause of the likeliest set: its candidates that the fit holds, how probable it is, and its class.

    ``certainty`` is the probability of the whole class; ``gain`` the log Bayes factor of the set with it against without.
    ``family``: the slug, where it was found at all places under one size. levels: what is known of where it is and of what
    drives it; tested: whether its form was. A cause ``empirical`` has no law, and its ``probability`` is 0.
    """

    cause: Cause
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
        """Whether it is more probable than not: its place with its driver, or one of the names of its class.

        A place of a family that readings say nothing of is as probable as it was before, and is not said.
        """
        told = not self.family or self.gain >= TOLD
        return told and max(self.levels.driver, self.certainty) >= NAMED


def named(found: Found, said: Inclusion) -> tuple[Named, ...]:
    """Causes of the mode, the best supported first, families place by place; then what has a place and a driver only.

    Not all of them are more probable than not (``Named.said``).
    """
    problem = found.weighed
    causes = dict.fromkeys(int(problem.weighing.terms.cause[term]) for term, _ in found.mode.members)
    out: list[Named] = []
    for number in causes:
        if problem.causes[number].effect != Empirical.slug:
            out += (
                _of_family(found, said, number)
                if problem.causes[number].family
                else _single(found, said, number)
            )
    machine, cat = found.signatures.machine, found.catalogue
    presence = Presence(machine, cat, problem, found.posterior, said.families)
    names = [_with_levels(found, presence, n) for n in _weighed(found, said, _merged(out))]
    own = {n.cause for n in names if n.said}
    told = sorted((told_once(n, said, own) for n in names), key=lambda n: -n.gain)
    return (*told, *_nameless(found, presence, told))


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
        for i in found.weighed.candidates[term]:
            placed = cat.candidates[i]
            if not cat.named(i) and (placed.place[0], driver_of(placed.kind)) not in spoken:
                groups.setdefault((placed.place, driver_of(placed.kind)), []).append(i)
    if not groups:
        return []
    gains = supports(found.weighed.weighing, found.mode, [_places(found, own) for own in groups.values()])
    out = []
    for ((place, _), own), gain in zip(groups.items(), gains, strict=True):
        levels = presence.levels(Empirical.slug, place, cat.candidates[own[0]].kind, 0.0)
        if levels.driver >= NAMED:
            cause = Cause(Empirical.slug, place)
            out.append(Named(cause, tuple(own), 0.0, 0.0, (), gain, levels=levels))
    return sorted(out, key=lambda n: -n.gain)


def as_named(said: Inclusion, names: Sequence[Named]) -> Inclusion:
    """Each cause with the probability that its name has: less than there is by what is only like it."""
    own = {(n.cause.effect, n.cause.place): n.probability for n in names if not n.nameless}
    ranked = sorted({**said.places, **own}.items(), key=lambda item: -item[1])
    return replace(said, places=dict(ranked))


def _weighed(found: Found, said: Inclusion, names: Sequence[Named]) -> list[Named]:
    """With the log Bayes factor of each name and of its class, and with what is only like it or a part of something else."""
    if not names:
        return []
    alone = supports(found.weighed.weighing, found.mode, [_places(found, n.candidates) for n in names])
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
    weighing, members = found.weighed.weighing, found.mode.members
    own = [m for m in members if set(found.weighed.candidates[m[0]]) == set(one.candidates)]
    if one.family or not own:
        return -np.inf
    prior_odds = weighing.terms.log_prior_of(own) + slot_odds(prior.RICHNESS, len(members) - 1)
    sweeps = found.posterior.sweeps  # so many draws tell no more than one in so many
    drawn = (one.probability * sweeps + 1.0) / (sweeps + 2.0)
    return float(np.log(drawn / (1.0 - drawn)) - prior_odds)


def _beside_alike(one: Named, gain: float, held: float) -> Named:
    """A name with its log Bayes factor, where it is the thing itself with a probability ``held``."""
    members = [replace(m, probability=held * m.probability, gain=gain + m.gain) for m in one.equivalents]
    alike = (1.0 - held) * one.probability
    if alike > SHOWN:
        cause = Cause(Empirical.slug, one.cause.place)
        members.append(Rival(cause, alike, gain + float(np.log((1.0 - held) / held))))
    return replace(
        one,
        probability=held * one.probability,
        certainty=held * one.certainty,
        gain=gain,
        equivalents=tuple(members),
    )


def told_once(one: Named, said: Inclusion, own: Collection[Cause]) -> Named:
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


def _merged(names: Sequence[Named]) -> list[Named]:
    """One name for each cause: terms of a family at a place stand with those that are there by themselves."""
    out: dict[Cause, Named] = {}
    for one in names:
        first = out.get(one.cause)
        if first is None:
            out[one.cause] = one
            continue
        surer = max(first, one, key=lambda n: n.certainty)
        out[one.cause] = replace(
            surer,
            candidates=(*first.candidates, *(i for i in one.candidates if i not in first.candidates)),
            probability=max(first.probability, one.probability),
            family=first.family or one.family,
        )
    return list(out.values())


def _single(found: Found, said: Inclusion, number: int) -> list[Named]:
    problem, posterior = found.weighed, found.posterior
    cause = problem.causes[number]
    row = posterior.beside[number]
    own = max(said.of(cause), float(posterior.causes[number]))
    rivals = [
        k for k in np.argsort(-row) if k != number and row[k] > SHOWN and not _same(problem.causes[k], cause)
    ][:CLASS_LIMIT]
    others = sum(min(row[k], 1.0) for k in rivals)
    # all that may be in the slot, what has no name included
    certainty = min(1.0, own + sum(row[k] for k in rivals if problem.causes[k].effect != Empirical.slug))
    kept = float(min(1.0, max(1.0 - own, 0.0) / others)) if others > 0.0 else 1.0
    shown = tuple(
        Rival(rival, kept * share, float(np.log(share / max(row[number], 1e-9))))
        for k in rivals
        for rival, share in _told(said, problem.causes[k], float(min(row[k], 1.0)))
    )
    held = tuple(
        i
        for term, _ in found.mode.members
        if int(problem.weighing.terms.cause[term]) == number
        for i in problem.candidates[term]
    )
    return [Named(cause, held, min(own, 1.0), certainty, shown)]


def _same(other: Cause, cause: Cause) -> bool:
    """Whether another cause says the same of a place: the family that it belongs to."""
    return other.family and other.has(cause.effect, cause.place)


def _told(said: Inclusion, cause: Cause, share: float) -> list[tuple[Cause, float]]:
    """A cause with its share of a slot; of a family of a kin, the places that are likely."""
    if not cause.kindred:
        return [(cause, share)]
    places = [(Cause(*place), share * at.probability) for place, at in said.families.get(cause, {}).items()]
    return [(single, probability) for single, probability in places if probability > SHOWN]


def _of_family(found: Found, said: Inclusion, number: int) -> list[Named]:
    """Places of a family that stand out by themselves, each with what may be there in its stead."""
    problem = found.weighed
    cause = problem.causes[number]
    terms = [term for term, _ in found.mode.members if int(problem.weighing.terms.cause[term]) == number]
    out = []
    for k, single in enumerate(cause.singles):
        probability, rivals = said.of(single), _rivals(found, said, number, single)
        certainty = min(
            1.0, probability + sum(m.probability for m in rivals if m.cause.effect != Empirical.slug)
        )
        if certainty > LEADING:
            held = tuple(problem.candidates[term][k] for term in terms)
            out.append(Named(single, held, probability, certainty, rivals, family=single.effect))
    return out


def _rivals(found: Found, said: Inclusion, number: int, single: Cause) -> tuple[Rival, ...]:
    """Causes in the stead of a family's place: alone, the family being there, or in another family that may be."""
    problem, posterior = found.weighed, found.posterior
    own = (single.effect, single.place)
    here = said.families.get(problem.causes[number], {}).get(own)
    there = float(posterior.causes[number])
    shares = {c: there * p for c, p in here.rivals.items()} if here else {}
    for k, share in enumerate(posterior.beside[number]):
        for place, at in said.families.get(problem.causes[k], {}).items():
            if k != number and share > SHOWN and place != own and place[1] == single.place:
                cause = Cause(*place)
                shares[cause] = shares.get(cause, 0.0) + float(share) * at.probability
    likely = sorted(((p, c) for c, p in shares.items() if p > SHOWN), key=lambda each: -each[0])
    mine = max(said.of(single), 1e-9)
    return tuple(Rival(cause, p, float(np.log(p / mine))) for p, cause in likely[:CLASS_LIMIT])


def _places(found: Found, wanted: Collection[int]) -> NDArray[np.intp]:
    """Places of the coefficients of some candidates among the columns of the mode's members."""
    problem, owner = found.weighed, list[int]()
    for term, _ in found.mode.members:
        for i in problem.candidates[term]:
            owner += [i] * len(found.catalogue.candidates[i].coefficients)
    return np.flatnonzero(np.isin(owner, list(wanted)))
