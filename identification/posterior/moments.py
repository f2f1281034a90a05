"""Mean and covariance of everything in a state's model, linear: geometry, remainder, errors of form and members."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import State

Array = NDArray[np.float64]
Index = NDArray[np.intp]
ROUNDING = 1e-13
"""Share of the largest eigenvalue, of columns scaled to one length, below which nothing determines a direction."""


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
    tau = unknowns.size.values[state.point.remainder]
    own = np.flatnonzero(~design.always.remainder | (tau > 0.0))
    at = np.concatenate([own, design.n + columns]).astype(np.intp)
    factors = np.array([*unknowns.widening[state.point.widening], 1.0])
    sigma = design.always.sigma * np.where(design.always.remainder, tau, factors[design.always.part])
    gram, right = np.diag(np.concatenate([sigma[own], sizes]) ** -2.0), np.zeros(len(at))
    for part, scale in zip(design.grams, unknowns.scales(state.point), strict=True):
        gram += part[np.ix_(at, at)] / scale**2
        right += part[at, -1] / scale**2
    unit = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    covariance = unit[:, None] * np.linalg.pinv(
        gram * unit[:, None] * unit, rcond=ROUNDING, hermitian=True
    ) * unit  # fmt: skip
    return Moments(at, covariance @ right, covariance)


def typical(states: Sequence[tuple[State, float]], number: int) -> list[tuple[State, float]]:
    """``number`` of the states (each with its share), evenly along their cumulated shares; equal ones together."""
    ends = np.cumsum([share for _, share in states])
    picked = np.searchsorted(ends, ends[-1] * (np.arange(number) + 0.5) / number)
    which, counts = np.unique(np.minimum(picked, len(states) - 1), return_counts=True)
    return [(states[k][0], float(count) / number) for k, count in zip(which, counts, strict=True)]
