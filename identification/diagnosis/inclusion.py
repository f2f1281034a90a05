"""From a posterior over sets to what is said of machines: how probable each effect is at each place, and the sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from truepose.identification.diagnosis.selection_problem import SelectionProblem
from truepose.identification.posterior.posterior import Posterior
from truepose.models.effects.empirical import Empirical
from truepose.models.placed import EffectAtPlace

REPORTED = 0.01
LIKELIEST = 8
"""Probability from which on an effect at a place is listed, and most sets that are."""


@dataclass(frozen=True)
class Inclusion:
    """places: probability of each effect at each place; sets: the likeliest sets, a smooth remainder being one without a
    place; nameless: that something without a name is there, a form in a slot or the smooth remainder."""

    places: Mapping[EffectAtPlace, float]
    sets: tuple[tuple[tuple[EffectAtPlace, ...], float], ...]
    nameless: float

    def of(self, cause: EffectAtPlace) -> float:
        """Probability of an effect at its place."""
        return self.places.get(cause, 0.0)


def inclusion(problem: SelectionProblem, posterior: Posterior) -> Inclusion:
    """What the posterior says of effects at places."""
    places = dict(zip(problem.causes, posterior.causes.tolist(), strict=True))
    sets: dict[tuple[EffectAtPlace, ...], float] = {}
    for state, share in posterior.states:
        numbers = sorted({int(problem.spike_slab.terms.cause[term]) for term, _ in state.members})
        key = tuple(problem.causes[k] for k in numbers)
        key += (EffectAtPlace(Empirical.slug, ()),) if state.point.remainder > 0 else ()
        sets[key] = sets.get(key, 0.0) + share
    ranked = sorted(places.items(), key=lambda item: -item[1])
    listed = {place: p for place, p in ranked if p > REPORTED}
    likeliest = sorted(sets.items(), key=lambda item: -item[1])[:LIKELIEST]
    nameless = sum(p for key, p in sets.items() if any(c.effect == Empirical.slug for c in key))
    return Inclusion(listed, tuple(likeliest), nameless)
