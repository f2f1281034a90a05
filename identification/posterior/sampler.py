"""Collapsed Gibbs sampling of a spike-and-slab posterior over sets of terms (George and McCulloch 1993, JASA 88:881).

Coefficients are integrated out, so a state is a set of terms with their sizes (the width of the slab) at a point of the
grid of nuisance parameters: noise, widening of tolerances, remainder. A machine has a number of slots, each empty (the
spike) or holding one term; how likely a slot is filled is integrated out, too. One sweep

* draws every slot anew from its full conditional over all terms at all sizes, or none of them; some together with a
  coordinate of the grid: what a term explains and what noise, tolerances or the remainder explain are rivals, and change
  places in one step;
* exchanges two full slots at once (Metropolis and Hastings), so that a pair may become another pair.

Inclusion probabilities are Rao-Blackwellised: each visit of a slot counts its full conditional, not what was drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln, softmax

from truepose.arrays import Array
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.spike_slab import Conditional, Member, Members, SpikeSlab
from truepose.identification.prior import Richness

JOINT, OTHERS = 0.2, 4
"""Share of the slots that are drawn together with an axis of the grid, and how many other values of it are weighed."""


@dataclass(frozen=True)
class Visit:
    """A slot's full conditional: probability (c,) of each term, nothing being the rest; ``filled``: whether it held one."""

    terms: Array
    filled: bool


@dataclass(frozen=True)
class Sweep:
    """Where a chain stands after a sweep, and what its slots were drawn from."""

    members: Members
    point: GridPoint
    visits: tuple[Visit, ...]


class Reach(NamedTuple):
    """Values of a grid's axes that are not hopeless: of the widening of tolerances, and of the remainder's size."""

    widening: tuple[int, ...]
    remainder: tuple[int, ...]


class Chain:
    """One chain from a start."""

    def __init__(
        self, spike_slab: SpikeSlab, richness: Richness, reach: Reach, point: GridPoint, members: Sequence[Member],
        seed: int,
    ) -> None:  # fmt: skip
        self._weighing, self._richness, self._reach = spike_slab, richness, reach
        self.point, self.members = point, list(members)
        self._rng = np.random.default_rng(seed)
        self._slots = richness.slots - len(spike_slab.given)

    def sweeps(self, number: int) -> Iterator[Sweep]:
        """So many sweeps."""
        for _ in range(number):
            visits = tuple(self._each_slot())
            self._exchange()
            self._other_kind()
            yield Sweep(tuple(self.members), self.point, visits)

    def _each_slot(self) -> Iterator[Visit]:
        """Every slot drawn anew, full or empty, in an order that does not depend on what they hold."""
        slots: list[Member | None] = [*self.members, *[None] * (self._slots - len(self.members))]
        for k in self._rng.permutation(len(slots)):
            yield self._redraw(slots[k], self._near() if self._rng.random() < JOINT else [self.point])

    def _redraw(self, member: Member | None, points: Sequence[GridPoint]) -> Visit:
        """Draw a slot together with the point, one of these; the present one is among them."""
        rest = [m for m in self.members if m != member]
        slot, leaving = self._slot(len(rest)), () if member is None else (member,)
        found = self._weighing.conditionals(points, rest, leaving, self.point)
        total = np.array([c.log_total(slot) + c.log_evidence for c in found])
        shares = np.exp(total - np.logaddexp.reduce(total))
        at = int(self._rng.choice(len(points), p=shares))
        self.point = points[at]
        drawn = found[at].draw(slot, self._rng)
        self.members = rest if drawn is None else [*rest, drawn]
        return Visit(shares @ [c.terms(slot) for c in found], member is not None)

    def _exchange(self) -> None:
        """Two full slots emptied and filled one after the other, accepted as Metropolis and Hastings say."""
        if len(self.members) < 2:
            return
        first, second = (self.members[k] for k in self._rng.choice(len(self.members), 2, replace=False))
        rest = [m for m in self.members if m not in (first, second)]
        slots = self._slot(len(rest)), self._slot(len(rest) + 1)
        new = self._weighing.conditional(self.point, rest, (first, second)).draw(slots[0], self._rng)
        if new is None:
            return
        forward = self._conditional([*rest, new])
        last = forward.draw(slots[1], self._rng)
        if last is None:
            return  # from fewer members the way back would not be as likely
        backward = self._conditional([*rest, first], second)
        if np.log(self._rng.random()) < forward.log_total(slots[1]) - backward.log_total(slots[1]):
            self.members = [*rest, new, last]

    def _other_kind(self) -> None:
        """All members of a kind replaced by some of another, drawn one after the other until one is nothing.

        The kind is chosen as a locally balanced proposal does (Zanella 2020, JASA 115:852): by the root of its weight. A set
        has no order; every order of its members is as likely.
        """
        kinds = self._weighing.terms.kind[[t for t, _ in self.members]]
        if not len(kinds):
            return
        chosen = int(self._rng.choice(np.unique(kinds)))
        old = [self.members[k] for k in self._rng.permutation(np.flatnonzero(kinds == chosen))]
        rest = [m for m in self.members if m not in old]
        new, forward = self._grown(rest, None)
        _, backward = self._grown(rest, old)
        log_ratio = forward - backward + gammaln(len(old) + 1) - gammaln(len(new) + 1)
        others = len(np.unique(kinds))
        log_ratio += np.log(others / len({int(self._weighing.terms.kind[t]) for t, _ in [*rest, *new]}))
        if np.log(self._rng.random()) < log_ratio:
            self.members = [*rest, *new]

    def _grown(self, rest: list[Member], given: Sequence[Member] | None) -> tuple[list[Member], float]:
        """Members of a kind that ``rest`` has none of, drawn (or the ``given`` ones), and the log of their weight over the
        probability of drawing them so."""
        kind, new, log = self._weighing.terms.kind, list[Member](), 0.0
        while len(rest) + len(new) < self._slots:
            beside = [*rest, *new]
            odds = (
                self._conditional(beside).log_odds
                + self._slot(len(beside))
                + np.log(self._slots - len(beside))
            )
            if not new:
                of_kind = np.full(int(kind.max()) + 1, -np.inf)
                np.logaddexp.at(of_kind, kind, np.logaddexp.reduce(odds, axis=0))
                of_kind[kind[[t for t, _ in rest]]] = -np.inf
                shares = softmax(0.5 * of_kind)
                of = int(kind[given[0][0]]) if given else int(self._rng.choice(len(shares), p=shares))
                log += float(
                    0.5 * of_kind[of] + np.logaddexp.reduce(0.5 * of_kind)
                )  # its weight over its share
            odds = np.where(kind == of, odds, -np.inf)
            if new:
                log += float(np.logaddexp.reduce(odds, axis=None, initial=0.0))
            if given is None:
                drawn = self._drawn(odds, nothing=bool(new))
            else:
                drawn = given[len(new)] if len(new) < len(given) else None
            if drawn is None:
                break
            new.append(drawn)
        return new, log

    def _drawn(self, odds: Array, *, nothing: bool) -> Member | None:
        """By odds (s, c), against nothing where that may be."""
        flat = np.append(odds.ravel(), 0.0 if nothing else -np.inf)
        at = int(self._rng.choice(len(flat), p=softmax(flat)))
        if at == odds.size:
            return None
        size, term = divmod(at, odds.shape[1])
        return int(term), int(size)

    def _near(self) -> list[GridPoint]:
        """A few points that differ in one coordinate, the present one among them: as likely chosen from each of them."""
        axis = int(self._rng.integers(1 + len(self._reach)))
        if axis == 0:
            return self.noises()
        name, values = self._reach._fields[axis - 1], self._reach[axis - 1]
        return [self.point.at(name, k) for k in self.some_of(values, getattr(self.point, name))]

    def some_of(self, values: Sequence[int], present: int) -> list[int]:
        """A few values of an axis, the present one among them: as likely chosen from each of them."""
        others = [k for k in values if k != present]
        picked = self._rng.choice(len(others), min(OTHERS, len(others)), replace=False)
        return [present, *(others[k] for k in picked)]

    def noises(self) -> list[GridPoint]:
        """Three neighbouring noises, of all kinds or of one, the present one among them: as likely chosen from each of them."""
        kinds, first = len(self.point.noise), int(self._rng.integers(-2, 1))
        which = int(self._rng.integers(-1, kinds)) if kinds > 1 else -1
        around = [
            self.point.louder(first + k)
            if which < 0
            else self.point.with_noise(which, self.point.noise[which] + first + k)
            for k in range(3)
        ]
        return [p for p in around if self._weighing.unknowns.holds(p)]

    def _conditional(self, members: Sequence[Member], leaving: Member | None = None) -> Conditional:
        return self._weighing.conditional(self.point, members, () if leaving is None else (leaving,))

    def _slot(self, number: int) -> float:
        """Log odds of a slot being filled beside ``number`` members and what is given."""
        return self._richness.slot(len(self._weighing.given) + number)
