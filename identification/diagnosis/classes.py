"""Explanations that these data cannot tell apart, and how sure the named one is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from truepose.identification.diagnosis.candidates import Catalogue, Cause
from truepose.identification.diagnosis.effect_selection import Ranking, rank
from truepose.identification.diagnosis.signatures import Linearisation
from truepose.identification.selection.scales import Grid

Array = NDArray[np.float64]
CERTAIN = 0.95
"""Probability that a class needs to be given; it grows by lesser names until it holds as much."""
INDISTINCT = 3.0
"""Expected log Bayes factor below which two explanations are one class."""
CLASS_LIMIT = 8
SMALL_AGAINST_REMAINDER = 0.1
WIDENINGS = (1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0, 100.0)


@dataclass(frozen=True)
class Member:
    """An explanation of a class: candidate index, its share of the probability."""

    index: int
    probability: float
    gain: float


@dataclass(frozen=True)
class Named:
    """An accepted term with its class; ``probability`` is the term's own, ``certainty`` the whole class's.

    ``doubt`` (k,), in units of the coefficients: how far other settings (a lag, a time constant) would move them.
    """

    index: int
    probability: float
    certainty: float
    gain: float
    equivalents: tuple[Member, ...]
    doubt: tuple[float, ...] = ()


def name_term(
    lin: Linearisation,
    cat: Catalogue,
    grid: Grid,
    accepted: Mapping[int, float],
    term: int,
    unexplained: float,
) -> Named:
    """Weigh every candidate in place of ``term`` and gather those that the data cannot tell from it.

    ``unexplained`` is the log likelihood that no model here explains. Rivals that differ by less than a tenth
    of it are not told apart: what is missing from both is larger than what separates them.
    """
    rest = {i: v for i, v in accepted.items() if i != term}
    wanted = [i for i in range(len(cat.candidates)) if i not in rest]
    ranking = rank(lin, cat, grid, rest, wanted)
    width = INDISTINCT + SMALL_AGAINST_REMAINDER * unexplained
    own = wanted.index(term)
    signal, missed = missed_chi2(lin, ranking, rest, term, wanted)
    rivals = [
        j
        for j in np.argsort(-ranking.odds)
        if j != own and _indistinct(ranking, signal, missed, own, int(j), width)
    ]
    # what says something else is no alternative: it may be missing as well
    alike = {own, *rivals, *np.flatnonzero(missed < 0.5 * signal).tolist()}
    rivals, certainty = _credible(cat, ranking, own, rivals, sorted(alike))
    # who of the class it is, at the width the remainder leaves; that it is the class, at face value
    share = _tempered(cat, ranking, [own, *rivals], INDISTINCT / width)
    members = tuple(
        Member(wanted[j], certainty * float(p), float(ranking.gain[j]))
        for j, p in zip(rivals, share[1:], strict=True)
        if cat.named(wanted[j])
    )
    return Named(
        term,
        certainty * float(share[0]),
        min(certainty, 1.0),
        float(ranking.gain[own]),
        members[:CLASS_LIMIT],
        _settings_doubt(cat, ranking, own),
    )


def _tempered(cat: Catalogue, ranking: Ranking, members: Sequence[int], power: float) -> Array:
    """Shares of causes by their odds to a power, split among settings of one cause by their odds themselves."""
    causes: dict[Cause, list[int]] = {}
    for k, j in enumerate(members):
        causes.setdefault(cat.cause(ranking.indices[j]), []).append(k)
    odds, out = ranking.odds[list(members)], np.zeros(len(members))
    total = _shares(power * np.array([logsumexp(odds[ks]) for ks in causes.values()]))
    for share, ks in zip(total, causes.values(), strict=True):
        out[ks] = share * _shares(odds[ks])
    return out


def _credible(
    cat: Catalogue, ranking: Ranking, own: int, rivals: Sequence[int], alike: Sequence[int]
) -> tuple[list[int], float]:
    """The rivals, and while they are not certain the likeliest other names that say much the same; their probability.

    Positions in the ranking; the alternatives are those ``alike``, and nothing more at all.
    """
    shares = dict(zip((*alike, -1), _shares(np.append(ranking.odds[list(alike)], 0.0)), strict=True))
    out = list(rivals)
    others = [j for j in alike if j not in (own, *out) and cat.named(ranking.indices[j])]
    for j in sorted(others, key=lambda j: -shares[j]):
        if sum(shares[k] for k in (own, *out)) >= CERTAIN:
            break
        out.append(j)
    return out, float(sum(shares[k] for k in (own, *out)))


def _settings_doubt(cat: Catalogue, ranking: Ranking, own: int) -> tuple[float, ...]:
    """Rms distance of the coefficients from those at other settings of the same term, weighed by their odds."""
    placed = cat.candidates[ranking.indices[own]]
    names = [c.name for c in placed.coefficients]
    like = [
        j
        for j, i in enumerate(ranking.indices)
        if (c := cat.candidates[i]).effect.slug == placed.effect.slug
        and c.place == placed.place
        and not placed.effect.settings_add
        and [k.name for k in c.coefficients] == names
    ]
    if len(like) < 2:
        return (0.0,) * len(names)
    amplitude = np.array([ranking.evidence.amplitude[j] for j in like])
    away = _shares(ranking.odds[like]) @ (amplitude - ranking.evidence.amplitude[own]) ** 2
    scale = np.array([c.scale for c in placed.coefficients])
    return tuple(float(v) for v in np.sqrt(away) * scale)


def _shares(odds: Array) -> Array:
    out: Array = np.exp(odds - logsumexp(odds))
    return out


def _indistinct(ranking: Ranking, signal: float, missed: Array, own: int, other: int, width: float) -> bool:
    """Whether another term says the same thing and the data prefer neither.

    The same thing: it reproduces more than half of the fitted signature, geometry adapting within tolerances.
    """
    alike = missed[other] < 0.5 * signal and ranking.gain[other] > 0.5 * max(ranking.gain[own], 0.0)
    difference = ranking.gain[own] - ranking.gain[other]
    blind = 0.5 * missed[other] < INDISTINCT and difference < 3 * INDISTINCT
    return bool(alike and (abs(difference) < width or blind))


def missed_chi2(
    lin: Linearisation, ranking: Ranking, rest: Mapping[int, float], term: int, wanted: Sequence[int]
) -> tuple[float, Array]:
    """The term's fitted signal in chi2, and (C,) what of it each candidate cannot reproduce, geometry adapting in tolerance."""
    n = lin.free
    noise = float(ranking.evidence.best_noise[list(wanted).index(term)])
    inside = np.concatenate([np.arange(n), n + np.array(lin.indices(list(rest)), dtype=int)]).astype(int)
    sizes = [lin.columns[i].stop - lin.columns[i].start for i in rest]
    weight = np.concatenate([lin.weight, 1.0 / np.repeat(list(rest.values()), sizes)])
    every = n + np.array(lin.indices(wanted), dtype=int)
    a = lin.gram[np.ix_(inside, inside)] / noise**2 + np.diag(weight**2)
    factor = np.linalg.cholesky(a + 1e-12 * np.max(np.diag(a)) * np.eye(len(a)))
    half = solve_triangular(factor, lin.gram[np.ix_(inside, every)] / noise, lower=True) / noise
    # what each column has that geometry and the other terms cannot adapt to
    left = lin.gram[np.ix_(every, every)] / noise**2 - half.T @ half
    ends = np.cumsum([0, *(lin.columns[i].stop - lin.columns[i].start for i in wanted)])
    blocks = [slice(int(b), int(e)) for b, e in pairwise(ends)]
    at = blocks[list(wanted).index(term)]
    amplitude = ranking.evidence.amplitude[list(wanted).index(term)]
    own = left[:, at] @ amplitude
    total = float(amplitude @ own[at])
    caught = [float(own[b] @ np.linalg.lstsq(left[b, b], own[b], rcond=1e-10)[0]) for b in blocks]
    return total, np.maximum(total - np.array(caught), 0.0)


def flip_inflation(
    lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], term: int, threshold: float
) -> float | None:
    """How many times wider every tolerance would have to be for the term not to be needed; None when none would do."""
    rest = {i: v for i, v in accepted.items() if i != term}

    def needed(factor: float) -> bool:
        fixed = Grid(grid.noise, ((factor,) * len(grid.classes),), grid.classes)
        return bool(rank(lin, cat, fixed, rest, [term]).odds[0] >= threshold)

    if needed(WIDENINGS[-1]):
        return None
    return next(factor for factor in WIDENINGS if factor == WIDENINGS[-1] or not needed(factor))
