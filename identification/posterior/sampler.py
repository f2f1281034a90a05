"""A Gibbs sampler over sets of terms: slots that are empty or hold one term with its size.

One slot at a time is emptied and drawn anew from its full conditional over all terms at all sizes; two at a time are
exchanged, so that a pair may become another pair; passages lead to sets that lie far apart; then the point of the grid
(noise, tolerances, remainder) and the richness (how many effects such machines have) are drawn. Terms that would hardly
ever leave are left alone in some sweeps, there or not: they are taken in once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import lgamma

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from truepose.identification.posterior.design import Point
from truepose.identification.posterior.weighing import Conditional, Member, Members, Weighing

Array = NDArray[np.float64]
SETTLED = 20.0
"""Log odds of staying above which a term may change only now and then."""
CALM, REVISITED = 4.0, 0.3
"""Log odds of staying above which a term may change in so many of the sweeps only: what is beside it changes faster."""
REVIEWS, REVIEWED = 0.25, 4
"""Share of the sweeps in which some settled terms may change, and how many of them: each time the others are taken in anew."""
PAIRS = 1
STEPS = 4
"""Exchanges of two slots, and steps on the grid, in each sweep."""
LONG, LONG_STEPS = 150, 0.4
"""Columns of all members beyond which fewer steps a sweep have to do: each costs their factor."""


@dataclass(frozen=True)
class Richness:
    """How many effects machines have: levels of the probability that a slot is filled, the log prior of each, and the slots."""

    filled: tuple[float, ...]
    log_prior: tuple[float, ...]
    slots: int

    def log_weights(self, number: int) -> Array:
        """(r,) log posterior of each level for a number of members."""
        p = np.array(self.filled)
        out: Array = np.array(self.log_prior) + number * np.log(p) + (self.slots - number) * np.log1p(-p)
        return out

    @cached_property
    def log_totals(self) -> Array:
        """(slots + 2,) log prior of certain slots being filled, for each number of them and one more, levels summed."""
        return np.array([logsumexp(self.log_weights(number)) for number in range(self.slots + 2)])

    @cached_property
    def _cumulated(self) -> Array:
        """(slots + 2, r) posterior probability of each level and all before it, for each number of members."""
        weights = [self.log_weights(number) for number in range(self.slots + 2)]
        sums = np.cumsum(np.exp(np.array(weights) - self.log_totals[:, None]), axis=1)
        return np.asarray(sums / sums[:, -1:])

    def draw(self, number: int, rng: np.random.Generator) -> int:
        """A level for a number of members."""
        return int(np.searchsorted(self._cumulated[number], rng.random(), side="right"))

    def log_odds(self, level: int) -> float:
        """Of a slot being filled."""
        return float(np.log(self.filled[level] / (1.0 - self.filled[level])))


@dataclass(frozen=True)
class Visit:
    """A slot's full conditional: probability (c,) of each term, nothing being the rest; ``filled``: whether it held one."""

    terms: Array
    filled: bool


@dataclass(frozen=True)
class Sweep:
    """Where a chain stands after a sweep, and what its slots were drawn from."""

    members: Members
    point: Point
    visits: tuple[Visit, ...]


@dataclass(frozen=True)
class Passage:
    """A way between two sets that lie far apart: members that leave, members that enter, and the steps on the grid's axes."""

    leave: Members
    enter: Members
    steps: Point

    @classmethod
    def between(cls, here: tuple[Members, Point], there: tuple[Members, Point]) -> Passage:
        """What tells two states apart."""
        (own, point), (other, away) = here, there
        return cls(
            tuple(m for m in own if m not in other),
            tuple(m for m in other if m not in own),
            tuple(b - a for a, b in zip(point, away, strict=True)),
        )

    @property
    def back(self) -> Passage:
        """The way back."""
        return Passage(self.enter, self.leave, tuple(-k for k in self.steps))


class Chain:
    """One chain from a start; ``heat`` above 1 flattens all odds while it lasts.

    Until ``tuned`` is set a chain learns which terms hardly ever leave; after that it keeps to what it has learnt, for what is
    drawn must not depend on where the chain happens to be.
    """

    def __init__(
        self, weighing: Weighing, richness: Richness, point: Point, members: Sequence[Member], seed: int
    ) -> None:
        self._weighing, self._richness = weighing, richness
        self.point, self.members, self._level = point, list(members), 0
        self.heat, self.tuned = 1.0, False
        self.passages: tuple[Passage, ...] = ()
        self._rng = np.random.default_rng(seed)
        self._staying: dict[int, float] = {}
        self._firm, self._calm = list[int](), list[int]()
        self._settled: Members = ()
        self._kept = np.zeros(len(weighing.terms), dtype=bool)

    def sweeps(self, number: int) -> Iterator[Sweep]:
        """So many sweeps."""
        for _ in range(number):
            self._settle()
            visits = tuple(self._slots())
            for _ in range(PAIRS):
                self._exchange()
            for passage in self.passages:
                self._pass(passage)
            self._draw_level()
            self._settled = ()
            long = len(self._weighing.columns(self.members)[0]) > LONG
            for _ in range(STEPS):
                if not long or self._rng.random() < LONG_STEPS / STEPS:
                    self._step()
            self._draw_level()
            yield Sweep(tuple(self.members), self.point, visits)

    def _draw_level(self) -> None:
        """The richness, given how many members there are."""
        self._level = self._richness.draw(len(self.members), self._rng)

    def _settle(self) -> None:
        """Choose the terms that neither leave nor enter in this sweep, wherever the chain stands."""
        if not self.tuned:
            self._firm = sorted(t for t, odds in self._staying.items() if odds > SETTLED)
            self._calm = sorted(t for t, odds in self._staying.items() if CALM < odds <= SETTLED)
        self._kept[:] = False
        self._settled = ()
        if self.heat != 1.0:
            return
        review = REVIEWED if self._rng.random() < REVIEWS else 0
        firm = [self._firm[k] for k in self._rng.permutation(len(self._firm))[review:]]
        self._kept[firm] = True
        self._kept[self._calm] = self._rng.random() > REVISITED
        self._settled = tuple(sorted(m for m in self.members if m[0] in firm))

    def _slots(self) -> Iterator[Visit]:
        """Every slot drawn anew, full or empty, in an order that does not depend on what they hold."""
        slots: list[Member | None] = [*self.members, *[None] * (self._richness.slots - len(self.members))]
        for k in self._rng.permutation(len(slots)):
            member = slots[k]
            if member is not None and self._kept[member[0]]:
                yield Visit(_one(len(self._weighing.terms), member[0]), True)
            else:
                yield self._redraw(member)

    def _redraw(self, member: Member | None) -> Visit:
        """Draw a slot from its full conditional; one that would take a kept term stays as it is."""
        rest = [m for m in self.members if m != member]
        conditional = self._conditional(rest, () if member is None else (member,))
        terms = conditional.terms(self._slot)
        if member is not None:
            left = max(1.0 - float(terms[member[0]]), 1e-300)
            self._staying[member[0]] = (
                -float(np.log(left)) if left > 1e-12 else conditional.lead(member[0], self._slot)
            )
        drawn = conditional.draw(self._slot, self._rng)
        if drawn is None or not self._kept[drawn[0]]:
            self.members = rest if drawn is None else [*rest, drawn]
        if self._kept.any():
            free = max(1.0 - float(terms[self._kept].sum()), 1e-12)
            terms = np.where(self._kept, 0.0, terms / free)
        return Visit(terms, member is not None)

    @property
    def _slot(self) -> float:
        """Log odds of a slot being filled."""
        return self._richness.log_odds(self._level) / self.heat

    def _conditional(self, members: Sequence[Member], leaving: Members = ()) -> Conditional:
        return self._weighing.conditional(self.point, members, self._settled, leaving, self.heat)

    def _exchange(self) -> None:
        """Two full slots emptied and filled one after the other, accepted as Metropolis and Hastings say."""
        moving = [m for m in self.members if not self._kept[m[0]]]
        if len(moving) < 2:
            return
        first, second = (moving[k] for k in self._rng.choice(len(moving), 2, replace=False))
        rest = [m for m in self.members if m not in (first, second)]
        new = self._conditional(rest, (first, second)).draw(self._slot, self._rng)
        if new is None or self._kept[new[0]]:
            return
        between = [*rest, new]
        forward = self._conditional(between)
        last = forward.draw(self._slot, self._rng)
        if last is None or self._kept[last[0]]:
            return  # from fewer members the way back would not be as likely
        backward = self._conditional([*rest, first], (second,))
        if np.log(self._rng.random()) < forward.log_total(self._slot) - backward.log_total(self._slot):
            self.members = [*between, last]

    def _pass(self, passage: Passage) -> None:
        """Take a passage, or its way back, as Metropolis says: each leads to one state only, and from there back.

        Whatever the richness, which is drawn anew right after.
        """
        for way in (passage, passage.back):
            if not set(way.leave) <= set(self.members):
                continue
            there = [*(m for m in self.members if m not in way.leave), *way.enter]
            point = tuple(a + b for a, b in zip(self.point, way.steps, strict=True))
            if not self._possible(there, point):
                continue
            gain = self._log_weight(there, point) - self._log_weight(self.members, self.point)
            if np.log(self._rng.random()) < gain:
                self.members, self.point = there, point
            return

    def _possible(self, members: Sequence[Member], point: Point) -> bool:
        """Whether terms may stand together, and the point is on the grid."""
        terms = [term for term, _ in members]
        alone = not self._weighing.terms.excludes[np.ix_(terms, terms)][~np.eye(len(terms), dtype=bool)].any()
        inside = all(0 <= k < n for k, n in zip(point, self._weighing.unknowns.shape, strict=True))
        return alone and inside and len(set(terms)) == len(terms) <= self._richness.slots

    def _log_weight(self, members: Sequence[Member], point: Point) -> float:
        """Log posterior of a set at a point, whichever slots it takes."""
        number, slots = len(members), self._richness.slots
        ways = float(self._richness.log_totals[number]) - lgamma(slots - number + 1)
        return self._weighing.log_evidence(point, members) + self._weighing.log_prior(members) + ways

    def _step(self) -> None:
        """A step on the grid."""
        there = self._proposed()
        if there is None:
            return
        weighing = self._weighing
        gain = weighing.log_evidence(there, self.members) - weighing.log_evidence(self.point, self.members)
        if np.log(self._rng.random()) < gain / self.heat:
            self.point = there

    def _proposed(self) -> Point | None:
        """Another noise, of all kinds or of one, other tolerances, or another remainder; as likely as the way back."""
        shape, rng = self._weighing.unknowns.shape, self._rng
        kinds, out = len(shape) - 2, list(self.point)
        axis = int(rng.integers(0, 5))
        if axis == 0:
            out[kinds] = int(rng.integers(shape[kinds]))
        elif axis == 1:
            near = out[-1] + int(rng.choice((-1, 1)))
            out[-1] = int(rng.integers(shape[-1])) if rng.random() < 0.3 else near
        elif axis == 2 and kinds > 1:
            out[int(rng.integers(kinds))] += int(rng.choice((-4, -2, -1, 1, 2, 4)))
        else:
            step = int(rng.choice((-8, -4, -2, -1, 1, 2, 4, 8)))
            out[:kinds] = [k + step for k in out[:kinds]]
        inside = all(0 <= k < n for k, n in zip(out, shape, strict=True))
        return tuple(out) if inside and tuple(out) != self.point else None


def _one(size: int, at: int) -> Array:
    out = np.zeros(size)
    out[at] = 1.0
    return out
