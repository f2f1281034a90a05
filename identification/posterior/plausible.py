"""What chains draw from: terms and values of the grid that are not hopeless around a few states, and what is certain there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Mask
from truepose.identification.posterior.design import GridPoint, Unknowns
from truepose.identification.posterior.large import map_large
from truepose.identification.posterior.marginal import Marginal
from truepose.identification.posterior.sampler import Reach
from truepose.identification.posterior.spike_slab import Members, SpikeSlab
from truepose.identification.posterior.state import LOUDER, State, slot_odds
from truepose.identification.prior import Richness

HOPELESS, CERTAIN = 6.0, 20.0
"""Log odds below which a term is left out of the chains, and from which on a member is no question any more."""


@dataclass(frozen=True)
class Plausible:
    """What chains draw from: ``terms`` (c,) that are not hopeless in some slot, and such values of the grid; ``certain``:
    members that nothing can replace."""

    terms: Mask
    reach: Reach
    certain: Members


def plausible(spike_slab: SpikeSlab, richness: Richness, states: Sequence[State]) -> Plausible:
    """Around states, whose log posterior is the measure: what each slot may hold, and one more, here and where the grid may be.

    The rival of a term is another term, or a departure of the grid from what is stated.
    """
    long = spike_slab.is_long(states[0].members)
    interest = np.full(len(spike_slab.terms), -np.inf)
    reach: dict[str, set[int]] = {axis: set() for axis in Reach._fields}
    certain = set.intersection(*(set(state.members) for state in states))
    for state in states:
        table = _without_each(spike_slab, richness, state)
        alive = {p for row in table.values() for p, log in row.items() if log > -CERTAIN}
        for leaving, row in table.items():
            rest = [m for m in state.members if m not in leaving]
            for point in _stated(state.point, row) if not leaving else _likely(state.point, row, long):
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


def _likely(point: GridPoint, row: Mapping[GridPoint, float], long: bool) -> set[GridPoint]:
    """A point, where the grid is likeliest, and without a remainder; of a ``long`` set, which takes long, only where it is."""
    return {point} if long else {point, point.at("remainder", 0), max(row, key=lambda p: row[p])}


def _without_each(
    spike_slab: SpikeSlab, richness: Richness, state: State
) -> dict[Members, dict[GridPoint, float]]:
    """Log posterior of a state as it is, and without each of its members, less its own, at points around.

    By what leaves; the points differ from the state's in one coordinate.
    """
    part, columns, sizes = spike_slab.of_members(state.members)
    owner = np.repeat(
        np.arange(len(state.members)), [len(spike_slab.terms.columns[t]) for t, _ in state.members]
    )
    own = spike_slab.log_evidence(state.point, state.members)
    out: dict[Members, dict[GridPoint, float]] = {(): {}, **{(m,): {} for m in state.members}}
    prior = {
        (m,): spike_slab.log_prior([k for k in state.members if k != m]) - spike_slab.log_prior(state.members)
        for m in state.members
    }
    points = _around(spike_slab.unknowns, state.point)
    roots, width = [part.root(point) for point in points], len(columns)

    def weighed(root: Marginal) -> tuple[float, list[float]]:
        there = root.including(columns, sizes)
        each = (there.without(np.flatnonzero(owner == k)) for k in range(len(state.members)))
        return there.log_evidence - own, [without.log_evidence - own for without in each]

    every = map_large(weighed, roots, width**2 * (2.0 * width + part.design.n))
    for point, (whole, gone) in zip(points, every, strict=True):
        out[()][point] = whole
        for member, value in zip(state.members, gone, strict=True):
            out[member,][point] = value + prior[member,] - slot_odds(richness, len(state.members) - 1)
    return out


def _around(unknowns: Unknowns, point: GridPoint) -> list[GridPoint]:
    """A point, and what differs from it in one coordinate: all widenings and remainders, a few noises."""
    noises = [point.louder(k) for k in LOUDER]
    others = [p for axis in Reach._fields for p in unknowns.along(point, axis)]
    return [p for p in dict.fromkeys([point, *noises, *others]) if unknowns.holds(p)]
