"""The posterior mode by coordinate ascent, slot by slot and axis by axis, from a start; and what is plausible around it.

Forward selection with a second look: a state gains the likeliest term while one is likelier than nothing, then every slot
is filled anew beside the others, until nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.posterior.conditional import log_gains_together
from truepose.identification.posterior.design import GridPoint, Unknowns
from truepose.identification.posterior.marginal import Marginal
from truepose.identification.posterior.sampler import Reach
from truepose.identification.posterior.spike_slab import Member, Members, SpikeSlab
from truepose.identification.prior import Richness

Array = NDArray[np.float64]
ROUNDS = 30
"""Most rounds of an ascent: each adds one term at most."""
STEPS = (4, 1)
"""Steps on an axis of the grid that are repeated while they gain, in turn."""
LOUDER = (-8, -4, -2, -1, 0, 1, 2, 4, 8, 14)
"""Steps of the noise at which a state is looked at without some of its members."""
HOPELESS, CERTAIN = 6.0, 20.0
"""Log odds below which a term is left out of the chains, and from which on a member is no question any more."""

LIKELY, EXCHANGES = 20.0, 4
"""Log odds against an exchange of a kind for another, as it is proposed, up to which an ascent is worth it; most of them."""


@dataclass(frozen=True)
class State:
    """A set of terms with their sizes at a point of the grid, and its log posterior up to a constant."""

    members: Members
    point: GridPoint
    log_posterior: float


def ascended(spike_slab: SpikeSlab, richness: Richness, point: GridPoint, members: Sequence[Member]) -> State:
    """A state whose every slot holds the likeliest cause beside the others, or nothing, at the likeliest point near."""
    current = list(members)
    for _ in range(ROUNDS):
        before, here = set(current), point
        point = nearest_top(spike_slab, point, current, thorough=False)
        grown = _grown(spike_slab, richness, point, current)
        if len(grown) > len(current):
            current = grown
            continue
        for member in sorted(current, key=lambda m: spike_slab.sizes.values[m[1]]):
            rest = [m for m in current if m != member]
            current = [*rest, *_likeliest(spike_slab, richness, point, rest, (member,))]
        point = nearest_top(spike_slab, point, current)
        if set(current) == before and point == here:
            break
    found = tuple(sorted(current))
    return State(found, point, log_posterior(spike_slab, richness, found, point))


def alternatives(spike_slab: SpikeSlab, richness: Richness, state: State) -> list[State]:
    """Where ascents lead when all members of a kind give way to a group of another kind: the likeliest such exchanges."""
    kinds = spike_slab.terms.kind
    found = list[tuple[float, tuple[Member, ...]]]()
    for kind in {int(kinds[t]) for t, _ in state.members}:
        rest = [m for m in state.members if kinds[m[0]] != kind]
        before = log_posterior(spike_slab, richness, tuple(rest), state.point) - state.log_posterior
        best = dict[int, tuple[float, tuple[Member, ...]]]()
        for gain, added in _groups(spike_slab, richness, state.point, rest):
            other = int(kinds[added[0][0]])
            if other != kind:
                best[other] = max(best.get(other, (-np.inf, ())), (before + gain, (*rest, *added)))
        found += best.values()
    likely = sorted((each for each in found if each[0] > -LIKELY), reverse=True)[:EXCHANGES]
    return [ascended(spike_slab, richness, state.point, members) for _, members in likely]


def _groups(
    spike_slab: SpikeSlab, richness: Richness, point: GridPoint, members: Sequence[Member]
) -> Iterator[tuple[float, tuple[Member, ...]]]:
    """All causes of a kind, the likeliest term of each, at their likeliest common size: what acts faintly at all its places.

    Each with the log posterior that it gains.
    """
    terms = spike_slab.terms
    beside, before = spike_slab.beside(point, members), spike_slab.log_prior(members)
    odds = np.logaddexp.reduce(spike_slab.conditional(point, members).log_odds, axis=0)
    there = np.isin(terms.cause, terms.cause[[m for m, _ in members]])
    for kind in np.unique(terms.kind):
        own = np.flatnonzero((terms.kind == kind) & np.isfinite(odds) & ~there)
        likeliest = {int(terms.cause[t]): int(t) for t in own[np.argsort(odds[own])]}.values()
        if len(likeliest) < 2:
            continue
        columns = np.concatenate([terms.columns[t] for t in likeliest])
        size = int(np.argmax(log_gains_together(beside, columns, spike_slab.sizes)))
        added = tuple((t, size) for t in likeliest if spike_slab.noticeable[size, t])
        if len(added) > 1:
            yield _growth(spike_slab, richness, beside, before, members, added), added


def _grown(
    spike_slab: SpikeSlab, richness: Richness, point: GridPoint, members: Sequence[Member]
) -> list[Member]:
    """With the likeliest term more, or with a whole group where that is likelier: what acts at all its places, faintly."""
    single = _likeliest(spike_slab, richness, point, members)
    best, value = [*members, *single], 0.0
    if single:
        beside, before = spike_slab.beside(point, members), spike_slab.log_prior(members)
        value = _growth(spike_slab, richness, beside, before, members, single)
    gain, group = max(_groups(spike_slab, richness, point, members), default=(-np.inf, ()))
    return [*members, *group] if gain > value else best


def _growth(
    spike_slab: SpikeSlab, richness: Richness, beside: Marginal, before: float, members: Sequence[Member],
    added: Sequence[Member],
) -> float:  # fmt: skip
    """Log posterior that members ``added`` gain together beside others, which a marginal has taken in."""
    slots = sum(slot_odds(richness, len(members) + k) for k in range(len(added)))
    prior = spike_slab.log_prior([*members, *added]) - before
    return beside.gain(*spike_slab.columns(added)) + prior + slots


def _likeliest(
    spike_slab: SpikeSlab, richness: Richness, point: GridPoint, rest: Sequence[Member], leaving: Members = ()
) -> list[Member]:
    """The likeliest term of the likeliest cause in a slot, at its likeliest size; none where nothing is likelier."""
    odds = spike_slab.conditional(point, rest, leaving).log_odds
    own = np.logaddexp.reduce(odds, axis=0)
    cause, top = spike_slab.terms.cause, float(own.max(initial=-np.inf))
    if not np.isfinite(top):
        return []  # nothing may stand beside the rest
    weight = np.bincount(cause, weights=np.exp(own - top))
    best = int(np.argmax(weight))
    if float(np.log(weight[best])) + top + slot_odds(richness, len(rest)) < 0.0:
        return []
    term = int(np.argmax(np.where(cause == best, own, -np.inf)))
    return [(term, int(np.argmax(odds[:, term])))]


def nearest_top(
    spike_slab: SpikeSlab, point: GridPoint, members: Sequence[Member], *, thorough: bool = True
) -> GridPoint:
    """The likeliest point of the grid near one, coordinate by coordinate until none gains.

    Not ``thorough``: one noise of all kinds and the remainder, once.
    """
    unknowns, best, value = spike_slab.unknowns, point, spike_slab.log_evidence(point, members)
    lines = (*_LINES, *_lines_of_kinds(len(point.noise))) if thorough and len(point.noise) > 1 else _LINES
    while True:
        before = best
        for line in lines:
            for step in STEPS:
                moved = True
                while moved:
                    near = [p for p in (line(best, -step), line(best, step)) if unknowns.holds(p)]
                    best, value, moved = _better(spike_slab, members, near, best, value)
        if thorough:
            best, value, _ = _better(spike_slab, members, _along(unknowns, best, "widening"), best, value)
        if best == before or not thorough:
            return best


Line = Callable[[GridPoint, int], GridPoint]
_LINES: tuple[Line, ...] = (
    lambda point, step: point.louder(step),
    lambda point, step: point._replace(remainder=point.remainder + step),
)


def _lines_of_kinds(count: int) -> list[Line]:
    """The noise of each kind of channel by itself."""

    def of(kind: int) -> Line:
        return lambda point, step: point.with_noise(kind, point.noise[kind] + step)

    return [of(kind) for kind in range(count)]


def _better(
    spike_slab: SpikeSlab,
    members: Sequence[Member],
    points: Sequence[GridPoint],
    best: GridPoint,
    value: float,
) -> tuple[GridPoint, float, bool]:
    """The best of some points and the present one, its log evidence, and whether it is another one."""
    found = [(spike_slab.log_evidence(p, members), k) for k, p in enumerate(points)]
    top, at = max(found, default=(-np.inf, 0))
    return (points[at], top, True) if top > value else (best, value, False)


@dataclass(frozen=True)
class Plausible:
    """What chains draw from: ``terms`` (c,) that are not hopeless in some slot, and such values of the grid; ``certain``:
    members that nothing can replace."""

    terms: NDArray[np.bool_]
    reach: Reach
    certain: Members


def plausible(spike_slab: SpikeSlab, richness: Richness, states: Sequence[State]) -> Plausible:
    """Around states, whose log posterior is the measure: what each slot may hold, and one more, here and where the grid may be.

    The rival of a term is another term, or a departure of the grid from what is stated.
    """
    interest = np.full(len(spike_slab.terms), -np.inf)
    reach: dict[str, set[int]] = {axis: set() for axis in Reach._fields}
    certain = set.intersection(*(set(state.members) for state in states))
    for state in states:
        table = _without_each(spike_slab, richness, state)
        alive = {p for row in table.values() for p, log in row.items() if log > -CERTAIN}
        for leaving, row in table.items():
            rest = [m for m in state.members if m not in leaving]
            for point in _stated(state.point, row) if not leaving else _likely(state.point, row):
                odds = np.logaddexp.reduce(spike_slab.log_odds(point, rest, leaving), axis=0)
                odds += row[point] + slot_odds(richness, len(rest))
                np.maximum(interest, odds, out=interest)
                alive |= {point} if odds.max(initial=-np.inf) > -CERTAIN else set()
                others = np.logaddexp.reduce(np.delete(odds, [m[0] for m in leaving]), initial=row[point])
                certain -= set(leaving) if others > -CERTAIN else set()
        interest[[term for term, _ in state.members]] = np.inf
        for axis, values in reach.items():
            values |= {getattr(p, axis) for p in alive}
    axes = Reach(*(tuple(sorted(values)) for values in reach.values()))
    return Plausible(interest > -HOPELESS, axes, tuple(sorted(certain)))


def _stated(point: GridPoint, row: Mapping[GridPoint, float]) -> set[GridPoint]:
    """A point, quieter ones, and stated tolerances without a remainder: where a term may stand that the grid stands in for."""
    quieter = {
        p for p in row if p == point.louder(p.noise[0] - point.noise[0]) and p.noise[0] < point.noise[0]
    }
    return {point, *quieter} | {p for p in row if p in (point.at("widening", 0), point.at("remainder", 0))}


def _likely(point: GridPoint, row: Mapping[GridPoint, float]) -> set[GridPoint]:
    """A point, and where the grid is likeliest."""
    return {point, point.at("remainder", 0), max(row, key=lambda p: row[p])}


def _without_each(
    spike_slab: SpikeSlab, richness: Richness, state: State
) -> dict[Members, dict[GridPoint, float]]:
    """Log posterior of a state as it is, and without each of its members, less its own, at points around.

    By what leaves; the points differ from the state's in one coordinate.
    """
    wanted = np.isin(np.arange(len(spike_slab.terms)), [term for term, _ in state.members])
    part, index = spike_slab.restricted(wanted)
    number = {int(term): k for k, term in enumerate(index)}
    columns, sizes = part.columns([(number[term], size) for term, size in state.members])
    owner = np.repeat(
        np.arange(len(state.members)), [len(spike_slab.terms.columns[t]) for t, _ in state.members]
    )
    own = spike_slab.log_evidence(state.point, state.members)
    out: dict[Members, dict[GridPoint, float]] = {(): {}, **{(m,): {} for m in state.members}}
    prior = {
        (m,): spike_slab.log_prior([k for k in state.members if k != m]) - spike_slab.log_prior(state.members)
        for m in state.members
    }
    for point in _around(spike_slab.unknowns, state.point):
        there = part.root(point).including(columns, sizes)
        out[()][point] = there.log_evidence - own
        for k, member in enumerate(state.members):
            gone = there.without(np.flatnonzero(owner == k)).log_evidence - own
            out[member,][point] = gone + prior[member,] - slot_odds(richness, len(state.members) - 1)
    return out


def _around(unknowns: Unknowns, point: GridPoint) -> list[GridPoint]:
    """A point, and what differs from it in one coordinate: all widenings and remainders, a few noises."""
    noises = [point.louder(k) for k in LOUDER]
    others = [p for axis in Reach._fields for p in _along(unknowns, point, axis)]
    return [p for p in dict.fromkeys([point, *noises, *others]) if unknowns.holds(p)]


def _along(unknowns: Unknowns, point: GridPoint, axis: str) -> list[GridPoint]:
    """All points that differ in ``widening`` or ``remainder`` alone."""
    count = len(unknowns.widening if axis == "widening" else unknowns.size.values)
    return [point.at(axis, k) for k in range(count)]


def supports(spike_slab: SpikeSlab, state: State, parts: Sequence[NDArray[np.intp]]) -> list[float]:
    """Log Bayes factor of a state against it without some of its columns, noise adapting: for each of ``parts``.

    parts: places (k,) among the columns of all members. Without them the noise can only be larger.
    """
    columns, sizes = spike_slab.columns(state.members)
    whole, without = -np.inf, np.full(len(parts), -np.inf)
    for step in LOUDER:
        point = state.point.louder(step)
        if not spike_slab.unknowns.holds(point):
            continue
        there = spike_slab.root(point).including(columns, sizes)
        whole = max(whole, there.log_evidence)
        left = [there.without(part).log_evidence for part in parts]
        without = np.maximum(without, left)
    return [float(whole - value) for value in without]


def slot_odds(richness: Richness, number: int) -> float:
    """Log prior odds of one more member beside ``number``, whichever slot it takes, richness marginalised."""
    free = richness.slots - number
    return richness.slot(number) + float(np.log(free)) if free > 0 else -np.inf


def log_posterior(spike_slab: SpikeSlab, richness: Richness, members: Members, point: GridPoint) -> float:
    """Up to a constant, richness and the order of slots marginalised."""
    number = sum(slot_odds(richness, k) for k in range(len(members)))
    here = spike_slab.log_evidence(point, members) + spike_slab.log_bounds(point, members)
    return here + spike_slab.log_prior(members) + number


def best_point(spike_slab: SpikeSlab) -> GridPoint:
    """The likeliest noise without any term, at stated tolerances and without a remainder."""
    count = max(len(axis.values) for axis in spike_slab.unknowns.noise)
    return max(
        (spike_slab.unknowns.all_at(k) for k in range(count)), key=lambda p: spike_slab.root(p).log_evidence
    )
