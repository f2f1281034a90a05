"""The posterior over sets, from two chains: how probable each term and cause is, which stand in for each other, the
likeliest sets, and how far the chains agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.mode import (
    State,
    ascended,
    best_point,
    log_posterior,
    plausible,
)
from truepose.identification.posterior.sampler import Chain, Sweep
from truepose.identification.posterior.weighing import Members, Weighing
from truepose.identification.prior import Richness

Array = NDArray[np.float64]
AGREED = 0.02
"""Largest difference of a cause's probability between two chains that is none."""
BURN, ROUND, ROUNDS = 25, 40, 8
"""Sweeps of a chain before it counts, sweeps of each round, and most rounds."""
ALIKE = 0.05
"""Share of a slot from which on two causes stand in for each other."""
RARE = 0.2
"""Probability up to which a cause is mostly not there."""
CLASS, CLEAR = 5, 0.8
"""Most causes of a class, and probability that these hold a slot together for it to be one."""
LONG_SET, SHORTER = 150, 3
"""Columns of a set beyond which a sweep takes long, and by how much chains and rounds are shorter then."""
FOR_CLASS = 0.9
"""How much a member counts for its class; the rest for itself, so that the likeliest of a class stands for it."""


@dataclass(frozen=True)
class Posterior:
    """What the chains say.

    terms: probability of each term that was not hopeless; causes (n,): of each cause; beside (n, n): where a slot holds
    the cause of the row, how probable each other cause is in its place (rows sum to 1 at most); states: the distinct
    states visited with their share, largest first; points: share of each point; disagreement: largest difference between
    chains of a cause's probability.
    """

    terms: Mapping[int, float]
    causes: Array
    beside: Array
    states: tuple[tuple[State, float], ...]
    points: tuple[tuple[GridPoint, float], ...]
    disagreement: float
    sweeps: int


class Tally:
    """Sums over the sweeps of one chain; ``given``: terms that every state holds."""

    def __init__(self, weighing: Weighing) -> None:
        self._cause, self.sweeps = weighing.terms.cause, 0
        self._given = weighing.given
        self.terms, self.number = np.zeros(len(weighing.terms)), weighing.terms.n_causes
        self.beside, self.held = np.zeros((self.number, self.number)), np.zeros(self.number)
        self.seen = Counter[tuple[Members, GridPoint]]()

    def add(self, sweep: Sweep) -> None:
        self.sweeps += 1
        for term, _ in self._given:
            one = np.zeros(len(self.terms))
            one[term] = 1.0
            self._count(one, filled=True)
        for visit in sweep.visits:
            self._count(visit.terms, filled=visit.filled)
        self.seen[tuple(sorted((*self._given, *sweep.members))), sweep.point] += 1

    def _count(self, terms: Array, *, filled: bool) -> None:
        self.terms += terms
        if filled:
            own = self._by_cause(terms)
            some = np.flatnonzero(own > 1e-4)
            self.beside[np.ix_(some, some)] += np.outer(own[some], own[some])
            self.held += own

    def _by_cause(self, terms: Array) -> Array:
        found: Array = np.bincount(self._cause, weights=terms, minlength=self.number).astype(float)
        return found

    @property
    def causes(self) -> Array:
        """(n,) probability of each cause."""
        return np.asarray(np.minimum(self._by_cause(self.terms) / self.sweeps, 1.0))


def sample(
    weighing: Weighing,
    richness: Richness,
    *,
    seed: int = 1,
    known: Sequence[State] = (),
    rounds: int = ROUNDS,
) -> Posterior:
    """Two chains, from the mode and from half of it, until they agree or long enough.

    Terms and values of the grid that are hopeless around the modes are left out, and what nothing can replace there is given.
    """
    every = tops(weighing, richness, known)
    top = max(every, key=lambda state: state.log_posterior)
    around = plausible(weighing, richness, every)
    whole, index = weighing.restricted(around.terms)
    number = {int(term): k for k, term in enumerate(index)}
    part = whole.conditioned([(number[term], size) for term, size in around.certain])
    free = [(number[term], size) for term, size in top.members if (term, size) not in around.certain]
    chains = [
        Chain(part, richness, around.reach, top.point, start, seed + k)
        for k, start in enumerate((free, free[::2]))
    ]
    shorter = SHORTER if len(weighing.columns(top.members)[0]) > LONG_SET else 1
    for chain in chains:
        _run(chain, BURN // shorter)
    tallies = _counted(chains, part, ROUND // shorter, max(rounds // shorter, 1))
    return _gathered(part, index, richness, tallies)


def _counted(chains: Sequence[Chain], part: Weighing, sweeps: int, rounds: int) -> list[Tally]:
    """Rounds of so many sweeps, until the chains agree."""
    tallies = [Tally(part) for _ in chains]
    for _ in range(rounds):
        for chain, tally in zip(chains, tallies, strict=True):
            for sweep in chain.sweeps(sweeps):
                tally.add(sweep)
        if _disagreement(tallies) <= AGREED:
            break
    return tallies


def _run(chain: Chain, number: int) -> None:
    for _ in chain.sweeps(number):
        pass


def _disagreement(tallies: Sequence[Tally]) -> float:
    """Largest difference of a cause's probability between chains."""
    shares = np.array([t.causes for t in tallies])
    return float(np.max(np.ptp(shares, axis=0), initial=0.0))


def _gathered(
    part: Weighing, index: NDArray[np.intp], richness: Richness, tallies: Sequence[Tally]
) -> Posterior:
    shares = Counter[tuple[Members, GridPoint]]()
    for tally in tallies:
        shares.update(tally.seen)
    sweeps = sum(t.sweeps for t in tallies)
    whole = Weighing(part.design, part.unknowns, part.terms, part.sizes)
    states, points = list[tuple[State, float]](), Counter[GridPoint]()
    for (members, point), count in sorted(shares.items(), key=lambda item: -item[1]):
        numbered = tuple(sorted((int(index[term]), size) for term, size in members))
        log = log_posterior(whole, richness, members, point)
        states.append((State(numbered, point, log), count / sweeps))
        points[point] += count
    beside, held = sum(t.beside for t in tallies), np.sum([t.held for t in tallies], axis=0)[:, None]
    terms = np.minimum(np.sum([t.terms for t in tallies], axis=0) / sweeps, 1.0)
    return Posterior(
        terms=dict(zip(index.tolist(), terms.tolist(), strict=True)),
        causes=np.mean([t.causes for t in tallies], axis=0),
        beside=np.asarray(beside / np.where(held > 0.0, held, 1.0)),
        states=tuple(states),
        points=tuple((point, count / sweeps) for point, count in points.most_common()),
        disagreement=_disagreement(tallies),
        sweeps=sweeps,
    )


def climbed(weighing: Weighing, richness: Richness, known: Sequence[State] = ()) -> State:
    """The likeliest state that ascents from nothing and from ``known`` states reach."""
    return max(tops(weighing, richness, known), key=lambda state: state.log_posterior)


def tops(weighing: Weighing, richness: Richness, known: Sequence[State]) -> list[State]:
    """Where ascents lead: from known states, else from nothing."""
    starts = [(state.point, state.members) for state in known] or [(best_point(weighing), ())]
    return [ascended(weighing, richness, *start) for start in starts]


def mode(posterior: Posterior, weighing: Weighing) -> State:
    """The visited state that agrees best with the probabilities: it holds what is likelier there than not, and no more.

    A cause counts with its class where few causes stand in for each other.
    """
    own, whole = posterior.causes, _with_classes(posterior)

    def agreement(state: State) -> float:
        causes = sorted({int(weighing.terms.cause[term]) for term, _ in state.members}, key=lambda k: -own[k])
        # a second member of a class stands for itself alone
        alone = [any(posterior.beside[k, j] > ALIKE for j in causes[:i]) for i, k in enumerate(causes)]
        member = [
            own[k] if one else FOR_CLASS * whole[k] + (1.0 - FOR_CLASS) * own[k]
            for k, one in zip(causes, alone, strict=True)
        ]
        return float(sum(member) - 0.5 * len(member))

    return max(
        (state for state, _ in posterior.states), key=lambda s: (round(agreement(s), 3), s.log_posterior)
    )


def _with_classes(posterior: Posterior) -> Array:
    """(n,) probability of each cause, or that of the likeliest class that holds it."""
    out = posterior.causes.copy()
    for k in range(len(out)):
        probability = class_probability(posterior, k)
        if probability > 0.0:
            row = posterior.beside[k]
            held = np.argsort(-row)[:CLASS]
            held = np.append(held[row[held] > ALIKE], k)
            out[held] = np.maximum(out[held], probability)
    return np.asarray(out)


def class_probability(posterior: Posterior, cause: int) -> float:
    """Probability that a slot of a cause holds it or one of a few that stand in for it; 0 where it may be anything."""
    row = np.sort(posterior.beside[cause])[::-1][:CLASS]
    return float(row.sum()) if row.sum() > CLEAR and posterior.causes[cause] > RARE / 2 else 0.0
