"""The posterior over sets, from two chains: how probable each term and cause is, which stand in for each other, the
likeliest sets, and how far the chains agree.

Chains with what they have counted, each weighted by the evidence of the region that it is in.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from truepose.arrays import Array, Index
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.sampler import Chain, Sweep, plausible
from truepose.identification.posterior.spike_slab import Member, Members, SpikeSlab
from truepose.identification.posterior.state import State, log_posterior, tops
from truepose.identification.prior import Richness

CHANCE = 1.0
"""Nats by which the evidence of one region may come out differently, beside what the halves of a chain differ by."""


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
        return np.asarray(np.bincount(self._cause, weights=terms, minlength=self.number), dtype=float)

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
        self._part = part
        self._logs = dict[tuple[Members, GridPoint], float]()
        self.tallies = [Tally(part) for _ in chains]

    def run(self) -> None:
        """Let every chain go on by a sweep, and count it."""
        for chain, tally in zip(self._chains, self.tallies, strict=True):
            tally.add(next(chain.sweeps(1)))

    @property
    def sweeps(self) -> int:
        """Sweeps of each chain that were counted."""
        return self.tallies[0].sweeps

    def log_posterior(self, draw: tuple[Members, GridPoint]) -> float:
        """Of a state that was drawn, up to a constant."""
        if draw not in self._logs:
            members, point = draw
            free = tuple(m for m in members if m not in self._part.given)
            self._logs[draw] = log_posterior(self._part, self._richness, free, point)
        return self._logs[draw]

    @property
    def weights(self) -> Array:
        """(k,) of the chains; equal where their regions differ by no more than chance makes of one."""
        found = self.log_evidences
        if np.ptp(found.mean(axis=1)) <= CHANCE + np.max(np.ptp(found, axis=1)):
            return np.full(len(found), 1.0 / len(found))
        return np.asarray(softmax(found.mean(axis=1)))

    @property
    def log_evidences(self) -> Array:
        """(k, 2) of the chains' regions, up to a constant that all share: states of either half, seen by the other."""
        halves = [(t.draws[: len(t.draws) // 2], t.draws[len(t.draws) // 2 :]) for t in self.tallies]
        return np.array([[self._seen(first, last), self._seen(last, first)] for first, last in halves])

    def _seen(
        self, some: Sequence[tuple[Members, GridPoint]], others: Sequence[tuple[Members, GridPoint]]
    ) -> float:
        states = set(some)
        share = (sum(draw in states for draw in others) + 0.5) / (len(others) + 1.0)
        logs = [self.log_posterior(draw) for draw in sorted(states)]
        return float(np.logaddexp.reduce(logs) - np.log(share))

    @property
    def disagreement(self) -> float:
        """Twice the largest distance of a cause in chains from its mean; of two of one weight, how they differ."""
        shares, weights = np.array([t.causes for t in self.tallies]), self.weights
        return float(2.0 * np.max(weights @ np.abs(shares - weights @ shares), initial=0.0))


AGREED = 0.03
"""Largest difference of a cause's probability between two chains that is none."""
BURN, ROUND, ROUNDS = 25, 40, 8
"""Sweeps of a chain before it counts, sweeps of each round, and most rounds."""
ALIKE = 0.05
"""Share of a slot from which on two causes stand in for each other."""
SHORTER = 4
"""By how much the budget of chains is smaller for a long set."""
BUDGET, SETTLING, FEWEST = 24e9, 0.2, 4
"""Operations after which chains end whether they agree or not, the share of them in which chains settle, and sweeps that
count at least."""


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
    cut: bool = False
    """Whether the chains ended with their budget of work, before they agreed or were long enough."""

    @property
    def slots(self) -> Array:
        """Return the probability (n,) that each cause is there, or what stands in for it."""
        return np.asarray(np.clip((self.beside > ALIKE) @ self.causes, self.causes, 1.0))


def sample(
    spike_slab: SpikeSlab,
    richness: Richness,
    *,
    seed: int = 1,
    known: Sequence[State] = (),
    rounds: int = ROUNDS,
) -> Posterior:
    """What two chains say that agree, or are long enough."""
    return Sampling(spike_slab, richness, seed=seed, known=known).posterior(rounds)


class Sampling:
    """Two chains, from the likeliest top and the next (or from half of the one), which go on where they stopped.

    Terms and values of the grid that are hopeless around the tops are left out, and what nothing can replace there is given.
    ``stop``: whether somebody asked for an end; it is asked before each sweep.
    """

    def __init__(
        self,
        spike_slab: SpikeSlab,
        richness: Richness,
        *,
        seed: int = 1,
        known: Sequence[State] = (),
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self._stop = stop
        every = tops(spike_slab, richness, known)
        top, other = every[0], every[min(1, len(every) - 1)]
        around = plausible(spike_slab, richness, every)
        whole, self._index = spike_slab.restricted(around.terms)
        spike_slab.forget()  # chains have a memory of their own
        number = {int(term): k for k, term in enumerate(self._index)}
        self._part = whole.conditioned([(number[term], size) for term, size in around.certain])

        def free(state: State) -> list[Member]:
            return [(number[t], size) for t, size in state.members if (t, size) not in around.certain]

        starts = ((top.point, free(top)), (other.point, free(other) if other is not top else free(top)[::2]))
        chains = [
            Chain(self._part, richness, around.widenings, point, members, seed + k)
            for k, (point, members) in enumerate(starts)
        ]
        self._budget = BUDGET / (SHORTER if spike_slab.is_long(top.members) else 1)
        self._chains, self._done, self._apart = Chains(self._part, richness, chains), 0, other is not top
        for _ in range(BURN):
            if self._part.work < SETTLING * self._budget and not stop():
                for chain in chains:
                    next(chain.sweeps(1))

    @property
    def work(self) -> float:
        """Operations that the chains took."""
        return self._part.work

    def posterior(self, rounds: int = ROUNDS) -> Posterior:
        """What the chains say once they agree, or after so many rounds in all."""
        # a region is not weighed before its chain has settled
        least = (rounds + 1) // 2 if self._apart else 1
        budget = self._budget * (SETTLING + (1.0 - SETTLING) * rounds / ROUNDS)
        while self._done < least or (self._done < rounds and self._chains.disagreement > AGREED):
            round_over = self._part.work + self._budget / ROUNDS
            for _ in range(ROUND):
                over = self._part.work > budget or self._stop()
                if over and self._chains.sweeps >= FEWEST:
                    return _gathered(self._index, self._chains, cut=True)
                if self._part.work > round_over and self._chains.sweeps >= FEWEST:
                    break  # long sweeps: it is asked more often whether the chains agree
                self._chains.run()
            self._done += 1
        return _gathered(self._index, self._chains, cut=False)


def _gathered(index: Index, chains: Chains, *, cut: bool) -> Posterior:
    weights, tallies = chains.weights, chains.tallies
    shares, points = Counter[tuple[Members, GridPoint]](), Counter[GridPoint]()
    for weight, tally in zip(weights.tolist(), tallies, strict=True):
        for draw in tally.draws:
            shares[draw] += weight / tally.sweeps
            points[draw[1]] += weight / tally.sweeps
    states = list[tuple[State, float]]()
    for draw, share in shares.most_common():
        members = tuple(sorted((int(index[term]), size) for term, size in draw[0]))
        states.append((State(members, draw[1], chains.log_posterior(draw)), share))
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
        cut=cut,
    )


def mode(posterior: Posterior, spike_slab: SpikeSlab) -> State:
    """Return the visited state that agrees best with the probabilities: it holds what is likelier there than not, and no more.

    A cause counts half for itself, so that the likeliest of a slot stands for it, and half with what stands in for it.
    """
    own, slots = posterior.causes, posterior.slots

    def agreement(state: State) -> float:
        held = {int(spike_slab.terms.cause[term]) for term, _ in state.members}
        causes = sorted(held, key=lambda k: -own[k])
        return sum(there(k, causes[:i]) - 0.5 for i, k in enumerate(causes))

    def there(k: int, before: Sequence[int]) -> float:
        """Probability of a cause with its slot; of a second one of a slot, that it is there beside the first."""
        mates = [j for j in before if posterior.beside[k, j] > ALIKE]
        if mates:
            return float(own[k] + own[mates[0]] - max(slots[mates[0]], own[k]))
        return float(slots[k] + own[k]) / 2.0

    states = (state for state, _ in posterior.states)
    return max(states, key=lambda s: (round(agreement(s), 3), s.log_posterior))
