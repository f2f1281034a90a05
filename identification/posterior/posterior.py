"""The posterior over sets, from two chains: how probable each term and cause is, which stand in for each other, the
likeliest sets, and how far the chains agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.mode import (
    LIKELY,
    State,
    alternatives,
    ascended,
    best_point,
    log_posterior,
    plausible,
)
from truepose.identification.posterior.sampler import Chain, Sweep
from truepose.identification.posterior.spike_slab import Member, Members, SpikeSlab
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

    def __init__(self, spike_slab: SpikeSlab) -> None:
        self._cause, self._given = spike_slab.terms.cause, spike_slab.given
        self.terms, self.number = np.zeros(len(spike_slab.terms)), spike_slab.terms.n_causes
        self.beside, self.held = np.zeros((self.number, self.number)), np.zeros(self.number)
        self.draws = list[tuple[Members, GridPoint]]()

    @property
    def sweeps(self) -> int:
        """How many were counted."""
        return len(self.draws)

    def add(self, sweep: Sweep) -> None:
        """One sweep more."""
        for term, _ in self._given:
            one = np.zeros(len(self.terms))
            one[term] = 1.0
            self._count(one, filled=True)
        for visit in sweep.visits:
            self._count(visit.terms, filled=visit.filled)
        self.draws.append((tuple(sorted((*self._given, *sweep.members))), sweep.point))

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


class Chains:
    """Chains with what they have counted, each weighted by the evidence of the region that it is in.

    Regions that no chain crosses between are weighed as Gelfand and Dey (1994, JRSS B 56:501) do: the evidence of a region is
    the posterior of some of its states, by the share of draws that fall on them. The states are those of one half of a
    chain, and the draws those of the other.
    """

    def __init__(self, part: SpikeSlab, richness: Richness, chains: Sequence[Chain]) -> None:
        self._chains, self._richness = chains, richness
        self._whole = SpikeSlab(part.design, part.unknowns, part.terms, part.sizes)
        self._logs = dict[tuple[Members, GridPoint], float]()
        self.tallies = [Tally(part) for _ in chains]

    def run(self, sweeps: int) -> None:
        """So many sweeps more of every chain."""
        for chain, tally in zip(self._chains, self.tallies, strict=True):
            for sweep in chain.sweeps(sweeps):
                tally.add(sweep)

    def log_posterior(self, draw: tuple[Members, GridPoint]) -> float:
        """Of a state that was drawn, up to a constant."""
        if draw not in self._logs:
            self._logs[draw] = log_posterior(self._whole, self._richness, *draw)
        return self._logs[draw]

    @property
    def weights(self) -> Array:
        """(k,) of the chains."""
        return np.asarray(softmax(self.log_evidences))

    @property
    def log_evidences(self) -> Array:
        """(k,) of the regions of the chains, up to a constant that all share."""
        return np.array([self._log_evidence(tally.draws) for tally in self.tallies])

    def _log_evidence(self, draws: Sequence[tuple[Members, GridPoint]]) -> float:
        """Either half of the draws in turn says which states."""
        half = len(draws) // 2
        return float(
            np.mean([self._seen(draws[:half], draws[half:]), self._seen(draws[half:], draws[:half])])
        )

    def _seen(
        self, some: Sequence[tuple[Members, GridPoint]], others: Sequence[tuple[Members, GridPoint]]
    ) -> float:
        states = set(some)
        share = (sum(draw in states for draw in others) + 0.5) / (len(others) + 1.0)
        return float(
            np.logaddexp.reduce([self.log_posterior(draw) for draw in sorted(states)]) - np.log(share)
        )

    @property
    def disagreement(self) -> float:
        """Twice the largest distance of a cause in chains from its mean; of two of one weight, how they differ."""
        shares, weights = np.array([t.causes for t in self.tallies]), self.weights
        return float(2.0 * np.max(weights @ np.abs(shares - weights @ shares), initial=0.0))


def sample(
    spike_slab: SpikeSlab,
    richness: Richness,
    *,
    seed: int = 1,
    known: Sequence[State] = (),
    rounds: int = ROUNDS,
) -> Posterior:
    """Two chains, from the likeliest top and the next (or from half of the one), until they agree or long enough.

    Terms and values of the grid that are hopeless around the tops are left out, and what nothing can replace there is given.
    """
    every = tops(spike_slab, richness, known)
    top, other = every[0], every[min(1, len(every) - 1)]
    around = plausible(spike_slab, richness, every)
    whole, index = spike_slab.restricted(around.terms)
    number = {int(term): k for k, term in enumerate(index)}
    part = whole.conditioned([(number[term], size) for term, size in around.certain])

    def free(state: State) -> list[Member]:
        return [(number[term], size) for term, size in state.members if (term, size) not in around.certain]

    starts = ((top.point, free(top)), (other.point, free(other) if other is not top else free(top)[::2]))
    chains = [
        Chain(part, richness, around.reach, point, members, seed + k)
        for k, (point, members) in enumerate(starts)
    ]
    shorter = SHORTER if len(spike_slab.columns(top.members)[0]) > LONG_SET else 1
    for chain in chains:
        for _ in chain.sweeps(BURN // shorter):
            pass
    counted = Chains(part, richness, chains)
    most = max(rounds // shorter, 1)
    least = 1 if other is top else (most + 1) // 2  # a region is not weighed before its chain has settled
    for done in range(1, most + 1):
        counted.run(ROUND // shorter)
        if done >= least and counted.disagreement <= AGREED:
            break
    return _gathered(part, index, counted)


def _gathered(part: SpikeSlab, index: NDArray[np.intp], chains: Chains) -> Posterior:
    weights, tallies = chains.weights, chains.tallies
    shares, points = Counter[tuple[Members, GridPoint]](), Counter[GridPoint]()
    for weight, tally in zip(weights.tolist(), tallies, strict=True):
        for draw in tally.draws:
            shares[draw] += weight / tally.sweeps
            points[draw[1]] += weight / tally.sweeps
    states = [
        (
            State(
                tuple(sorted((int(index[term]), size) for term, size in draw[0])),
                draw[1],
                chains.log_posterior(draw),
            ),
            share,
        )
        for draw, share in sorted(shares.items(), key=lambda item: -item[1])
    ]
    by_sweep = weights / [t.sweeps for t in tallies]
    beside = sum(w * t.beside for w, t in zip(by_sweep, tallies, strict=True))
    held = np.sum([w * t.held for w, t in zip(by_sweep, tallies, strict=True)], axis=0)[:, None]
    terms = np.minimum(by_sweep @ [t.terms for t in tallies], 1.0)
    return Posterior(
        terms=dict(zip(index.tolist(), terms.tolist(), strict=True)),
        causes=weights @ [t.causes for t in tallies],
        beside=np.asarray(beside / np.where(held > 0.0, held, 1.0)),
        states=tuple(states),
        points=tuple(points.most_common()),
        disagreement=chains.disagreement,
        sweeps=sum(t.sweeps for t in tallies),
    )


def climbed(spike_slab: SpikeSlab, richness: Richness, known: Sequence[State] = ()) -> State:
    """The likeliest state that ascents from nothing and from ``known`` states reach."""
    return tops(spike_slab, richness, known)[0]


def tops(spike_slab: SpikeSlab, richness: Richness, known: Sequence[State]) -> list[State]:
    """Where ascents lead, from known states or else from nothing, and what is nearly as likely by exchanges of kinds; the
    likeliest first."""
    starts = [(state.point, state.members) for state in known] or [(best_point(spike_slab), ())]
    found = [ascended(spike_slab, richness, *start) for start in starts]
    best = max(found, key=lambda state: state.log_posterior)
    found += alternatives(spike_slab, richness, best)
    every = sorted({state.members: state for state in found}.values(), key=lambda state: -state.log_posterior)
    return [state for state in every if state.log_posterior > every[0].log_posterior - LIKELY]


def mode(posterior: Posterior, spike_slab: SpikeSlab) -> State:
    """The visited state that agrees best with the probabilities: it holds what is likelier there than not, and no more.

    A cause counts with its class where few causes stand in for each other.
    """
    own, whole = posterior.causes, _with_classes(posterior)

    def agreement(state: State) -> float:
        causes = sorted(
            {int(spike_slab.terms.cause[term]) for term, _ in state.members}, key=lambda k: -own[k]
        )
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
