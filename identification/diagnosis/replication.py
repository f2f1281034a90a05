"""Whether the halves of a recording say the same of a name: what is physics is there in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from truepose.identification import prior
from truepose.identification.diagnosis.naming import Named
from truepose.identification.diagnosis.result import Replication
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import SelectionProblem, selection_problem
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.mode import nearest_top
from truepose.identification.posterior.spike_slab import Members
from truepose.identification.posterior.state import slot_odds

Array = NDArray[np.float64]
DIFFERENT = 1e-3
"""p of the difference between the halves' amplitudes below which they disagree."""


@dataclass(frozen=True)
class _Half:
    problem: SelectionProblem
    point: GridPoint
    mean: Array
    covariance: Array


def replications(found: Found, names: Sequence[Named], rms: float) -> tuple[Replication | None, ...]:
    """For each name; None where a half has fewer readings than the model has unknowns."""
    if not names:
        return ()
    fit, recording = found.fit, found.signatures.recording
    order = recording.order
    rows = order[fit.used[order]]
    halves = []
    for part in np.array_split(rows, 2):
        used = np.zeros(len(fit.used), dtype=bool)
        used[part] = True
        lin = found.signatures.linearise(replace(fit, used=used))
        if lin.n_observations <= lin.free + len(found.problem.spike_slab.columns(found.mode.members)[0]):
            return (None,) * len(names)
        halves.append(_half(selection_problem(lin, found.catalogue, rms), found))
    return tuple(_replicated(found, name, halves) for name in names)


def _half(problem: SelectionProblem, found: Found) -> _Half:
    """The likeliest point of a half with the mode's members, and their coefficients there."""
    members = _members(problem, found)
    start = problem.spike_slab.unknowns.nearest(found.mode.point)
    point = nearest_top(problem.spike_slab, start, members)
    mean, covariance = problem.spike_slab.root(point).posterior(*problem.spike_slab.columns(members))
    return _Half(problem, point, mean, covariance)


def _members(problem: SelectionProblem, found: Found) -> Members:
    """The mode's members in a half's numbers: the same candidates."""
    number = {own: k for k, own in enumerate(problem.candidates)}
    return tuple((number[found.problem.candidates[term]], size) for term, size in found.mode.members)


def _replicated(found: Found, name: Named, halves: Sequence[_Half]) -> Replication:
    said, parts = [], []
    for half in halves:
        members = _members(half.problem, found)
        terms = half.problem.spike_slab.terms
        own = [m for m in members if half.problem.candidates[m[0]] in name.candidates]
        rest = tuple(m for m in members if m not in own)
        conditional = half.problem.spike_slab.conditional(half.point, rest)
        shares = conditional.terms(slot_odds(prior.RICHNESS, len(rest)))
        causes = {int(terms.cause[term]) for term, _ in own}
        said.append(float(min(sum(shares[terms.cause == k].sum() for k in causes), 1.0)))
        columns = half.problem.spike_slab.columns(members)[0]
        wanted = [c for i in name.candidates for c in range(*_span(found, i))]
        at = [int(np.flatnonzero(columns == c)[0]) for c in wanted]
        parts.append((half.mean[at], half.covariance[np.ix_(at, at)]))
    (a, first), (b, second) = parts
    difference = a - b
    statistic = float(difference @ np.linalg.lstsq(first + second, difference, rcond=1e-10)[0])
    return Replication((said[0], said[1]), bool(chi2.sf(statistic, len(difference)) > DIFFERENT))


def _span(found: Found, index: int) -> tuple[int, int]:
    columns = found.linearisation.columns[index]
    return columns.start, columns.stop
