"""A state of the posterior: a set of terms with their sizes at a point of the grid; its posterior, and its coefficients.

The posterior mode by coordinate ascent, slot by slot and axis by axis, from a start.

Forward selection with a second look: a state gains the likeliest term while one is likelier than nothing, then every slot
is filled anew beside the others, until nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from truepose.arrays import Array, Index
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.marginal import ROUNDING, Marginal, log_gains_together, prior_sigma
from truepose.identification.posterior.spike_slab import Member, Members, SpikeSlab
from truepose.identification.prior import Richness

_STEPS = (2 ** np.arange(5)).tolist()
MANY, SAFE = 200, 1e4
"""Columns from which on Cholesky pays, and how far above rounding its smallest pivot has to be."""
LOUDER = (*(-step for step in _STEPS[::-1]), 0, *_STEPS)
"""Steps of the noise at which a state is looked at without some of its members."""


@dataclass(frozen=True)
class State:
    """A set of terms with their sizes at a point of the grid, and its log posterior up to a constant."""

    members: Members
    point: GridPoint
    log_posterior: float


def supports(spike_slab: SpikeSlab, state: State, parts: Sequence[Index]) -> list[float]:
    """Log Bayes factor of a state against it without some of its columns, noise adapting: for each of ``parts``.

    parts: places (k,) among the columns of all members. Without them the noise can only be larger.
    """
    part, columns, sizes = spike_slab.of_members(state.members)
    whole, without = -np.inf, np.full(len(parts), -np.inf)
    for step in LOUDER:
        point = state.point.louder(step)
        if not spike_slab.unknowns.holds(point):
            continue
        there = part.root(point).including(columns, sizes)
        whole = max(whole, there.log_evidence)
        left = [there.without(part).log_evidence for part in parts]
        without = np.maximum(without, left)
    return [float(whole - value) for value in without]


def slot_odds(richness: Richness, number: int) -> float:
    """Log prior odds of one more member beside ``number``, whichever slot it takes, richness marginalised."""
    free = richness.slots - number
    return richness.slot(number) + float(np.log(free)) if free > 0 else -np.inf


def log_posterior(spike_slab: SpikeSlab, richness: Richness, members: Members, point: GridPoint) -> float:
    """Of members beside what is given, up to a constant, richness and the order of slots marginalised."""
    number = sum(slot_odds(richness, k) for k in range(len(spike_slab.given) + len(members)))
    here = spike_slab.log_evidence(point, members) + spike_slab.log_bounds(point, members)
    return here + spike_slab.log_prior(members) + number


def best_point(spike_slab: SpikeSlab) -> GridPoint:
    """The likeliest noise without any term, at stated tolerances."""
    count = max(len(axis.values) for axis in spike_slab.unknowns.noise)
    points = (spike_slab.unknowns.all_at(k) for k in range(count))
    return max(points, key=lambda p: spike_slab.root(p).log_evidence)


@dataclass(frozen=True)
class Moments:
    """at (k,) columns of the design [A G]; mean (k,); covariance (k, k), zero along what nothing determines."""

    at: Index
    mean: Array
    covariance: Array


def moments(spike_slab: SpikeSlab, state: State) -> Moments:
    """Given the state's members, their sizes, and its noise and tolerances."""
    design, unknowns = spike_slab.design, spike_slab.unknowns
    columns, sizes = spike_slab.columns(state.members)
    sigma = prior_sigma(design, unknowns, state.point)
    at = np.concatenate([np.arange(design.n), design.n + columns]).astype(np.intp)
    gram, right = np.diag(np.concatenate([sigma, sizes]) ** -2.0), np.zeros(len(at))
    for part, scale in zip(design.grams, unknowns.scales(state.point), strict=True):
        gram += part[np.ix_(at, at)] / scale**2
        right += part[at, -1] / scale**2
    unit = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    covariance = unit[:, None] * _inverse(gram * unit[:, None] * unit) * unit
    return Moments(at, covariance @ right, covariance)


def _inverse(gram: Array) -> Array:
    """Of a matrix with a unit diagonal; many columns by Cholesky, a tenth of the time, where all of them are determined."""
    if len(gram) > MANY:
        factor, failed = dpotrf(gram, lower=1)
        if not failed and np.min(np.diag(factor)) ** 2 > SAFE * ROUNDING:
            inverse, _ = dpotri(factor, lower=1)
            return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T)
    return np.asarray(np.linalg.pinv(gram, rcond=ROUNDING, hermitian=True))


def typical(states: Sequence[tuple[State, float]], number: int) -> list[tuple[State, float]]:
    """``number`` of the states (each with its share), evenly along their cumulated shares; equal ones together."""
    ends = np.cumsum([share for _, share in states])
    picked = np.searchsorted(ends, ends[-1] * (np.arange(number) + 0.5) / number)
    which, counts = np.unique(np.minimum(picked, len(states) - 1), return_counts=True)
    return [(states[k][0], float(count) / number) for k, count in zip(which, counts, strict=True)]


ROUNDS = 30
"""Most rounds of an ascent: each adds one term at most."""
OFTEN = 1.25
"""How many times more terms a set has gained before its likeliest noise is looked for anew."""
CLIMBING = 5e9
"""Operations after which the ascents from some starts end wherever they are."""
STEPS = (4, 1)
"""Steps on an axis of the grid that are repeated while they gain, in turn."""

LIKELY, EXCHANGES = 20.0, 4
"""Log odds against a top up to which chains start from it, too; most exchanges of a group for another that are tried."""


def ascended(
    spike_slab: SpikeSlab,
    richness: Richness,
    point: GridPoint,
    members: Sequence[Member],
    limit: float = np.inf,
) -> State:
    """Return a state whose every slot holds the likeliest cause beside the others, or nothing, at the likeliest point near.

    Where so much work (``limit``) was done before, it is as far as the ascent came.
    """
    current = list(members)
    while not spike_slab.holds(current):
        current.pop()
    looked = -1
    for _ in range(ROUNDS):
        if spike_slab.work > limit:
            break
        before, here = set(current), point
        if not looked <= len(current) < OFTEN * looked:
            point, looked = nearest_top(spike_slab, point, current, thorough=False), len(current)
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


def alternatives(
    spike_slab: SpikeSlab, richness: Richness, state: State, limit: float = np.inf
) -> list[State]:
    """Return where ascents lead when all members of a group give way to the likeliest other group.

    The likeliest such exchanges are tried. Chains exchange one member for another by themselves.
    """
    groups = spike_slab.terms.group
    found = list[tuple[float, tuple[Member, ...]]]()
    for group in {int(groups[t]) for t, _ in state.members}:
        rest = [m for m in state.members if groups[m[0]] != group]
        before = log_posterior(spike_slab, richness, tuple(rest), state.point) - state.log_posterior
        others = [
            (before + gain, (*rest, *added))
            for gain, added in _groups(spike_slab, richness, state.point, rest)
            if groups[added[0][0]] != group and len(state.members) - len(rest) + len(added) > 2
        ]
        found += [max(others)] if others else []
    likeliest = sorted(found, reverse=True)[:EXCHANGES]
    return [ascended(spike_slab, richness, state.point, members, limit) for _, members in likeliest]


def _groups(
    spike_slab: SpikeSlab, richness: Richness, point: GridPoint, members: Sequence[Member]
) -> Iterator[tuple[float, tuple[Member, ...]]]:
    """All causes of a group, the likeliest term of each, at their likeliest common size: what acts faintly at all its places.

    Each with the log posterior that it gains.
    """
    terms = spike_slab.terms
    beside, before = spike_slab.beside(point, members), spike_slab.log_prior(members)
    odds = np.logaddexp.reduce(spike_slab.conditional(point, members).log_odds, axis=0)
    there = np.isin(terms.cause, terms.cause[[m for m, _ in members]])
    possible = np.isfinite(odds) & ~there
    for group in np.unique(terms.group[possible]):
        own = np.flatnonzero((terms.group == group) & possible)
        likeliest = {int(terms.cause[t]): int(t) for t in own[np.argsort(odds[own])]}.values()
        columns = np.concatenate([terms.columns[t] for t in likeliest])
        size = int(np.argmax(log_gains_together(beside, columns, spike_slab.sizes)))
        added = tuple((t, size) for t in likeliest if spike_slab.noticeable[size, t])
        if added:
            yield _growth(spike_slab, richness, beside, before, members, added), added


def _grown(
    spike_slab: SpikeSlab, richness: Richness, point: GridPoint, members: Sequence[Member]
) -> list[Member]:
    """With the likeliest term more, or with a whole group where that is likelier: what acts at all its places, faintly."""
    single, value = _likeliest(spike_slab, richness, point, members), 0.0
    if single:
        beside, before = spike_slab.beside(point, members), spike_slab.log_prior(members)
        value = _growth(spike_slab, richness, beside, before, members, single)
    gain, group = max(_groups(spike_slab, richness, point, members), default=(-np.inf, ()))
    return [*members, *(group if gain > value else single)]


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

    Not ``thorough``: one noise of all kinds, once.
    """
    unknowns, best, value = spike_slab.unknowns, point, spike_slab.log_evidence(point, members)
    kinds = len(point.noise) if thorough and len(point.noise) > 1 else 0  # the noise of each by itself, too
    lines: list[Line] = [GridPoint.louder, *(partial(_along_kind, kind) for kind in range(kinds))]
    while True:
        before = best
        for line in lines:
            best, value = _along(spike_slab, members, line, best, value)
        if thorough:
            best, value, _ = _better(spike_slab, members, unknowns.all_widenings(best), best, value)
        if best == before or not thorough:
            return best


Line = Callable[[GridPoint, int], GridPoint]


def _along(
    spike_slab: SpikeSlab, members: Sequence[Member], line: Line, best: GridPoint, value: float
) -> tuple[GridPoint, float]:
    """The best point of a line that longer and shorter steps reach, and its log evidence.

    Evidence has one top along the noise: where neither neighbour is better, longer steps are not tried.
    """

    def stepped(step: int) -> tuple[GridPoint, float, bool]:
        near = [p for p in (line(best, -step), line(best, step)) if spike_slab.unknowns.holds(p)]
        return _better(spike_slab, members, near, best, value)

    if not stepped(1)[2]:
        return best, value
    for step in STEPS:
        moved = True
        while moved:
            best, value, moved = stepped(step)
    return best, value


def _along_kind(kind: int, point: GridPoint, step: int) -> GridPoint:
    return point.with_noise(kind, point.noise[kind] + step)


def _better(
    spike_slab: SpikeSlab,
    members: Sequence[Member],
    points: Sequence[GridPoint],
    best: GridPoint,
    value: float,
) -> tuple[GridPoint, float, bool]:
    """The best of some points and the present one, its log evidence, and whether it is another one."""
    found = spike_slab.log_evidences(points, members)
    top, at = max(((value, k) for k, value in enumerate(found)), default=(-np.inf, 0))
    return (points[at], top, True) if top > value else (best, value, False)


def tops(spike_slab: SpikeSlab, richness: Richness, known: Sequence[State] = ()) -> list[State]:
    """Where ascents lead, from known states or else from nothing, and what is nearly as likely by exchanges of groups; the
    likeliest first."""
    starts = [(state.point, state.members) for state in known] or [(best_point(spike_slab), ())]
    limit = spike_slab.work + CLIMBING
    found = [ascended(spike_slab, richness, *start, limit) for start in starts]
    best = max(found, key=lambda state: state.log_posterior)
    found += alternatives(spike_slab, richness, best, limit)
    every = sorted({state.members: state for state in found}.values(), key=lambda state: -state.log_posterior)
    return [state for state in every if state.log_posterior > every[0].log_posterior - LIKELY]
