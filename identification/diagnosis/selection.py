"""Which effects the data ask for: forward selection with backward deletion and swaps, then the nonlinear refit.

All steps between two refits are linear algebra on one Gram matrix; a refit moves the expansion point, and
the search ends when a refit asks for nothing new.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.evidence import (
    MANY_READINGS,
    Evidence,
    Grid,
    evidence,
    grid_for,
    log_positive,
)
from truepose.identification.diagnosis.signatures import Linearisation, Signatures
from truepose.identification.estimate import Estimate, estimate
from truepose.models.effects.base import SERIES, PlacedEffect

Array = NDArray[np.float64]
THRESHOLD = 3.0
"""Log posterior odds a term must bring to be added, and keep to stay."""
MAX_TERMS = 80
MAX_REFITS = 8
MANY_TERMS = 5
"""Beyond so many terms each is only kept or dropped; swapping each against the whole catalogue takes too long."""
OVERWHELMING = 100.0
WIDE = 100.0


@dataclass(frozen=True)
class Ranking:
    """Candidates weighed against the same accepted terms: log posterior odds and parts of it, per candidate."""

    indices: tuple[int, ...]
    odds: Array
    gain: Array
    evidence: Evidence


@dataclass(frozen=True)
class Selection:
    """Accepted candidates (index into the catalogue, to spread in scales), the fit with them, its linearisation."""

    accepted: Mapping[int, float]
    fit: Estimate
    linearisation: Linearisation
    grid: Grid


def rank(
    lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], wanted: Sequence[int]
) -> Ranking:
    """Log posterior odds of each wanted candidate given the accepted ones."""
    result = evidence(lin, wanted, grid, accepted)
    gain = result.gain.copy()
    for j, i in enumerate(wanted):
        gain[j] += physical(cat, i, result.amplitude[j], result.std[j])
    odds = gain + np.array([cat.log_odds(i, accepted) for i in wanted]) if len(wanted) else gain
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
    signatures: Signatures,
    cat: Catalogue,
    null: Estimate,
    exclude: NDArray[np.bool_],
    rms: float,
    first: Selection | None = None,
) -> Selection:
    """Search from the null fit, or from what an earlier search on other rows found.

    ``rms`` of the whitened free fit bounds the noise scale.
    """
    accepted: dict[int, float] = dict.fromkeys(cat.stated, WIDE)
    fit = null
    if first is not None and set(first.accepted) != set(accepted):
        fit, accepted = _refit(signatures, cat, first.accepted, first.fit, exclude, set())
    lin = signatures.linearise(fit)
    start = Selection(accepted, fit, lin, grid_for(lin, rms))
    found = _settle(signatures, cat, start, exclude, set())
    if all(cat.named(i) for i in found.accepted):
        return found
    # a large effect is weighed poorly from a fit without it, and something unnamed may take its place: start
    # again from the best names alone, and keep them if nothing unnamed is asked for there
    nameless = {i for i in range(len(cat.candidates)) if not cat.named(i)}
    bare = only(signatures, cat, start, exclude, [i for i in accepted if i not in nameless])
    names = _settle(signatures, cat, bare, exclude, set(nameless))
    if set(names.accepted) == set(bare.accepted):
        return found
    again = _settle(signatures, cat, names, exclude, set())
    return again if all(cat.named(i) for i in again.accepted) else found


def _settle(
    signatures: Signatures,
    cat: Catalogue,
    start: Selection,
    exclude: NDArray[np.bool_],
    banned: set[int],
) -> Selection:
    """Search and refit in turn until a refit asks for nothing new."""
    accepted, fit, lin, grid = start.accepted, start.fit, start.linearisation, start.grid
    for _ in range(MAX_REFITS):
        before = set(accepted)
        accepted = _search(lin, cat, grid, accepted, banned)
        if set(accepted) == before:
            break
        fit, accepted = _refit(signatures, cat, accepted, fit, exclude, banned)
        lin = signatures.linearise(fit)
        if lin.readings > MANY_READINGS:  # the noise is known well by now, and each point of the grid costs
            grid = grid_for(lin, float(np.sqrt(fit.chi2_per_dof)))
    return Selection(accepted, fit, lin, grid)


def only(
    signatures: Signatures,
    cat: Catalogue,
    selection: Selection,
    exclude: NDArray[np.bool_],
    kept: Collection[int],
) -> Selection:
    """The selection with some of its terms only, fitted anew."""
    accepted = {i: v for i, v in selection.accepted.items() if i in kept}
    if len(accepted) == len(selection.accepted):
        return selection
    fit, accepted = _refit(signatures, cat, accepted, selection.fit, exclude, set())
    return Selection(accepted, fit, signatures.linearise(fit), selection.grid)


def _search(
    lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], banned: set[int]
) -> dict[int, float]:
    """Add, swap and drop terms until nothing changes."""
    current = dict(accepted)
    seen: set[frozenset[int]] = set()
    while len(current) < MAX_TERMS and frozenset(current) not in seen:
        seen.add(frozenset(current))
        others = [i for i in range(len(cat.candidates)) if i not in current and i not in banned]
        if not others:
            break
        ranking = rank(lin, cat, grid, current, others)
        best = int(np.argmax(ranking.odds))
        chosen = _alike(cat, ranking, best) if ranking.odds[best] > THRESHOLD else []
        for j in chosen:
            current = {i: v for i, v in current.items() if not _excluded(cat, i, others[j])}
            current[others[j]] = spread_of(cat, others[j], ranking.evidence.spread[j])
        if not chosen or 1 < len(current) <= MANY_TERMS:
            current = _swap_and_drop(lin, cat, grid, current, banned)
    return current


def _alike(cat: Catalogue, ranking: Ranking, best: int) -> list[int]:
    """The best candidate, and where it is a long series overwhelmingly asked for, its like at other places."""
    first = cat.candidates[ranking.indices[best]]
    if len(first.coefficients) < SERIES:
        return [best]
    like = [
        j
        for j, i in enumerate(ranking.indices)
        if cat.candidates[i].effect.slug == first.effect.slug
        and cat.candidates[i].settings == first.settings
        and ranking.odds[j] > OVERWHELMING
    ]
    return sorted({best, *like}, key=lambda j: -ranking.odds[j])


def _excluded(cat: Catalogue, term: int, added: int) -> bool:
    """Whether an accepted term is another version of the added one (the same effect and place, settings that exclude)."""
    a, b = cat.candidates[term], cat.candidates[added]
    return (a.effect.slug, a.place) == (b.effect.slug, b.place) and not b.effect.settings_add


def spread_of(cat: Catalogue, index: int, found: float) -> float:
    """Prior spread of an accepted term, in scales: wide for a few coefficients, what the evidence found for a series."""
    return float(found) if len(cat.candidates[index].coefficients) >= SERIES else WIDE


def _swap_and_drop(
    lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], banned: set[int]
) -> dict[int, float]:
    """For each accepted term: drop it when the rest does without, replace it when another does better."""
    current = dict(accepted)
    for term in [i for i in current if i not in cat.stated]:
        rest = {i: v for i, v in current.items() if i != term}
        every = [i for i in range(len(cat.candidates)) if i not in rest and i not in banned]
        wanted = [term] if len(current) > MANY_TERMS else every
        ranking = rank(lin, cat, grid, rest, wanted)
        own = ranking.odds[wanted.index(term)]
        best = int(np.argmax(ranking.odds))
        if ranking.odds[best] <= THRESHOLD:
            current = rest
        elif ranking.odds[best] > own + 1.0:
            current = rest | {wanted[best]: spread_of(cat, wanted[best], ranking.evidence.spread[best])}
    return current


def _refit(
    signatures: Signatures,
    cat: Catalogue,
    accepted: Mapping[int, float],
    fit: Estimate,
    exclude: NDArray[np.bool_],
    banned: set[int],
) -> tuple[Estimate, dict[int, float]]:
    """Nonlinear fit with the accepted terms.

    A term that leaves its physical bounds, or the newest one where no minimum is found, is banned and the fit
    repeated without it.
    """
    machine, recording = signatures.machine, signatures.recording
    current = dict(accepted)
    while True:
        terms = [replace(cat.candidates[i], spread=spread) for i, spread in current.items()]
        known = {e.label: e.amplitudes for e in fit.fitted_effects()}
        start = np.concatenate(
            [
                fit.p[: len(machine.parameters)],
                *[known.get(t.label, np.zeros(len(t.coefficients))) for t in terms],
            ]
        )
        try:
            result = estimate(machine, recording, terms, start=start, exclude=exclude, damping=1e-9)
        except ConvergenceError:
            added = [i for i in current if i not in cat.stated]
            if not added:
                raise
            banned.add(added[-1])
            del current[added[-1]]
            continue
        outside = [
            i for i, term in zip(current, result.fitted_effects(), strict=True) if _outside(term, result)
        ]
        if not outside:
            return result, current
        banned.update(outside)
        current = {i: v for i, v in current.items() if i not in outside}


def _outside(term: PlacedEffect, result: Estimate) -> bool:
    """Whether a coefficient is beyond its bounds by more than two of its standard deviations."""
    names = list(result.prior.names)
    std = result.std
    for c, value in zip(term.coefficients, term.amplitudes, strict=True):
        slack = 2.0 * std[names.index(f"{term.label}:{c.name}")]
        if value < c.lower - slack or value > c.upper + slack:
            return True
    return False
