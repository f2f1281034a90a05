"""The likeliest set: climbed slot by slot and step by step on the grid, from a start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.posterior.design import Point
from truepose.identification.posterior.sampler import Richness
from truepose.identification.posterior.weighing import Member, Members, Weighing

Array = NDArray[np.float64]
CLIMBS = 30
"""Most rounds of a climb: each adds one term at most."""
STEPS = (4, 1)
"""Steps on the axes of noise and remainder that are repeated while they gain, in turn."""
PASSES = 3
LADDER = (-1, 0, 1, 2, 4, 8, 14)
"""Steps of the noise at which a state is looked at without some of its members."""


@dataclass(frozen=True)
class State:
    """A set of terms with their sizes at a point of the grid, and its log posterior up to a constant."""

    members: Members
    point: Point
    log_posterior: float


class Climb:
    """Climbs of one problem. ``interest`` (c,): the largest log probability in a slot that each term had where one looked."""

    def __init__(self, weighing: Weighing, richness: Richness) -> None:
        self._weighing, self._richness = weighing, richness
        self.interest = np.full(len(weighing.terms), -np.inf)

    def from_(self, point: Point, members: Sequence[Member]) -> State:
        """A state whose every slot holds the likeliest cause beside the others, or nothing, at the likeliest point near."""
        current = list(members)
        for _ in range(CLIMBS):
            before, here = set(current), point
            point = self._best_point(point, current, thorough=False)
            grown = [*current, *self._best(point, current)]
            if len(grown) > len(current):
                current = grown
                continue
            for member in sorted(current, key=lambda m: self._weighing.sizes.values[m[1]]):
                rest = [m for m in current if m != member]
                current = [*rest, *self._best(point, rest, (member,))]
            point = self._best_point(point, current)
            if set(current) == before and point == here:
                break
        found = tuple(sorted(current))
        return State(found, point, log_posterior(self._weighing, self._richness, found, point))

    def look(self, point: Point, members: Sequence[Member]) -> None:
        """Take note of what every slot of a state may hold, and one more, with its remainder and without any."""
        for size in {0, point[-1]}:
            at = (*point[:-1], size)
            self._note(at, members)
            for member in members:
                self._note(at, [m for m in members if m != member], (member,))

    def point_near(self, point: Point, members: Sequence[Member]) -> Point:
        """The likeliest point near one."""
        return self._best_point(point, members)

    def _note(self, point: Point, rest: Sequence[Member], leaving: Members = ()) -> None:
        conditional = self._weighing.conditional(point, rest, leaving=leaving)
        slot = slot_odds(self._richness, len(rest))
        own = np.log(np.maximum(conditional.terms(slot), 1e-300))
        np.maximum(self.interest, own, out=self.interest)

    def _best(self, point: Point, rest: Sequence[Member], leaving: Members = ()) -> list[Member]:
        """The likeliest term of the likeliest cause in a slot, at its likeliest size; none where nothing is likelier."""
        odds = self._weighing.conditional(point, rest, leaving=leaving).log_odds
        own = np.logaddexp.reduce(odds, axis=0)
        cause, top = self._weighing.terms.cause, float(own.max(initial=-np.inf))
        if not np.isfinite(top):
            return []  # nothing may stand beside the rest
        weight = np.bincount(cause, weights=np.exp(own - top))
        best = int(np.argmax(weight))
        if float(np.log(weight[best])) + top + slot_odds(self._richness, len(rest)) < 0.0:
            return []
        term = int(np.argmax(np.where(cause == best, own, -np.inf)))
        return [(term, int(np.argmax(odds[:, term])))]

    def _best_point(self, point: Point, members: Sequence[Member], *, thorough: bool = True) -> Point:
        """Coordinates in turn, until none gains: noise and remainder; if ``thorough`` each kind's noise and tolerances, too."""
        shape = self._weighing.unknowns.shape
        kinds = len(shape) - 2
        axes = [tuple(range(kinds)), (kinds + 1,)]
        if thorough and kinds > 1:
            axes += [(k,) for k in range(kinds)]
        best, value = point, self._weighing.log_evidence(point, members)

        def tried(other: Point) -> bool:
            nonlocal best, value
            if not all(0 <= k < n for k, n in zip(other, shape, strict=True)):
                return False
            new = self._weighing.log_evidence(other, members)
            better = new > value
            if better:
                best, value = other, new
            return better

        for _ in range(PASSES if thorough else 1):
            first = best
            for axis in axes:
                for step in STEPS:
                    while tried(_moved(best, axis, -step)) or tried(_moved(best, axis, step)):
                        pass
            if thorough:
                for k in range(shape[kinds]):
                    tried((*best[:kinds], k, best[-1]))
            if best == first:
                break
        return best


def _moved(point: Point, axes: Sequence[int], step: int) -> Point:
    return tuple(k + step if axis in axes else k for axis, k in enumerate(point))


def supports(weighing: Weighing, state: State, parts: Sequence[NDArray[np.intp]]) -> list[float]:
    """Log Bayes factor of a state against it without some of its columns, noise adapting: for each of ``parts``.

    parts: places (k,) among the columns of all members. Without them the noise can only be larger.
    """
    kinds, (columns, sizes) = len(weighing.unknowns.shape) - 2, weighing.columns(state.members)
    whole, without = -np.inf, np.full(len(parts), -np.inf)
    for step in LADDER:
        point = _moved(state.point, range(kinds), step)
        if not all(0 <= k < n for k, n in zip(point, weighing.unknowns.shape, strict=True)):
            continue
        there = weighing.root(point).including(columns, sizes)
        whole = max(whole, there.log_evidence)
        left = [there.without(part).log_evidence for part in parts]
        without = np.maximum(without, left)
    return [float(whole - value) for value in without]


def slot_odds(richness: Richness, number: int) -> float:
    """Log prior odds of one more member beside ``number``, whichever slot it takes, richness marginalised."""
    same, more = richness.log_totals[number : number + 2].tolist()
    return float(more - same) + float(np.log(max(richness.slots - number, 1)))


def log_posterior(weighing: Weighing, richness: Richness, members: Members, point: Point) -> float:
    """Up to a constant, richness and the order of slots marginalised."""
    number = sum(slot_odds(richness, k) for k in range(len(members)))
    here = weighing.log_evidence(point, members) + weighing.log_bounds(point, members)
    return here + weighing.log_prior(members) + number
