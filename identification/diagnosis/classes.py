"""Explanations that these data cannot tell apart, and how sure the named one is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.evidence import Grid
from truepose.identification.diagnosis.selection import Ranking, rank
from truepose.identification.diagnosis.signatures import Linearisation

Array = NDArray[np.float64]
INDISTINCT = 3.0
"""Expected log Bayes factor below which two explanations are one class."""
CLASS_LIMIT = 8


@dataclass(frozen=True)
class Member:
    """An explanation of a class: candidate index, its share of the probability."""

    index: int
    probability: float
    gain: float


@dataclass(frozen=True)
class Named:
    """An accepted term with its class; ``probability`` is the term's own, ``certainty`` the whole class's."""

    index: int
    probability: float
    certainty: float
    gain: float
    equivalents: tuple[Member, ...]


def name_term(lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], term: int) -> Named:
    """Weigh every candidate in place of ``term`` and gather those that the data cannot tell from it."""
    rest = {i: v for i, v in accepted.items() if i != term}
    wanted = [i for i in range(len(cat.candidates)) if i not in rest]
    ranking = rank(lin, cat, grid, rest, wanted)
    odds = np.append(ranking.odds, 0.0)  # the last is: nothing more
    probability = np.exp(odds - logsumexp(odds))
    own = wanted.index(term)
    missed = missed_chi2(lin, ranking, rest, term, wanted)
    near = [j for j in np.argsort(-ranking.odds) if j != own and _indistinct(ranking, missed, own, int(j))][:CLASS_LIMIT]
    members = tuple(Member(wanted[j], float(probability[j]), float(ranking.gain[j])) for j in near)
    certainty = float(probability[own] + sum(m.probability for m in members))
    return Named(term, float(probability[own]), certainty, float(ranking.gain[own]), members)


def _indistinct(ranking: Ranking, missed: Array, own: int, other: int) -> bool:
    """Whether the data prefer neither, or could not prefer the right one even where it is true."""
    difference = ranking.gain[own] - ranking.gain[other]
    plausible = ranking.gain[other] > 0.5 * max(ranking.gain[own], 0.0)
    return bool(plausible and (abs(difference) < INDISTINCT or (0.5 * missed[other] < INDISTINCT and difference < 3 * INDISTINCT)))


def missed_chi2(lin: Linearisation, ranking: Ranking, rest: Mapping[int, float], term: int, wanted: Sequence[int]) -> Array:
    """(C,) what of the term's fitted signature each candidate cannot reproduce, in chi2, geometry adapting in tolerance."""
    n = lin.free
    noise = float(ranking.evidence.best_noise[list(wanted).index(term)])
    inside = np.concatenate([np.arange(n), n + np.array(lin.indices(list(rest)), dtype=int)]).astype(int)
    sizes = [lin.columns[i].stop - lin.columns[i].start for i in rest]
    weight = np.concatenate([lin.weight, 1.0 / np.repeat(list(rest.values()), sizes)])
    gram = lin.gram / noise**2
    a = gram[np.ix_(inside, inside)] + np.diag(weight**2) + 1e-12 * np.max(np.diag(gram)[inside]) * np.eye(len(inside))
    at = n + np.arange(lin.columns[term].start, lin.columns[term].stop)
    amplitude = ranking.evidence.amplitude[list(wanted).index(term)]
    own = gram[:, at] @ amplitude
    solved = np.linalg.solve(a, own[inside])
    total = float(amplitude @ own[at] - own[inside] @ solved)
    out = np.empty(len(wanted))
    for j, i in enumerate(wanted):
        cols = n + np.arange(lin.columns[i].start, lin.columns[i].stop)
        cross = gram[np.ix_(inside, cols)]
        score = own[cols] - cross.T @ solved
        information = gram[np.ix_(cols, cols)] - cross.T @ np.linalg.solve(a, cross)
        out[j] = total - float(score @ np.linalg.lstsq(information, score, rcond=1e-10)[0])
    return np.maximum(out, 0.0)


def flip_inflation(lin: Linearisation, cat: Catalogue, grid: Grid, accepted: Mapping[int, float], term: int, threshold: float) -> float | None:
    """How many times wider every tolerance would have to be for the term not to be needed; None when none would do."""
    rest = {i: v for i, v in accepted.items() if i != term}
    for factor in (1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0, 100.0):
        fixed = Grid(grid.noise, ((factor,) * len(grid.classes),), grid.classes)
        if rank(lin, cat, fixed, rest, [term]).odds[0] < threshold:
            return factor
    return None
