"""Every candidate weighed alone, and how wide tolerances would have to be for a name to fall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification import prior
from truepose.identification.diagnosis.naming import Named
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import SelectionProblem
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import best_point, slot_odds

Array = NDArray[np.float64]
EVERY = 4
"""Steps of the noise between the points at which candidates are weighed alone."""
NOTABLE = 3.0
"""Log Bayes factor of a candidate alone below which it is nothing to speak of."""
WIDENINGS = (1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0, 100.0)


def weighed_alone(problem: SelectionProblem, count: int) -> Array:
    """(count,) log Bayes factor of each candidate alone, noise and tolerances marginalised; minus infinity for others."""
    spike_slab = problem.spike_slab
    points = _points(spike_slab)
    null = np.array([spike_slab.root(p).log_evidence for p in points])
    terms = np.array([np.logaddexp.reduce(spike_slab.log_odds(p, ()), axis=0) for p in points])
    terms -= spike_slab.terms.log_first
    # at a size that nobody would notice it says neither for nor against
    unnoticed = np.where(spike_slab.noticeable, 0.0, np.exp(spike_slab.sizes.log_prior)[:, None]).sum(axis=0)
    terms = np.logaddexp(terms, np.log(np.maximum(unnoticed, 1e-300)))
    total = np.logaddexp.reduce(terms + null[:, None], axis=0) - np.logaddexp.reduce(null)
    out = np.full(count, -np.inf)
    for own, gain in zip(problem.candidates, total, strict=True):
        out[own] = gain
    return out


def _points(spike_slab: SpikeSlab) -> list[GridPoint]:
    """Noises from the smallest to what nothing but noise would need, at stated tolerances and wider ones."""
    unknowns, top = spike_slab.unknowns, best_point(spike_slab).noise[0]
    widest = max(range(len(unknowns.widening)), key=lambda k: sum(unknowns.widening[k]))
    noises = sorted({*range(0, top + 1, EVERY), top})
    return [unknowns.all_at(k, widening) for k in noises for widening in {0, widest}]


def flip_inflation(found: Found, one: Named) -> float | None:
    """How many times wider every tolerance would have to be for the name not to be needed; None when none would do."""
    problem, mode = found.problem, found.mode
    spike_slab = problem.spike_slab
    own = {t for t, _ in mode.members if problem.candidates[t] in one.candidates}
    unknowns = replace(
        spike_slab.unknowns,
        widening=tuple((w,) * len(problem.classes) for w in WIDENINGS),
        log_widening=(0.0,) * len(WIDENINGS),
    )
    members = [t for t, _ in mode.members]
    wanted = np.isin(np.arange(len(spike_slab.terms)), members)
    part, index = spike_slab.restricted(wanted)
    part = SpikeSlab(part.design, unknowns, part.terms, part.sizes)
    place = {int(t): k for k, t in enumerate(index)}
    every = [(place[t], s) for t, s in mode.members]
    rest = [(place[t], s) for t, s in mode.members if t not in own]
    odds = part.log_prior(every) - part.log_prior(rest)
    odds += sum(slot_odds(prior.RICHNESS, len(rest) + k) for k in range(len(every) - len(rest)))

    def needed(k: int) -> bool:
        point = mode.point._replace(widening=k)
        return part.log_evidence(point, every) - part.log_evidence(point, rest) + odds > 0.0

    if needed(len(WIDENINGS) - 1):
        return None
    return next(w for k, w in enumerate(WIDENINGS) if w == WIDENINGS[-1] or not needed(k))
