"""Every candidate by itself, against the model without effects."""

from __future__ import annotations

import numpy as np

from truepose.arrays import Array
from truepose.identification.diagnosis.selection_problem import SelectionProblem
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import best_point

EVERY = 4
"""Steps of the noise between the points at which candidates are weighed alone."""


def weighed_alone(problem: SelectionProblem, count: int) -> Array:
    """(count,) log Bayes factor of each candidate alone, noise and tolerances marginalised; minus infinity for others,
    and for those that the readings do not hold."""
    spike_slab = problem.spike_slab
    points = _points(spike_slab)
    null = np.array([spike_slab.root(p).log_evidence for p in points])
    terms = np.array([np.logaddexp.reduce(spike_slab.log_odds(p, ()), axis=0) for p in points])
    terms -= spike_slab.terms.log_first
    # at a size that nobody would notice it says neither for nor against
    unnoticed = np.where(spike_slab.noticeable, 0.0, np.exp(spike_slab.terms.log_sizes)).sum(axis=0)
    terms = np.logaddexp(terms, np.log(np.maximum(unnoticed, 1e-300)))
    total = np.logaddexp.reduce(terms + null[:, None], axis=0) - np.logaddexp.reduce(null)
    out = np.full(count, -np.inf)
    out[list(problem.candidates)] = np.where(spike_slab.ranks <= spike_slab.capacity, total, -np.inf)
    return out


def _points(spike_slab: SpikeSlab) -> list[GridPoint]:
    """Noises from the smallest to what nothing but noise would need, at stated tolerances and wider ones."""
    unknowns, top = spike_slab.unknowns, best_point(spike_slab).noise[0]
    widest = max(range(len(unknowns.widening)), key=lambda k: sum(unknowns.widening[k]))
    noises = sorted({*range(0, top + 1, EVERY), top})
    return [unknowns.all_at(k, widening) for k in noises for widening in {0, widest}]
