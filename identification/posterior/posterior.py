"""The posterior over sets, from several chains: how probable each term and cause is, which stand in for each other,
the likeliest sets, and how far the chains agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.posterior.design import Point
from truepose.identification.posterior.mode import Climb, State, log_posterior
from truepose.identification.posterior.sampler import Chain, Passage, Richness, Sweep
from truepose.identification.posterior.weighing import Members, Weighing

Array = NDArray[np.float64]
AGREED, APART = 0.02, 0.1
"""Largest difference of a cause's probability between two chains that is none, and from which on they are caught apart."""
Seen = tuple[Members, Point]
BURN, ROUND, ROUNDS, LEARNING = 25, 40, 5, 2
"""Sweeps of a chain before it counts, sweeps of each round, most rounds, and after how many of them passages are laid."""
VISITED = 3
"""States of each chain, the most visited, between which passages are laid."""
LONG, HOPELESS_LONG = 16, -3.5
"""Columns from which on a term costs much, and the log probability below which it is left out."""
FOR_CLASS = 0.9
"""How much a member counts for its class; the rest for itself, so that the likeliest of a class stands for it."""
ALIKE = 0.05
"""Share of a slot from which on two causes stand in for each other."""
RARE = 0.2
"""Probability up to which a cause is mostly not there."""
CLASS, CLEAR = 5, 0.8
"""Most causes of a class, and probability that these hold a slot together for it to be one."""
HOPELESS, OVERLOOKED = -6.0, -3.0
"""Log probability in a slot below which a term is left out of the chains, and above which leaving it out was wrong."""
LOOKS, TYPICAL = 2, 3
"""Most times that the chains are run with more terms, and sets that are looked at after each."""
LONG_SET, SHORTER = 150, 3
"""Columns of a set beyond which finding it from nothing takes too long, and chains are so many times shorter, of one round."""
HOT, HEAT = 8, 3.0
"""Sweeps of the second chain's start with odds flattened by so much: it comes from elsewhere."""


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
    points: tuple[tuple[Point, float], ...]
    disagreement: float
    sweeps: int

    def typical(self, number: int) -> list[State]:
        """A state of each of the sets of terms that were visited most."""
        sets: dict[tuple[int, ...], tuple[State, float]] = {}
        for state, share in self.states:
            key = tuple(term for term, _ in state.members)
            first, before = sets.get(key, (state, 0.0))
            sets[key] = (first, before + share)
        return [state for state, _ in sorted(sets.values(), key=lambda s: -s[1])[:number]]

    @property
    def mixed(self) -> bool:
        """Whether the chains agree."""
        return self.disagreement <= AGREED


class Tally:
    """Sums over the sweeps of one chain."""

    def __init__(self, weighing: Weighing) -> None:
        self._cause, self.sweeps = weighing.terms.cause, 0
        self.terms, self.number = np.zeros(len(weighing.terms)), weighing.terms.n_causes
        self.beside, self.held = np.zeros((self.number, self.number)), np.zeros(self.number)
        self.seen = Counter[Seen]()

    def add(self, sweep: Sweep) -> None:
        self.sweeps += 1
        for visit in sweep.visits:
            self.terms += visit.terms
            if visit.filled:
                own = self._by_cause(visit.terms)
                some = np.flatnonzero(own > 1e-4)
                self.beside[np.ix_(some, some)] += np.outer(own[some], own[some])
                self.held += own
        self.seen[tuple(sorted(sweep.members)), sweep.point] += 1

    def _by_cause(self, terms: Array) -> Array:
        found: Array = np.bincount(self._cause, weights=terms, minlength=self.number).astype(float)
        return found

    @property
    def causes(self) -> Array:
        """(n,) probability of each cause."""
        return np.asarray(np.minimum(self._by_cause(self.terms) / self.sweeps, 1.0))


def sample(
    weighing: Weighing, richness: Richness, *, seed: int = 1, known: Sequence[State] = ()
) -> Posterior:
    """Two chains, from the likeliest set and from nothing, until they agree or long enough.

    Climbs from nothing and from ``known`` states come first; terms that were hopeless in all of them are left out of the
    chains, and looked at again at the sets that these visit most.
    """
    climb, start = Climb(weighing, richness), best_point(weighing)
    tops = climbed_tops(climb, weighing, start, known)
    top = max(tops, key=lambda state: state.log_posterior)
    for state in tops:
        climb.look(state.point, state.members)
    limit = np.where([len(c) > LONG for c in weighing.terms.columns], HOPELESS_LONG, HOPELESS)
    for _ in range(LOOKS):
        wanted = climb.interest > limit
        wanted[[term for term, _ in top.members]] = True
        part, index = weighing.restricted(wanted)
        found = _sampled(part, index, richness, seed, top, start)
        for state in found.typical(TYPICAL):
            climb.look(state.point, state.members)
        if not np.any(~wanted & (climb.interest > OVERLOOKED)):
            break
    return found


def _sampled(
    part: Weighing, index: NDArray[np.intp], richness: Richness, seed: int, top: State, start: Point
) -> Posterior:
    """Chains over the terms ``index`` of the whole problem; the result is in the whole problem's numbers."""
    back = {int(term): k for k, term in enumerate(index)}
    members = tuple((back[term], size) for term, size in top.members)
    chains = [
        Chain(part, richness, top.point, members, seed),
        _other(part, richness, start, top.point, members, seed),
    ]
    shorter = SHORTER if len(part.columns(members)[0]) > LONG_SET else 1
    for chain in chains:
        _run(chain, BURN // shorter)
        chain.tuned = True
    return _gathered(
        part, index, richness, _counted(chains, part, ROUND // shorter, 1 if shorter > 1 else ROUNDS)
    )


def _counted(chains: Sequence[Chain], part: Weighing, sweeps: int, rounds: int) -> list[Tally]:
    """Rounds of so many sweeps, until the chains agree.

    Each may be caught in sets of its own. After the first rounds they learn of each other's, and count anew.
    """
    tallies = list[Tally]()
    for k in range(rounds):
        if k <= LEARNING:
            tallies = [Tally(part) for _ in chains]
        for chain, tally in zip(chains, tallies, strict=True):
            for sweep in chain.sweeps(sweeps):
                tally.add(sweep)
        if chain_disagreement(tallies, np.full(len(tallies), 1.0 / len(tallies))) <= AGREED:
            break
        if k < LEARNING:
            ways = _passages(*tallies)
            for chain in chains:
                chain.passages = tuple(dict.fromkeys((*chain.passages, *ways)))
    return tallies


def _passages(one: Tally, other: Tally) -> tuple[Passage, ...]:
    """Ways between the states that two chains visited most."""
    often = [[state for state, _ in tally.seen.most_common(VISITED)] for tally in (one, other)]
    ways = [Passage.between(a, b) for a in often[0] for b in often[1] if a[0] != b[0]]
    return tuple(dict.fromkeys(ways))


def _other(
    part: Weighing, richness: Richness, start: Point, point: Point, members: Members, seed: int
) -> Chain:
    """A chain that comes from elsewhere: from nothing through flattened odds, or, where that takes long, from half of a set."""
    if len(part.columns(members)[0]) > LONG_SET:
        return Chain(part, richness, point, members[::2], seed + 1)
    chain = Chain(part, richness, start, (), seed + 1)
    chain.heat = HEAT
    _run(chain, HOT)
    chain.heat = 1.0
    return chain


def _run(chain: Chain, number: int) -> None:
    for _ in chain.sweeps(number):
        pass


def best_point(weighing: Weighing) -> Point:
    """The likeliest noise without any term, at stated tolerances and without a remainder: every other value, then beside it."""
    shape = weighing.unknowns.shape
    kinds = len(shape) - 2

    def at(k: int) -> Point:
        return (*(min(k, n - 1) for n in shape[:kinds]), 0, 0)

    coarse = max(range(0, shape[0], 4), key=lambda k: weighing.root(at(k)).log_evidence)
    near = range(max(coarse - 3, 0), min(coarse + 4, shape[0]))
    return at(max(near, key=lambda k: weighing.root(at(k)).log_evidence))


def chain_disagreement(tallies: Sequence[Tally], weights: Array) -> float:
    """Largest difference of a cause's probability between chains that count alike; less where one hardly counts."""
    shares = np.array([t.causes for t in tallies])
    apart = 2.0 * weights @ np.abs(shares - weights @ shares)
    return float(np.max(apart, initial=0.0))


def chain_weights(
    part: Weighing, richness: Richness, tallies: Sequence[Tally]
) -> tuple[Array, dict[Seen, float]]:
    """(chains,) how much each chain counts, and the log posterior of every state that one of them visited.

    Chains that agree count alike. Where they do not, each is caught in sets of its own, and how long it stayed there says
    nothing of how probable they are: each counts by the posterior mass of the states that it visited, renormalised over all
    (as in shotgun stochastic search; Benner et al. 2016, Bioinformatics 32:1493). A state of several is shared among them.
    """
    every = dict.fromkeys(state for tally in tallies for state in tally.seen)
    logs = {(members, point): log_posterior(part, richness, members, point) for members, point in every}
    equal = np.full(len(tallies), 1.0 / len(tallies))
    if chain_disagreement(tallies, equal) <= APART:
        return equal, logs
    visitors = {state: sum(state in tally.seen for tally in tallies) for state in every}
    mass = [np.logaddexp.reduce([logs[s] - np.log(visitors[s]) for s in tally.seen]) for tally in tallies]
    return np.exp(mass - np.logaddexp.reduce(mass)), logs


def _gathered(
    part: Weighing, index: NDArray[np.intp], richness: Richness, tallies: Sequence[Tally]
) -> Posterior:
    weights, logs = chain_weights(part, richness, tallies)
    shares: dict[Seen, float] = dict.fromkeys(logs, 0.0)
    for weight, tally in zip(weights, tallies, strict=True):
        for state, count in tally.seen.items():
            shares[state] += float(weight) * count / tally.sweeps
    states, points = list[tuple[State, float]](), dict[Point, float]()
    for (members, point), share in sorted(shares.items(), key=lambda item: -item[1]):
        whole = tuple(sorted((int(index[term]), size) for term, size in members))
        states.append((State(whole, point, logs[members, point]), share))
        points[point] = points.get(point, 0.0) + share
    pairs = list(zip(weights, tallies, strict=True))
    beside = np.sum([w * t.beside / t.sweeps for w, t in pairs], axis=0)
    held = np.sum([w * t.held / t.sweeps for w, t in pairs], axis=0)[:, None]
    terms = np.minimum(np.sum([w * t.terms / t.sweeps for w, t in pairs], axis=0), 1.0)
    return Posterior(
        terms=dict(zip(index.tolist(), terms.tolist(), strict=True)),
        causes=np.sum([w * t.causes for w, t in pairs], axis=0),
        beside=beside / np.where(held > 0.0, held, 1.0),
        states=tuple(states),
        points=tuple(sorted(points.items(), key=lambda item: -item[1])),
        disagreement=chain_disagreement(tallies, weights),
        sweeps=sum(t.sweeps for t in tallies),
    )


def climbed(weighing: Weighing, richness: Richness, known: Sequence[State] = ()) -> State:
    """The likeliest state that climbs from nothing and from ``known`` states reach."""
    tops = climbed_tops(Climb(weighing, richness), weighing, best_point(weighing), known)
    return max(tops, key=lambda state: state.log_posterior)


def climbed_tops(climb: Climb, weighing: Weighing, start: Point, known: Sequence[State]) -> list[State]:
    """Where climbs from known states lead, and the one from nothing, which takes long where these are large."""
    large = any(len(weighing.columns(state.members)[0]) > LONG_SET for state in known)
    first = [] if large else [climb.from_(start, ())]
    return [*first, *(climb.from_(state.point, state.members) for state in known)]


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
