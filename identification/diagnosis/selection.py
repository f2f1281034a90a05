"""Which effects the data ask for: forward selection with backward deletion and swaps, then the nonlinear refit.

All steps between two refits are linear algebra on one Gram matrix; a refit moves the expansion point, and
the search ends when a refit asks for nothing new.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.evidence import Evidence, Grid, evidence, grid_for, log_positive
from truepose.identification.diagnosis.signatures import Linearisation, Signatures
from truepose.identification.estimate import Estimate, estimate
from truepose.identification.recording import Recording
from truepose.models.machine import Machine

Array = NDArray[np.float64]
THRESHOLD = 3.0
"""Log posterior odds a term must bring to be added, and keep to stay."""
MAX_TERMS = 80
MAX_REFITS = 8


@dataclass(frozen=True)
class Ranking:
    """Candidates weighed against the same accepted terms: log posterior odds and parts of it, per candidate."""

    indices: tuple[int, ...]
    odds: Array
    gain: Array
    evidence: Evidence


@dataclass(frozen=True)
class Selection:
    """Accepted candidates (indices into the catalogue), the fit with them, and its linearisation."""

    accepted: tuple[int, ...]
    fit: Estimate
    linearisation: Linearisation
    grid: Grid


def rank(lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Sequence[int], wanted: Sequence[int]) -> Ranking:
    """Log posterior odds of each wanted candidate given the accepted ones."""
    result = evidence(lin, wanted, grid, accepted)
    gain = result.gain.copy()
    for j, i in enumerate(wanted):
        gain[j] += physical(cat, i, result.amplitude[j], result.spread[j])
    odds = gain + np.array([cat.log_prior[i] for i in wanted]) if len(wanted) else gain
    return Ranking(tuple(wanted), odds, gain, result)


def physical(cat: Catalogue, index: int, amplitude: Array, spread: Array) -> float:
    """Log factor of physical signs and bounds of a candidate's coefficients."""
    total = 0.0
    for c, mean, std in zip(cat.candidates[index].coefficients, amplitude, spread, strict=True):
        if np.isfinite(c.lower):
            total += log_positive(float(mean - c.lower / c.scale), float(std)) if c.lower == 0.0 else 0.0
        if np.isfinite(c.upper) and mean - 3.0 * std > c.upper / c.scale:
            total -= 50.0
    return total


def select(
    machine: Machine, recording: Recording, cat: Catalogue, null: Estimate, exclude: NDArray[np.bool_], rms: float
) -> Selection:
    """Search from the null fit. ``rms`` of the whitened free fit bounds the noise scale."""
    signatures = Signatures(machine, recording, cat.candidates)
    accepted: list[int] = []
    banned: set[int] = set()
    fit = null
    lin = signatures.linearise(fit)
    grid = grid_for(lin, rms)
    for _ in range(MAX_REFITS):
        before = set(accepted)
        accepted = _search(lin, cat, grid, accepted, banned)
        if set(accepted) == before:
            break
        fit, accepted = _refit(machine, recording, cat, accepted, fit, exclude, banned)
        lin = signatures.linearise(fit)
    return Selection(tuple(accepted), fit, lin, grid)


def _search(lin: Linearisation, cat: Catalogue, grid: Grid, accepted: list[int], banned: set[int]) -> list[int]:
    """Add, swap and drop terms until nothing changes."""
    accepted = list(accepted)
    seen: set[frozenset[int]] = set()
    while len(accepted) < MAX_TERMS and frozenset(accepted) not in seen:
        seen.add(frozenset(accepted))
        others = [i for i in range(len(cat.candidates)) if i not in accepted and i not in banned]
        if not others:
            break
        ranking = rank(lin, cat, grid, accepted, others)
        best = int(np.argmax(ranking.odds))
        if ranking.odds[best] > THRESHOLD:
            accepted.append(others[best])
            if len(accepted) > 1 and len(accepted) <= 8:
                accepted = _swap_and_drop(lin, cat, grid, accepted, banned)
            continue
        accepted = _swap_and_drop(lin, cat, grid, accepted, banned)
    return accepted


def _swap_and_drop(lin: Linearisation, cat: Catalogue, grid: Grid, accepted: list[int], banned: set[int]) -> list[int]:
    """For each accepted term: drop it when the rest does without, replace it when another does better."""
    current = list(accepted)
    for term in list(current):
        rest = [i for i in current if i != term]
        wanted = [term] if len(current) > 8 else [i for i in range(len(cat.candidates)) if i not in rest and i not in banned]
        ranking = rank(lin, cat, grid, rest, wanted)
        own = ranking.odds[wanted.index(term)]
        best = int(np.argmax(ranking.odds))
        if ranking.odds[best] <= THRESHOLD:
            current = rest
        elif ranking.odds[best] > own + 1.0:
            current = [*rest, wanted[best]]
    return current


def _refit(
    machine: Machine, recording: Recording, cat: Catalogue, accepted: list[int], fit: Estimate, exclude: NDArray[np.bool_], banned: set[int]
) -> tuple[Estimate, list[int]]:
    """Nonlinear fit with the accepted terms; a term that leaves its physical bounds is banned and the fit repeated."""
    while True:
        terms = [cat.candidates[i] for i in accepted]
        known = {e.label: e.amplitudes for e in fit.fitted_effects()}
        start = np.concatenate([fit.p[: len(machine.parameters)], *[known.get(t.label, np.zeros(len(t.coefficients))) for t in terms]])
        result = estimate(machine, recording, terms, start=start, exclude=exclude)
        outside = [i for i, term in zip(accepted, result.fitted_effects(), strict=True) if _outside(term, result)]
        if not outside:
            return result, accepted
        banned.update(outside)
        accepted = [i for i in accepted if i not in outside]


def _outside(term: object, result: Estimate) -> bool:
    """Whether a coefficient is beyond its bounds by more than two of its standard deviations."""
    from truepose.models.effects.base import PlacedEffect

    assert isinstance(term, PlacedEffect)
    names = list(result.prior.names)
    std = result.std
    for c, value in zip(term.coefficients, term.amplitudes, strict=True):
        slack = 2.0 * std[names.index(f"{term.label}:{c.name}")]
        if value < c.lower - slack or value > c.upper + slack:
            return True
    return False
