"""Chains with what they have counted, each weighted by the evidence of the region that it is in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import softmax

from truepose.arrays import Array
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.sampler import Chain, Sweep
from truepose.identification.posterior.spike_slab import Members, SpikeSlab
from truepose.identification.posterior.state import log_posterior
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

    def settle(self) -> None:
        """Let every chain go on by a sweep that does not count."""
        for chain in self._chains:
            next(chain.sweeps(1))

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
        return float(
            np.logaddexp.reduce([self.log_posterior(draw) for draw in sorted(states)]) - np.log(share)
        )

    @property
    def disagreement(self) -> float:
        """Twice the largest distance of a cause in chains from its mean; of two of one weight, how they differ."""
        shares, weights = np.array([t.causes for t in self.tallies]), self.weights
        return float(2.0 * np.max(weights @ np.abs(shares - weights @ shares), initial=0.0))
