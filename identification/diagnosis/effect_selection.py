"""Which effects the data ask for: forward selection with backward deletion and swaps, then the nonlinear refit.

All steps between two refits are linear algebra on one Gram matrix; a refit moves the expansion point, and
the search ends when a refit asks for nothing new.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.effect_evidence import (
    MANY_OBSERVATIONS,
    Evidence,
    grid_for,
    log_positive,
    weigh,
)
from truepose.identification.diagnosis.refine import refined
from truepose.identification.diagnosis.refit import refit
from truepose.identification.diagnosis.signatures import Linearisation, Signatures
from truepose.identification.fit.estimate import Estimate
from truepose.identification.selection.forward import select_forward
from truepose.identification.selection.scales import Grid
from truepose.models.effects.base import SERIES

Array = NDArray[np.float64]
THRESHOLD = 3.0
"""Log posterior odds a term must bring to be added, and keep to stay."""
MAX_REFITS = 8
MANY_TERMS = 5
"""Beyond so many terms each is only kept or dropped; swapping each against the whole catalogue takes too long."""
OVERWHELMING = 100.0
BOUND_DOUBT = 0.2
"""1-sigma, in the log, of how far physical bounds are known: a driver is logged beside where it acts, a unit is wrong."""
LARGEST_COST = 50.0
"""The most that a coefficient beyond its bound costs in the log."""
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
    """Accepted candidates (index into its catalogue, to spread in scales), the fit with them, its linearisation.

    Signatures and catalogue are those searched, or with settings refined: the same places, the same indices.
    """

    accepted: Mapping[int, float]
    fit: Estimate
    linearisation: Linearisation
    grid: Grid
    signatures: Signatures
    catalogue: Catalogue

    @property
    def all_named(self) -> bool:
        """Whether every accepted term is an effect of the catalogue."""
        return all(self.catalogue.named(i) for i in self.accepted)


def rank(
    lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], wanted: Sequence[int]
) -> Ranking:
    """Log posterior odds of each wanted candidate given the accepted ones."""
    result = weigh(lin, wanted, grid, accepted)
    gain = result.gain.copy()
    for j, i in enumerate(wanted):
        gain[j] += log_plausibility(cat, i, result.amplitude[j], result.std[j])
    odds = gain + np.array([cat.log_odds(i, accepted) for i in wanted]) if len(wanted) else gain
    return Ranking(tuple(wanted), odds, gain, result)


def log_plausibility(cat: Catalogue, index: int, amplitude: Array, spread: Array) -> float:
    """Log factor of physical signs and bounds of coefficients: ``amplitude`` and ``spread`` (k,), in scales."""
    total = 0.0
    for c, mean, std in zip(cat.candidates[index].coefficients, amplitude, spread, strict=True):
        if c.lower == 0.0:
            total += log_positive(float(mean), float(std))
        bound = (c.upper if mean > 0 else -c.lower) / c.scale
        least = abs(float(mean)) - 3.0 * float(std)
        if least > bound > 0.0:
            total -= min(0.5 * (np.log(least / bound) / BOUND_DOUBT) ** 2, LARGEST_COST)
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

    ``rms`` of the whitened free fit bounds the noise scale. ``exclude`` (n,) are rows left out.
    """
    accepted: dict[int, float] = dict.fromkeys(cat.stated, WIDE)
    fit = null
    if first is not None and set(first.accepted) != set(accepted):
        fit, accepted = refit(signatures, cat, first.accepted, first.fit, exclude, set())
    lin = signatures.linearise(fit)
    start = Selection(accepted, fit, lin, grid_for(lin, rms), signatures, cat)
    found = _settle(start, exclude, set())
    if found.all_named:
        sharp = _sharpened(found, exclude, set())
        return sharp if sharp.all_named else found
    # a large effect is weighed poorly from a fit without it or with a setting beside its own, and something unnamed
    # may take its place: start again from the best names alone, and keep them if nothing unnamed is asked for there
    nameless = {i for i in range(len(cat.candidates)) if not cat.named(i)}
    bare = restricted(start, exclude, [i for i in accepted if i not in nameless])
    names = _settle(bare, exclude, set(nameless))
    if set(names.accepted) == set(bare.accepted):
        return found
    names = _sharpened(names, exclude, nameless)
    again = _settle(names, exclude, set())
    if again.all_named:
        return again
    if len(names.accepted) > MANY_TERMS:
        return found
    # far from the drawing what is asked for may be an extrapolation: what counts is how each did in its own fit
    own = log_posterior(names)
    return names if own > log_posterior(found) and own > log_posterior(again) else found


def log_posterior(found: Selection) -> float:
    """Log posterior of a selection up to a constant: its evidence at its own fit, term after term, and the prior odds."""
    cat, lin, grid = found.catalogue, found.linearisation, found.grid
    present = {i: v for i, v in found.accepted.items() if i in cat.stated}
    total = weigh(lin, [], grid, present).null
    for i in (i for i in found.accepted if i not in cat.stated):
        total += float(rank(lin, cat, grid, present, [i]).odds[0])
        present[i] = found.accepted[i]
    return total


def _sharpened(found: Selection, exclude: NDArray[np.bool_], banned: set[int]) -> Selection:
    """The selection with continuous settings refined and the search gone on from there; the same where none gains by it."""
    cat = refined(found.signatures, found.catalogue, found.fit, found.grid, found.accepted)
    if cat is found.catalogue:
        return found
    signatures, kept = found.signatures.of(cat.candidates), set(banned)
    fit, accepted = refit(signatures, cat, found.accepted, found.fit, exclude, kept)
    return _settle(
        Selection(accepted, fit, signatures.linearise(fit), found.grid, signatures, cat), exclude, kept
    )


def _settle(start: Selection, exclude: NDArray[np.bool_], banned: set[int]) -> Selection:
    """Search and refit in turn until a refit asks for nothing new."""
    signatures, cat = start.signatures, start.catalogue
    accepted, fit, lin, grid = start.accepted, start.fit, start.linearisation, start.grid
    for _ in range(MAX_REFITS):
        before = set(accepted)
        accepted = _search(lin, cat, grid, accepted, banned)
        if set(accepted) == before:
            break
        fit, accepted = refit(signatures, cat, accepted, fit, exclude, banned)
        lin = signatures.linearise(fit)
        if (
            lin.n_observations > MANY_OBSERVATIONS
        ):  # the noise is known well by now, and each point of the grid costs
            grid = grid_for(lin, float(np.sqrt(fit.chi2_per_dof)))
    return Selection(accepted, fit, lin, grid, signatures, cat)


def restricted(selection: Selection, exclude: NDArray[np.bool_], kept: Collection[int]) -> Selection:
    """The selection with some of its terms only, fitted anew without the rows ``exclude`` (n,)."""
    accepted = {i: v for i, v in selection.accepted.items() if i in kept}
    if len(accepted) == len(selection.accepted):
        return selection
    return refitted(selection, exclude, accepted)


def refitted(selection: Selection, exclude: NDArray[np.bool_], accepted: Mapping[int, float]) -> Selection:
    """The selection with other terms, fitted anew without the rows ``exclude`` (n,); impossible terms are dropped."""
    signatures = selection.signatures
    fit, left = refit(signatures, selection.catalogue, accepted, selection.fit, exclude, set())
    return replace(selection, accepted=left, fit=fit, linearisation=signatures.linearise(fit))


def _search(
    lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], banned: set[int]
) -> dict[int, float]:
    """Add, swap and drop terms until nothing changes."""

    def add(current: dict[int, float]) -> dict[int, float]:
        others = [i for i in range(len(cat.candidates)) if i not in current and i not in banned]
        if not others:
            return current
        ranking = rank(lin, cat, grid, current, others)
        best = int(np.argmax(ranking.odds))
        for j in _alike(cat, ranking, best) if ranking.odds[best] > THRESHOLD else []:
            current = {i: v for i, v in current.items() if not _excluded(cat, i, others[j])}
            current[others[j]] = spread_of(cat, others[j], ranking.evidence.spread[j])
        return current

    def review(current: dict[int, float], added: bool) -> dict[int, float]:
        if not added or 1 < len(current) <= MANY_TERMS:
            current = _swap_and_drop(lin, cat, grid, current, banned)
        return current if added else _join_pairs(lin, cat, grid, current, banned)

    return select_forward(accepted, add, review)


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


def _join_pairs(
    lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], banned: set[int]
) -> dict[int, float]:
    """Replace two terms by one that explains as much: what was added first may be half of something else."""
    current = dict(accepted)
    own = [i for i in current if i not in cat.stated]
    if len(own) > MANY_TERMS:
        return current
    for first, second in itertools.combinations(own, 2):
        if first not in current or second not in current:
            continue
        rest = {i: v for i, v in current.items() if i not in (first, second)}
        wanted = [i for i in range(len(cat.candidates)) if i not in rest and i not in banned]
        ranking = rank(lin, cat, grid, rest, wanted)
        beside = rank(lin, cat, grid, rest | {first: current[first]}, [second]).odds[0]
        best = int(np.argmax(ranking.odds))
        if ranking.odds[best] > ranking.odds[wanted.index(first)] + beside:
            current = rest | {wanted[best]: spread_of(cat, wanted[best], ranking.evidence.spread[best])}
    return current
