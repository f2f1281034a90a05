"""From a posterior over sets to what is said of machines: how probable each effect is at each place, and the sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.identification.diagnosis import prior
from truepose.identification.diagnosis.weighed import Cause, Weighed
from truepose.identification.posterior.mode import State
from truepose.identification.posterior.posterior import Posterior
from truepose.models.effects.empirical import Empirical

Place = tuple[str, tuple[str, ...]]
"""Slug of an effect and its place."""
REPORTED = 0.01
LIKELIEST = 8
"""Probability from which on an effect at a place is listed, and most sets that are."""
TYPICAL = 6
"""Most states of a family from which the shares of its places are read."""


@dataclass(frozen=True)
class Inclusion:
    """places: probability of each effect at each place, alone or in a family; families: share of each place of a family
    (by its cause), given that the family is there; sets: the likeliest sets of causes; nameless: that something without a
    name is there, a form in a slot or the smooth remainder."""

    places: Mapping[Place, float]
    families: Mapping[Cause, Mapping[Place, float]]
    sets: tuple[tuple[tuple[Cause, ...], float], ...]
    nameless: float

    def of(self, cause: Cause) -> float:
        """Probability of an effect at its place."""
        return self.places.get((cause.effect, cause.place), 0.0)


def inclusion(problem: Weighed, posterior: Posterior) -> Inclusion:
    """What the posterior says of effects at places."""
    families = {
        cause: _place_shares(problem, posterior, number)
        for number, cause in enumerate(problem.causes)
        if cause.family and posterior.causes[number] > REPORTED
    }
    places: dict[Place, float] = {}
    for number, cause in enumerate(problem.causes):
        probability = float(posterior.causes[number])
        if cause.family:
            for place, share in families.get(cause, {}).items():
                places[place] = places.get(place, 0.0) + probability * share
        else:
            own = (cause.effect, cause.place)
            places[own] = places.get(own, 0.0) + probability
    sets: dict[tuple[Cause, ...], float] = {}
    for state, share in posterior.states:
        numbers = sorted({int(problem.weighing.terms.cause[term]) for term, _ in state.members})
        key = tuple(problem.causes[k] for k in numbers)
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
        if state.point[-1] > 0
        or any(causes[int(cause[term])].effect == Empirical.slug for term, _ in state.members)
    )


def _place_shares(problem: Weighed, posterior: Posterior, number: int) -> Mapping[Place, float]:
    """Probability of each place of a family that is there, averaged over states that hold it."""
    terms = problem.weighing.terms
    states = [
        (state, share)
        for state, share in posterior.states
        if any(int(terms.cause[term]) == number for term, _ in state.members)
    ][:TYPICAL]
    total = sum(share for _, share in states)
    out: dict[Place, float] = {}
    for state, share in states:
        for place, probability in place_probabilities(problem, state, number).items():
            out[place] = out.get(place, 0.0) + share / total * probability
    return out


def place_probabilities(problem: Weighed, state: State, number: int) -> Mapping[Place, float]:
    """Probability that each place of a family has the effect, in a state with the family.

    By Savage and Dickey: a place's coefficients are zero with the ratio of their posterior to their prior density there. A
    place counts by the clearest of its terms.
    """
    weighing = problem.weighing
    columns, sizes = weighing.columns(state.members)
    mean, covariance = weighing.root(state.point).posterior(columns, sizes)
    out: dict[Place, float] = {}
    at = 0
    for term, _ in state.members:
        own = problem.candidates[term]
        width = len(weighing.terms.columns[term])
        if int(weighing.terms.cause[term]) == number:
            each = width // len(own)
            for k, place in enumerate(_places(problem, number, len(own))):
                part = slice(at + k * each, at + (k + 1) * each)
                log_odds = _savage_dickey(mean[part], covariance[part, part], float(sizes[at]))
                log_odds += float(np.log(prior.IN_FAMILY / (1.0 - prior.IN_FAMILY)))
                out[place] = max(
                    out.get(place, 0.0), float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -700, 700))))
                )
        at += width
    return out


def _places(problem: Weighed, number: int, count: int) -> Sequence[Place]:
    cause = problem.causes[number]
    return [(cause.effect, (place,)) for place in cause.place[:count]]


def _savage_dickey(mean: np.ndarray, covariance: np.ndarray, size: float) -> float:
    """Log Bayes factor for coefficients (k,) that are not zero, N(0, size^2) before and N(mean, covariance) after."""
    factor = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(len(mean)))
    turned = np.linalg.solve(factor, mean)
    return (
        0.5 * float(turned @ turned)
        + float(np.sum(np.log(np.diag(factor))))
        - len(mean) * float(np.log(size))
    )
