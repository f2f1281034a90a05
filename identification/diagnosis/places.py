"""Places of a family: each weighed against nothing being there, and against any other term in its stead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification import prior
from truepose.identification.diagnosis.weighed import Cause, Weighed
from truepose.identification.posterior.marginal import Marginal
from truepose.identification.posterior.mode import State, slot_odds
from truepose.identification.posterior.posterior import Posterior

Array = NDArray[np.float64]
Place = tuple[str, tuple[str, ...]]
"""Slug of an effect and its place."""
TYPICAL = 3
"""Most states of a family from which its places are read."""
LISTED = 0.01
"""Probability from which on a rival is kept."""


@dataclass(frozen=True)
class AtPlace:
    """Probability of a family's effect at one of its places, and of each cause that may be there in its stead."""

    probability: float
    rivals: Mapping[Cause, float]


def places(problem: Weighed, posterior: Posterior, number: int) -> Mapping[Place, AtPlace]:
    """Places of a family (its cause) that is there, averaged over the states that hold it."""
    cause = problem.weighing.terms.cause
    states = [
        (state, share)
        for state, share in posterior.states
        if any(int(cause[term]) == number for term, _ in state.members)
    ][:TYPICAL]
    total = sum(share for _, share in states)
    found = [(at_places(problem, state, number), share / total) for state, share in states]
    every = dict.fromkeys(place for one, _ in found for place in one)
    return {place: _mean([(one[place], share) for one, share in found if place in one]) for place in every}


def _mean(found: Sequence[tuple[AtPlace, float]]) -> AtPlace:
    rivals: dict[Cause, float] = {}
    for one, share in found:
        for cause, probability in one.rivals.items():
            rivals[cause] = rivals.get(cause, 0.0) + share * probability
    return AtPlace(sum(share * one.probability for one, share in found), rivals)


def at_places(problem: Weighed, state: State, number: int) -> Mapping[Place, AtPlace]:
    """Each place of a family in a state that holds it; a place counts by the clearest of its terms.

    Its coefficients are left out: the state is then weighed without them, and with each other term instead, all else the same.
    """
    weighing, cause = problem.weighing, problem.causes[number]
    columns, sizes = weighing.columns(state.members)
    whole = weighing.root(state.point).including(columns, sizes)
    clearest: dict[Place, tuple[float, Marginal]] = {}
    at = 0
    for term, _ in state.members:
        width = len(weighing.terms.columns[term])
        count = len(problem.candidates[term]) if int(weighing.terms.cause[term]) == number else 0
        for k in range(count):
            part = at + np.arange(k * width // count, (k + 1) * width // count)
            rest, place = whole.without(part), cause.singles[k][:2]
            gain = whole.log_evidence - rest.log_evidence
            if place not in clearest or gain > clearest[place][0]:
                clearest[place] = gain, rest
        at += width
    beside = _instead(problem, state, whole)
    return {place: _weighed(problem, state, place, *found, beside) for place, found in clearest.items()}


def _weighed(
    problem: Weighed, state: State, place: Place, gain: float, rest: Marginal, beside: Array
) -> AtPlace:
    """From the log Bayes factor of a place, the model without it, and log odds (n,) of each cause beside it.

    What is as likely beside the place as without it speaks neither for it nor against it.
    """
    own = gain + float(np.log(prior.IN_FAMILY / (1.0 - prior.IN_FAMILY)))
    instead = _instead(problem, state, rest)
    alike = np.array([c.has(*place) for c in problem.causes], dtype=bool)
    there = np.logaddexp.reduce([own, *(own + beside[~alike]), *instead[alike]])
    total = np.logaddexp.reduce([0.0, there, *instead[~alike]])
    shares = np.exp(instead - total) - np.exp(np.minimum(beside - total, 0.0))
    rivals: dict[Cause, float] = {}
    for k in np.flatnonzero(~alike & (shares > LISTED)):
        other = _here(problem.causes[k], place)
        rivals[other] = rivals.get(other, 0.0) + float(shares[k])
    return AtPlace(float(np.exp(there - total)), rivals)


def _instead(problem: Weighed, state: State, rest: Marginal) -> Array:
    """(n,) log odds of each cause as one more member of a state, against nothing."""
    weighing = problem.weighing
    own = np.logaddexp.reduce(weighing.log_odds_beside(rest, state.members), axis=0)
    out = np.full(len(problem.causes), -np.inf)
    np.logaddexp.at(out, weighing.terms.cause, own)
    return out + slot_odds(prior.RICHNESS, len(state.members))


def _here(cause: Cause, place: Place) -> Cause:
    """What a cause says of a place: of a family that has it, its own."""
    return next((c for c in cause.singles if cause.family and c.place == place[1]), cause)
