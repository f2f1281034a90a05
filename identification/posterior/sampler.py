"""Collapsed Gibbs sampling of a spike-and-slab posterior over sets of terms (George and McCulloch 1993, JASA 88:881).

Coefficients are integrated out, so a state is a set of terms with their sizes (the width of the slab) at a point of the
grid of nuisance parameters: noise and widening of tolerances. A machine has a number of slots, each empty (the
spike) or holding one term; how likely a slot is filled is integrated out, too. One sweep

* draws every slot anew from its full conditional over all terms at all sizes, or none of them; some together with a
  coordinate of the grid: what a term explains and what noise or tolerances explain are rivals, and change
  places in one step;
* exchanges two full slots at once (Metropolis and Hastings), so that a pair may become another pair.

Inclusion probabilities are Rao-Blackwellised: each visit of a slot counts its full conditional, not what was drawn.

What chains draw from: terms and values of the grid that are not hopeless around a few states, and what is certain there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, softmax

from truepose.arrays import Array, Mask
from truepose.identification.posterior.design import GridPoint, Unknowns
from truepose.identification.posterior.halves import map_large
from truepose.identification.posterior.marginal import Marginal
from truepose.identification.posterior.spike_slab import Conditional, Member, Members, SpikeSlab
from truepose.identification.posterior.state import LOUDER, State, slot_odds
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


class Chain:
    """One chain from a start."""

    def __init__(
        self, spike_slab: SpikeSlab, richness: Richness, widenings: Sequence[int], point: GridPoint, members: Sequence[Member],
        seed: int,
    ) -> None:  # fmt: skip
        self._weighing, self._richness, self._widenings = spike_slab, richness, widenings
        self.point, self.members = point, list(members)
        self._rng = np.random.default_rng(seed)
        self._slots = richness.slots - len(spike_slab.given)

    def sweeps(self, number: int) -> Iterator[Sweep]:
        """So many sweeps."""
        for _ in range(number):
            # every slot is drawn anew, full or empty, in an order that does not depend on what they hold
            slots: list[Member | None] = [*self.members, *[None] * (self._slots - len(self.members))]
            visits = tuple(
                self._redraw(slots[k], self._near() if self._rng.random() < JOINT else [self.point])
                for k in self._rng.permutation(len(slots))
            )
            self._exchange()
            self._other_group()
            yield Sweep(tuple(self.members), self.point, visits)

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

    def _other_group(self) -> None:
        """All members of a group replaced by some of another, drawn one after the other until one is nothing.

        The group is chosen as a locally balanced proposal does (Zanella 2020, JASA 115:852): by the root of its weight. A set
        has no order; every order of its members is as likely.
        """
        groups = self._weighing.terms.group[[t for t, _ in self.members]]
        if not len(groups):
            return
        chosen = int(self._rng.choice(np.unique(groups)))
        old = [self.members[k] for k in self._rng.permutation(np.flatnonzero(groups == chosen))]
        rest = [m for m in self.members if m not in old]
        new, forward = self._grown(rest, None)
        _, backward = self._grown(rest, old)
        log_ratio = forward - backward + gammaln(len(old) + 1) - gammaln(len(new) + 1)
        others = len(np.unique(groups))
        log_ratio += np.log(others / len({int(self._weighing.terms.group[t]) for t, _ in [*rest, *new]}))
        if np.log(self._rng.random()) < log_ratio:
            self.members = [*rest, *new]

    def _grown(self, rest: list[Member], given: Sequence[Member] | None) -> tuple[list[Member], float]:
        """Members of a group that ``rest`` has none of, drawn (or the ``given`` ones), and the log of their weight over the
        probability of drawing them so."""
        group, new, log = self._weighing.terms.group, list[Member](), 0.0
        while len(rest) + len(new) < self._slots:
            beside = [*rest, *new]
            odds = self._conditional(beside).log_odds + self._slot(len(beside))
            odds = odds + np.log(self._slots - len(beside))
            if not new:
                of_group = np.full(int(group.max()) + 1, -np.inf)
                np.logaddexp.at(of_group, group, np.logaddexp.reduce(odds, axis=0))
                of_group[group[[t for t, _ in rest]]] = -np.inf
                shares = softmax(0.5 * of_group)
                of = int(group[given[0][0]]) if given else int(self._rng.choice(len(shares), p=shares))
                # its weight over its share
                log += float(0.5 * of_group[of] + np.logaddexp.reduce(0.5 * of_group))
            odds = np.where(group == of, odds, -np.inf)
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
        if self._rng.integers(2) == 0:
            return self.noises()
        return [self.point.widened(k) for k in self.some_of(self._widenings, self.point.widening)]

    def some_of(self, values: Sequence[int], present: int) -> list[int]:
        """A few values of an axis, the present one among them: as likely chosen from each of them."""
        others = [k for k in values if k != present]
        picked = self._rng.choice(len(others), min(OTHERS, len(others)), replace=False)
        return [present, *(others[k] for k in picked)]

    def noises(self) -> list[GridPoint]:
        """Three neighbouring noises, of all kinds or of one, the present one among them: as likely chosen from each of them."""
        kinds, first = len(self.point.noise), int(self._rng.integers(-2, 1))
        which = int(self._rng.integers(-1, kinds)) if kinds > 1 else -1
        near, steps = self.point, range(first, first + 3)
        if which < 0:
            around = [near.louder(k) for k in steps]
        else:
            around = [near.with_noise(which, near.noise[which] + k) for k in steps]
        return [p for p in around if self._weighing.unknowns.holds(p)]

    def _conditional(self, members: Sequence[Member], leaving: Member | None = None) -> Conditional:
        return self._weighing.conditional(self.point, members, () if leaving is None else (leaving,))

    def _slot(self, number: int) -> float:
        """Log odds of a slot being filled beside ``number`` members and what is given."""
        return self._richness.slot(len(self._weighing.given) + number)


HOPELESS, CERTAIN = 6.0, 20.0
"""Log odds below which a term is left out of the chains, and from which on a member is no question any more."""


@dataclass(frozen=True)
class Plausible:
    """What chains draw from: ``terms`` (c,) that are not hopeless in some slot, and such widenings of tolerances;
    ``certain``: members that nothing can replace."""

    terms: Mask
    widenings: tuple[int, ...]
    certain: Members


def plausible(spike_slab: SpikeSlab, richness: Richness, states: Sequence[State]) -> Plausible:
    """Around states, whose log posterior is the measure: what each slot may hold, and one more, here and where the grid may be.

    The rival of a term is another term, or a departure of the grid from what is stated.
    """
    long = spike_slab.is_long(states[0].members)
    interest = np.full(len(spike_slab.terms), -np.inf)
    widenings = set[int]()
    certain = set.intersection(*(set(state.members) for state in states))
    for state in states:
        table = _without_each(spike_slab, richness, state)
        alive = {p for row in table.values() for p, log in row.items() if log > -CERTAIN}
        for leaving, row in table.items():
            rest = [m for m in state.members if m not in leaving]
            points = {state.point}
            if not leaving:
                points = _stated(state.point, row)
            elif not long:  # of a long set, which takes long, only where it is
                points.add(max(row, key=lambda p: row[p]))
            for point in points:
                odds = np.logaddexp.reduce(spike_slab.log_odds(point, rest, leaving), axis=0)
                odds += row[point] + slot_odds(richness, len(rest))
                np.maximum(interest, odds, out=interest)
                alive |= {point} if odds.max(initial=-np.inf) > -CERTAIN else set()
                others = np.logaddexp.reduce(np.delete(odds, [m[0] for m in leaving]), initial=row[point])
                certain -= set(leaving) if others > -CERTAIN else set()
        interest[[term for term, _ in state.members]] = np.inf
        widenings |= {p.widening for p in alive}
    return Plausible(interest > -HOPELESS, tuple(sorted(widenings)), tuple(sorted(certain)))


def _stated(point: GridPoint, row: Mapping[GridPoint, float]) -> set[GridPoint]:
    """A point, quieter ones, and stated tolerances: where a term may stand that the grid stands in for."""
    first = point.noise[0]
    quieter = {p for p in row if p.noise[0] < first and p == point.louder(p.noise[0] - first)}
    return {point, *quieter} | {p for p in row if p == point.widened(0)}


def _without_each(
    spike_slab: SpikeSlab, richness: Richness, state: State
) -> dict[Members, dict[GridPoint, float]]:
    """Log posterior of a state as it is, and without each of its members, less its own, at points around.

    By what leaves; the points differ from the state's in one coordinate.
    """
    part, columns, sizes = spike_slab.of_members(state.members)
    widths = [len(spike_slab.terms.columns[t]) for t, _ in state.members]
    owner = np.repeat(np.arange(len(widths)), widths)
    own = spike_slab.log_evidence(state.point, state.members)
    out: dict[Members, dict[GridPoint, float]] = {(): {}, **{(m,): {} for m in state.members}}
    points = _around(spike_slab.unknowns, state.point)
    roots, width = [part.root(point) for point in points], len(columns)

    def weighed(root: Marginal) -> tuple[float, list[float]]:
        there = root.including(columns, sizes)
        each = (there.without(np.flatnonzero(owner == k)) for k in range(len(state.members)))
        return there.log_evidence - own, [without.log_evidence - own for without in each]

    whole_prior, slot = (
        spike_slab.log_prior(state.members),
        slot_odds(richness, max(len(state.members) - 1, 0)),
    )
    prior = {
        m: spike_slab.log_prior([k for k in state.members if k != m]) - whole_prior for m in state.members
    }
    every = map_large(weighed, roots, width**2 * (2.0 * width + part.design.n))
    for point, (whole, gone) in zip(points, every, strict=True):
        out[()][point] = whole
        for member, value in zip(state.members, gone, strict=True):
            out[member,][point] = value + prior[member] - slot
    return out


def _around(unknowns: Unknowns, point: GridPoint) -> list[GridPoint]:
    """A point, and what differs from it in one coordinate: all widenings, a few noises."""
    noises = [point.louder(k) for k in LOUDER]
    return [p for p in dict.fromkeys([point, *noises, *unknowns.all_widenings(point)]) if unknowns.holds(p)]
