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
STEPS = (8, 4, 2, 1)
"""Steps on the axis of noise that are tried, in turn."""


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
            point = self._best_point(point, current)
            grown = [*current, *self._best(point, current)]
            if len(grown) > len(current):
                current = grown
                continue
            for member in sorted(current, key=lambda m: self._weighing.sizes.values[m[1]]):
                rest = [m for m in current if m != member]
                current = [*rest, *self._best(point, rest)]
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
                self._note(at, [m for m in members if m != member])

    def point_near(self, point: Point, members: Sequence[Member]) -> Point:
        """The likeliest point near one."""
        return self._best_point(point, members)

    def evidence_near(self, point: Point, members: Sequence[Member]) -> float:
        """Log evidence of a set at the likeliest point near."""
        return self._weighing.log_evidence(self._best_point(point, members), members)

    def _note(self, point: Point, rest: Sequence[Member]) -> None:
        conditional, slot = self._weighing.conditional(point, rest), slot_odds(self._richness, len(rest))
        own = np.log(np.maximum(conditional.terms(slot), 1e-300))
        np.maximum(self.interest, own, out=self.interest)

    def _best(self, point: Point, rest: Sequence[Member]) -> list[Member]:
        """The likeliest term of the likeliest cause in a slot, at its likeliest size; none where nothing is likelier."""
        odds = self._weighing.conditional(point, rest).log_odds
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

    def _best_point(self, point: Point, members: Sequence[Member]) -> Point:
        """Coordinates in turn: noise of all kinds and of each, tolerances, remainder."""
        best = point
        value = self._weighing.log_evidence(best, members)
        for _ in range(3):
            first = best
            for other in self._moves(best):
                new = self._weighing.log_evidence(other, members)
                if new > value:
                    best, value = other, new
            if best == first:
                break
        return best

    def _moves(self, point: Point) -> list[Point]:
        shape = self._weighing.unknowns.shape
        kinds = len(shape) - 2
        axes = [tuple(range(kinds)), *((k,) for k in range(kinds if kinds > 1 else 0))]
        out = [_moved(point, axis, sign * step) for axis in axes for step in STEPS for sign in (-1, 1)]
        out += [(*point[:kinds], k, point[-1]) for k in range(shape[kinds])]
        out += [(*point[:-1], k) for k in {0, point[-1] - 1, point[-1] + 1, shape[-1] // 2}]
        return [p for p in out if all(0 <= k < n for k, n in zip(p, shape, strict=True)) and p != point]


def _moved(point: Point, axes: Sequence[int], step: int) -> Point:
    return tuple(k + step if axis in axes else k for axis, k in enumerate(point))


def slot_odds(richness: Richness, number: int) -> float:
    """Log prior odds of one more member beside ``number``, whichever slot it takes, richness marginalised."""
    more, same = (float(np.logaddexp.reduce(richness.log_weights(k))) for k in (number + 1, number))
    return more - same + float(np.log(max(richness.slots - number, 1)))


def log_posterior(weighing: Weighing, richness: Richness, members: Members, point: Point) -> float:
    """Up to a constant, richness and the order of slots marginalised."""
    number = sum(slot_odds(richness, k) for k in range(len(members)))
    return weighing.log_evidence(point, members) + weighing.log_prior(members) + number
