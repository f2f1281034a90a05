"""Evidence of sets of terms, and what a further slot may hold: remembered, for a chain comes back to the same sets.

Work that evidences took, counted in operations: a search that ends by it does the same steps on every processor.

What was worked out and may be asked for again, within a limit of memory.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from scipy.linalg import block_diag

from truepose.arrays import Array, Index, Mask
from truepose.identification.posterior.design import Design, GridPoint, Term, Terms, Unknowns
from truepose.identification.posterior.halves import map_large
from truepose.identification.posterior.marginal import Marginal, log_gains, marginal, nbytes, plausibility
from truepose.identification.prior import LONG, Sizes

CALL, DENSE, SMALL = 1e5, 0.04, 3.0
"""What counts for one: a call with what is around it, a multiplication among large matrices, one among many small ones.
In nanoseconds of a processor of 2023, about."""


def cost_of_taking(columns: int, width: int) -> float:
    """Return what it takes to take in some columns beside ``width`` others."""
    return CALL + DENSE * columns**2 * (columns / 3.0 + width)


REMEMBERED = 80_000_000
"""Bytes of values that take much memory which are kept."""
Value = TypeVar("Value")


class Memory(Generic[Value]):
    """The latest so many values, and of those that take much memory no more than fit into ``REMEMBERED``."""

    def __init__(self, limit: int, size: Callable[[Value], int] | None = None) -> None:
        self._limit, self._values, self._size = max(limit, 4), OrderedDict[Hashable, Value](), size
        self._sizes, self._total = dict[Hashable, int](), 0

    def clear(self) -> None:
        """Forget all."""
        self._values.clear()
        self._sizes.clear()
        self._total = 0

    def get_or(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """The value of a key, made where it is not there."""
        return self.get_all([key], lambda _: [make()])[0]

    def get_all(
        self, keys: Sequence[Hashable], make: Callable[[Sequence[int]], Sequence[Value]]
    ) -> list[Value]:
        """The values of keys; those that are not there, by their places, are made at once."""
        new = [k for k, key in enumerate(keys) if key not in self._values]
        made = dict(zip(new, make(new), strict=True)) if new else {}
        found = [made[k] if k in made else self._values[key] for k, key in enumerate(keys)]
        for key, value in zip(keys, found, strict=True):
            self._values[key] = value
            self._values.move_to_end(key)
            if self._size is not None:  # values grow while they are used
                size = self._size(value)
                self._total += size - self._sizes.get(key, 0)
                self._sizes[key] = size
        while len(self._values) > max(self._limit, len(keys)) or (
            self._total > REMEMBERED
            and len(self._values) > len(keys)  # what was asked for stays, however large
        ):
            key, _ = self._values.popitem(last=False)
            self._total -= self._sizes.pop(key, 0)
        return found


Member = tuple[int, int]
"""A term and the index of its size."""
Members = tuple[Member, ...]
MARGINALS = 200
"""Most marginals of each sort that are kept."""
NOTICED = 4.0
"""Squared signal, in units of the noise, below which an effect of some size is nothing to speak of."""
UNSEEN = 1e-3
"""Information about the largest usual size that is none."""
FEWER = 0.9
"""Share of the columns that turned terms must not exceed, for a problem of these to be worth its memory."""
HELD = 2
"""Readings that each coefficient of a set needs at least, as far as they see it, and that each one of a long series needs: the
readings of a row see one place of it."""
LONG_SET = 150
"""Columns of a set beyond which all that follows takes long."""
SETS = 200_000
"""Evidences that are kept."""


class Conditional:
    """What a slot may hold beside other members: log odds (s, c) of each term at each size, before those of the slot.

    log_evidence: of the other members.
    """

    def __init__(self, log_odds: Array, log_evidence: float) -> None:
        self.log_odds, self.log_evidence = log_odds, log_evidence
        top = float(np.max(log_odds, initial=-1e300))
        weight = np.exp(log_odds - top)
        total = max(float(weight.sum()), 1e-300)  # no term may be wanted at all
        self._log_sum, self._sums = top + float(np.log(total)), np.cumsum(weight / total)
        self._shares = weight.sum(axis=0) / total

    def log_total(self, slot: float) -> float:
        """Log of the sum of the odds of everything, nothing (1) included."""
        return float(np.logaddexp(0.0, self._log_sum + slot))

    def terms(self, slot: float) -> Array:
        """(c,) probability of each term."""
        return np.asarray(self._shares * np.exp(self._log_sum + slot - self.log_total(slot)))

    def draw(self, slot: float, rng: np.random.Generator) -> Member | None:
        """A member, or nothing."""
        if np.log(rng.random()) > self._log_sum + slot - self.log_total(slot):
            return None
        at = min(int(np.searchsorted(self._sums, rng.random())), len(self._sums) - 1)
        size, term = divmod(at, self.log_odds.shape[1])
        return int(term), int(size)


class SpikeSlab:
    """One design with its terms, sizes and grid of unknowns; ``given``: members that are there for sure."""

    def __init__(
        self, design: Design, unknowns: Unknowns, terms: Terms, sizes: Sizes, given: Sequence[Member] = ()
    ) -> None:
        self.design, self.unknowns, self.terms, self.sizes = design, unknowns, terms, sizes
        self.given = tuple(sorted(given))
        self._open, self._left = (
            terms.beside([t for t, _ in self.given]) if given else (terms, np.arange(design.width))
        )
        self._roots = Memory[Marginal](MARGINALS, nbytes)
        self._bases = Memory[Marginal](MARGINALS, nbytes)
        self._taken, self._priors = Memory[Marginal](8, nbytes), Memory[Array](32)
        self._conditionals = Memory[Conditional](REMEMBERED // (16 * (len(terms) + 1) * len(sizes.values)))
        self._evidences = Memory[float](SETS)
        self.work = 0.0

    def restricted(self, wanted: Mask) -> tuple[SpikeSlab, Index]:
        """The problem with the terms wanted (c,) only, and their numbers in this one."""
        index = np.flatnonzero(wanted)
        own = [self.terms.columns[k] for k in index]
        columns = np.unique(np.concatenate([*own, np.zeros(0, dtype=np.intp)])).astype(np.intp)
        place = np.zeros(self.design.width, dtype=np.intp)
        place[columns] = np.arange(len(columns))
        terms = self.terms.restricted(index.tolist(), place)
        return SpikeSlab(self.design.restricted(columns), self.unknowns, terms, self.sizes), index

    def of_members(self, members: Sequence[Member]) -> tuple[SpikeSlab, Index, Array]:
        """The problem with these members' terms only, and the members' columns and sizes there, in their order."""
        wanted = np.isin(np.arange(len(self.terms)), [term for term, _ in members])
        part, index = self.restricted(wanted)
        number = {int(term): k for k, term in enumerate(index)}
        return part, *part.columns([(number[term], size) for term, size in members])

    def compressed(self) -> SpikeSlab:
        """The same problem, its wide terms turned to the directions that readings see, which are often few; terms keep their
        numbers."""
        root, turns, terms, at = self.root(self._stated), list[Array](), list[Term](), 0
        for term in self.terms.all:
            columns = np.array(term.columns, dtype=np.intp)
            turn = np.eye(len(columns))
            if len(columns) > LONG and not np.any(np.isfinite([term.lower, term.upper])):
                values, vectors = np.linalg.eigh(root.among(columns))
                turn = vectors[:, -max(int(np.sum(values > UNSEEN)), 1) :]
            width = turn.shape[1]
            own = tuple(range(at, at + width))
            terms.append(replace(term, columns=own, lower=term.lower[:width], upper=term.upper[:width]))
            turns.append(turn)
            at += width
        if at > FEWER * self.design.width:
            return self  # hardly any fewer
        columns = np.concatenate([*self.terms.columns, np.zeros(0, dtype=np.intp)]).astype(np.intp)
        design = self.design.turned(columns, block_diag(*turns))
        return SpikeSlab(design, self.unknowns, Terms(terms, self.terms.urn), self.sizes)

    def conditioned(self, given: Sequence[Member]) -> SpikeSlab:
        """The same problem with members that are no question any more: they are taken in once at every point."""
        other = SpikeSlab(self.design, self.unknowns, self.terms, self.sizes, given)
        other.__dict__["noticeable"] = self.noticeable
        return other

    def forget(self) -> None:
        """Let go of what was worked out: it takes much memory, and only chains come back to it all."""
        for memory in (self._roots, self._bases, self._taken, self._priors, self._conditionals):
            memory.clear()

    def root(self, point: GridPoint) -> Marginal:
        """Without any term, at a point."""

        def made() -> Marginal:
            self.work += cost_of_taking(self.design.n, self.design.width)
            return marginal(self.design, self.unknowns, self.terms, point)

        return self._roots.get_or(point, made)

    @cached_property
    def _stated(self) -> GridPoint:
        """The noise as it is stated."""
        noise = tuple(int(np.argmin(np.abs(np.log(axis.values)))) for axis in self.unknowns.noise)
        return GridPoint(noise, 0)

    @cached_property
    def noticeable(self) -> Mask:
        """(s, c) which terms would be noticed at which size, at the stated noise; what nobody would notice is nothing."""
        root = self.root(self._stated)
        information = np.zeros(len(self.terms))
        for group, block in zip(self.terms.by_size, root.blocks, strict=True):
            information[group.terms] = np.trace(block, axis1=1, axis2=2)
        return np.asarray(self.sizes.values[:, None] ** 2 * information > NOTICED)

    @cached_property
    def capacity(self) -> int:
        """Most coefficients of a set that the readings hold."""
        return sum(self.design.counts) // HELD

    @cached_property
    def ranks(self) -> Index:
        """(c,) number of coefficients of each term that the readings see, at the stated noise; of a series that is too long for
        them, more than they hold."""
        root, out = self.root(self._stated), np.array([len(c) for c in self.terms.columns], dtype=np.intp)
        if self.design.width > self.capacity:
            for k in np.flatnonzero((out > LONG) & ~self.terms.bounded):
                values = np.linalg.eigvalsh(root.among(self.terms.columns[k]))
                out[k] = max(int(np.sum(values > UNSEEN)), 1)
        length = np.array([term.length for term in self.terms.all], dtype=np.intp)
        return np.where(HELD * length > sum(self.design.counts), self.capacity + 1, out)

    def holds(self, members: Sequence[Member]) -> bool:
        """Return True if the readings hold the coefficients of all members together."""
        return int(sum(self.ranks[term] for term, _ in members)) <= self.capacity

    def is_long(self, members: Sequence[Member]) -> bool:
        """Return True if the members have so many columns that all that follows takes long."""
        return sum(len(self.terms.columns[term]) for term, _ in members) > LONG_SET

    def base(self, point: GridPoint) -> Marginal:
        """With what is given, at a point."""
        if not self.given:
            return self.root(point)
        own = self.columns(self.given)

        def made() -> Marginal:
            self.work += cost_of_taking(len(own[0]), self.design.width)
            return self.root(point).beside(*own, self._left, self._open)

        return self._bases.get_or(point, made)

    def columns(self, members: Sequence[Member], terms: Terms | None = None) -> tuple[Index, Array]:
        """Columns (k,) of all members, and the size of each (k,)."""
        if not members:
            return np.zeros(0, dtype=np.intp), np.zeros(0)
        own = [(terms or self.terms).columns[term] for term, _ in members]
        sizes = [np.full(len(c), self.sizes.values[s]) for c, (_, s) in zip(own, members, strict=True)]
        return np.concatenate(own), np.concatenate(sizes)

    def beside(self, point: GridPoint, members: Sequence[Member], leaving: Members = ()) -> Marginal:
        """With members taken in. ``leaving`` were there a moment ago: as long as each leaves a set in turn, that is cheap."""
        base, others = self.base(point), sorted((*members, *leaving))
        own, width = self.columns(others, self._open), len(self._left)

        def made() -> Marginal:
            self.work += cost_of_taking(len(own[0]), width)
            return base.including(*own)

        whole = self._taken.get_or((point, tuple(others)), made)
        if not leaving:
            return whole
        widths = [len(self.terms.columns[term]) for term, _ in others]
        gone = np.flatnonzero(np.repeat([m in leaving for m in others], widths))
        self.work += CALL + DENSE * len(gone) * len(own[0]) * (len(gone) + width)
        return whole.without(gone)

    def log_odds(self, point: GridPoint, members: Sequence[Member], leaving: Members = ()) -> Array:
        """(s, c) log odds of each further term at each size beside the members, prior included; a slot's odds are not."""
        return self.conditional(point, members, leaving).log_odds

    def conditional(self, point: GridPoint, members: Sequence[Member], leaving: Members = ()) -> Conditional:
        """What a further slot may hold beside the members; ``leaving`` as in ``beside``."""
        return self.conditionals([point], members, leaving, point)[0]

    def conditionals(
        self, points: Sequence[GridPoint], members: Sequence[Member], leaving: Members, here: GridPoint
    ) -> list[Conditional]:
        """The same at several points, worked out at once; ``leaving`` were there at one of them, ``here``."""
        rest = tuple(sorted(members))

        def priors() -> Array:  # what would not be noticed is nothing, nor what the readings do not hold
            every = (*self.given, *rest)
            room = self.capacity - sum(self.ranks[term] for term, _ in every)
            return np.where(self.noticeable & (self.ranks <= room), self.terms.log_prior(every), -np.inf)

        def made(new: Sequence[int]) -> list[Conditional]:
            prior = self._priors.get_or(rest, priors)
            there = [self.beside(points[k], rest, leaving if points[k] == here else ()) for k in new]
            groups = [group for group in self._open.by_size if np.isfinite(prior[:, group.terms]).any()]
            odds = log_gains(there, self.sizes, groups) + prior
            shapes, s = [group.columns.shape for group in groups], len(self.sizes.values)
            cost = float(sum(CALL + count * k**2 * s * (SMALL + DENSE * k) for count, k in shapes))
            for _ in new:
                self.work += cost
            return [Conditional(o, m.log_evidence) for o, m in zip(odds, there, strict=True)]

        return self._conditionals.get_all([(p, rest) for p in points], made)

    def log_evidence(self, point: GridPoint, members: Sequence[Member]) -> float:
        """Log evidence of a point with its members, and the point's log prior, up to a constant."""
        return self.log_evidences([point], members)[0]

    def log_evidences(self, points: Sequence[GridPoint], members: Sequence[Member]) -> list[float]:
        """The same of several points."""
        own = self.columns(members, self._open)
        width = len(own[0])

        def made(new: Sequence[int]) -> list[float]:
            bases = [self.base(points[k]) for k in new]
            for _ in new:
                self.work += cost_of_taking(width, width)
            if not members:
                return [base.log_evidence for base in bases]
            gains = map_large(lambda base: base.gain(*own), bases, width**2 * (width / 3.0 + self.design.n))
            return [base.log_evidence + gain for base, gain in zip(bases, gains, strict=True)]

        rest = tuple(sorted(members))
        return self._evidences.get_all([(point, rest) for point in points], made)

    def log_bounds(self, point: GridPoint, members: Sequence[Member]) -> float:
        """Log factor of the physical signs and bounds of members (and of what is given) together, at a point; 0 where none
        has any."""
        free = [m for m in members if not self.terms.bounded[m[0]]]
        held = [m for m in (*self.given, *members) if self.terms.bounded[m[0]]]
        if not held:
            return 0.0
        given = any(self.terms.bounded[term] for term, _ in self.given)
        others = (*(m for m in self.given if m not in held), *free) if given else free
        beside, terms = (self.root(point), None) if given else (self.base(point), self._open)
        columns, sizes = self.columns([*others, *held], terms)
        bounds = [self.terms.all[term] for term, _ in held]
        lower = np.concatenate([np.array(t.lower) for t in bounds])
        upper = np.concatenate([np.array(t.upper) for t in bounds])
        mean, std = beside.last(columns, sizes, len(lower))
        return float(plausibility(mean[None, None], std[None, None], lower[None], upper[None])[0, 0])

    def log_prior(self, members: Sequence[Member]) -> float:
        """Log prior of members and their sizes beside what is given, without that of their number."""
        every = (*self.given, *members)
        noticed = all(self.noticeable[size, term] for term, size in members)
        return self.terms.log_prior_of(every) if noticed and self.holds(every) else -np.inf
