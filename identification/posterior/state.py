"""A state of the posterior: a set of terms with their sizes at a point of the grid; its posterior, and its coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from truepose.arrays import Array, Index
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.marginal import ROUNDING, prior_sigma
from truepose.identification.posterior.spike_slab import Members, SpikeSlab
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
    """The likeliest noise without any term, at stated tolerances and without a remainder."""
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
    """Given the state's members, their sizes, and its noise, tolerances and remainder."""
    design, unknowns = spike_slab.design, spike_slab.unknowns
    columns, sizes = spike_slab.columns(state.members)
    sigma, there = prior_sigma(design, unknowns, state.point)
    own = np.flatnonzero(there)
    at = np.concatenate([own, design.n + columns]).astype(np.intp)
    gram, right = np.diag(np.concatenate([sigma[own], sizes]) ** -2.0), np.zeros(len(at))
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
