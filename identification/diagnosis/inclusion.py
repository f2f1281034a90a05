"""From a posterior over sets to what is said of machines: how probable each effect is at each place, and the sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from truepose.identification.diagnosis.places import AtPlace, Place
from truepose.identification.diagnosis.places import places as family_places
from truepose.identification.diagnosis.weighed import Cause, Weighed
from truepose.identification.posterior.posterior import Posterior
from truepose.models.effects.empirical import Empirical

REPORTED = 0.01
LIKELIEST = 8
"""Probability from which on an effect at a place is listed, and most sets that are."""


@dataclass(frozen=True)
class Inclusion:
    """places: probability of each effect at each place, alone or in a family; families: each place of a family (by its
    cause), given that the family is there; sets: the likeliest sets of causes, a smooth remainder being one without a
    place; nameless: that something without a name is there, a form in a slot or the smooth remainder."""

    places: Mapping[Place, float]
    families: Mapping[Cause, Mapping[Place, AtPlace]]
    sets: tuple[tuple[tuple[Cause, ...], float], ...]
    nameless: float

    def of(self, cause: Cause) -> float:
        """Probability of an effect at its place."""
        return self.places.get((cause.effect, cause.place), 0.0)


def inclusion(problem: Weighed, posterior: Posterior) -> Inclusion:
    """What the posterior says of effects at places."""
    families = {
        cause: family_places(problem, posterior, number)
        for number, cause in enumerate(problem.causes)
        if cause.family and posterior.causes[number] > REPORTED
    }
    places: dict[Place, float] = {}

    def add(place: Place, probability: float) -> None:
        places[place] = places.get(place, 0.0) + probability

    for number, cause in enumerate(problem.causes):
        probability = float(posterior.causes[number])
        if cause.family:
            for place, found in families.get(cause, {}).items():
                add(place, probability * found.probability)
        else:
            add((cause.effect, cause.place), probability)
    sets: dict[tuple[Cause, ...], float] = {}
    for state, share in posterior.states:
        numbers = sorted({int(problem.weighing.terms.cause[term]) for term, _ in state.members})
        key = tuple(dict.fromkeys(c for k in numbers for c in problem.causes[k].told))
        key += (Cause(Empirical.slug, ()),) if state.point.remainder > 0 else ()
        sets[key] = sets.get(key, 0.0) + share
    ranked = sorted(places.items(), key=lambda item: -item[1])
    listed = {place: min(p, 1.0) for place, p in ranked if p > REPORTED}
    likeliest = sorted(sets.items(), key=lambda item: -item[1])[:LIKELIEST]
    return Inclusion(listed, families, tuple(likeliest), _nameless(problem, posterior))


def _nameless(problem: Weighed, posterior: Posterior) -> float:
    cause, causes = problem.weighing.terms.cause, problem.causes
    return sum(
        share
        for state, share in posterior.states
        if state.point.remainder > 0
        or any(causes[int(cause[term])].effect == Empirical.slug for term, _ in state.members)
    )
