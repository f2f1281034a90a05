"""A linearisation and its catalogue as a posterior over sets: columns, terms and the grid of what is not known.

Every candidate by itself, against the model without effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from truepose.arrays import Array, Index
from truepose.identification import prior
from truepose.identification.fit.tolerance_classes import PartClass, widenings
from truepose.identification.learned_prior import FleetPrior
from truepose.identification.posterior.design import Always, Design, GridPoint, Term, Terms, Unknowns, Urn
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import best_point
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.machine.mechanism import like_parts
from truepose.models.machine.placed import EffectAtPlace

UNNAMED = "unnamed"
"""The kind of all that has no name."""


@dataclass(frozen=True)
class SelectionProblem:
    """The posterior's problem, and what its numbers mean.

    candidates: for each term the one of the catalogue that it is; causes: by number; classes: of parts, in the order of
    the grid's widenings; richness: how many terms machines have.
    """

    spike_slab: SpikeSlab
    candidates: tuple[int, ...]
    causes: tuple[EffectAtPlace, ...]
    classes: tuple[PartClass, ...]
    richness: prior.Richness


def selection_problem(lin: Linearisation, cat: Catalogue, rms: float) -> SelectionProblem:
    """``rms`` of the whitened residual of the ordinary fit bounds the noise."""
    free = tuple(i for i in range(len(cat.candidates)) if i not in cat.stated)
    shares, more = _log_shares(cat, free)
    causes, terms = _terms(cat, lin, free, shares)
    classes = tuple(dict.fromkeys(lin.parts))
    unknowns = Unknowns.over(len(lin.grams), rms, widenings(classes))
    spike_slab = SpikeSlab(_design(lin, cat, classes), unknowns, terms, prior.SIZES)
    return SelectionProblem(spike_slab, free, causes, classes, prior.RICHNESS.scaled(more))


def _design(lin: Linearisation, cat: Catalogue, classes: Sequence[PartClass]) -> Design:
    """Columns of every model (geometry, what the file states), of terms, and the residual at the drawing without effects."""
    n, width = lin.free, lin.columns[-1].stop if lin.columns else 0
    stated = n + np.array(lin.indices(cat.stated), dtype=np.intp)
    picked = np.concatenate([np.arange(n), stated, n + np.arange(width)]).astype(np.intp)
    own = np.divide(1.0, lin.weight, out=np.full(n, np.inf), where=lin.weight > 0.0)
    sigma = np.concatenate([own, np.full(len(stated), prior.STATED)])
    numbers = [classes.index(part) for part in lin.parts]
    always = Always(sigma, np.array([*numbers, *[-1] * len(stated)], dtype=np.intp))
    # e: as a reading less its prediction
    drawing = np.append(lin.departure, -1.0)
    return Design(tuple(_with_drawing(gram, picked, drawing) for gram in lin.grams), lin.counts, always)


def _with_drawing(gram: Array, picked: Index, drawing: Array) -> Array:
    """The Gram matrix of the ``picked`` columns, and of the combination ``drawing`` of all of them."""
    product, out = gram @ drawing, np.empty((len(picked) + 1,) * 2)
    out[:-1, :-1] = gram[np.ix_(picked, picked)]
    out[:-1, -1] = out[-1, :-1] = product[picked]
    out[-1, -1] = drawing @ product
    return out


def _terms(
    cat: Catalogue, lin: Linearisation, free: Sequence[int], log_shares: Array
) -> tuple[tuple[EffectAtPlace, ...], Terms]:
    """Causes, and a term for each free candidate (all that the file does not state) with its urns."""
    placed = [cat.candidates[i] for i in free]
    kinds, told = [_kind(cat, i) for i in free], [c.effect.told(c.settings_map) for c in placed]
    table = pd.DataFrame({"cause": [cat.cause(i) for i in free], "kind": kinds, "feature": told})
    table["share"] = np.exp(log_shares)
    table["in_kind"] = table["share"] / table.groupby("kind")["share"].transform("sum")
    number, causes = pd.factorize(table["cause"])
    feature = table.groupby(["kind", "feature"], sort=False).ngroup().to_numpy()
    group, _ = pd.factorize(pd.Series([_group(cat, i) for i in free], dtype=object))
    share = np.log(table["in_kind"].to_numpy())
    terms = list[Term]()
    for k, (i, one) in enumerate(zip(free, placed, strict=True)):
        columns, numbers = tuple(lin.indices([i])), (int(number[k]), int(feature[k]), float(share[k]))
        seen = one.coefficients[: len(columns)]
        lower, upper = tuple(c.lower / c.scale for c in seen), tuple(c.upper / c.scale for c in seen)
        alone = cat.has_law(i) and not one.effect.adds(one.settings_map)
        terms.append(Term(columns, *numbers, lower, upper, alone, len(one.coefficients), int(group[k])))
    return tuple(causes), Terms(terms, _urn(table, cat.learned))


def _kind(cat: Catalogue, index: int) -> str:
    """What has a name is likelier where its like is, and all that has none is alike: more of it brings more.

    An effect of several parts at once is another kind than that of parts alone: it says the same of them once more.
    """
    placed = cat.candidates[index]
    if not cat.has_law(index):
        return UNNAMED
    return f"{placed.effect.slug} of {len(placed.place)}"


def _group(cat: Catalogue, index: int) -> str:
    """Return what a term gives way with: the terms of its kind, or without a name those at like parts."""
    return _kind(cat, index) if cat.has_law(index) else like_parts(cat.candidates[index].place[0])


def _urn(table: pd.DataFrame, learned: FleetPrior | None) -> Urn:
    """Kinds, features and causes in the order in which they first come."""
    kinds = table.groupby("kind", sort=False)
    numbers = dict(zip(table["kind"].drop_duplicates(), range(kinds.ngroups), strict=True))
    features = table.groupby(["kind", "feature"], sort=False)["in_kind"].sum()
    sizes = [None if learned is None else learned.log_sizes(cause.effect) for cause in kinds["cause"].first()]
    return Urn(
        kind=table.drop_duplicates("cause")["kind"].map(numbers).to_numpy(dtype=np.intp),
        share=kinds["share"].sum().to_numpy(),
        number=kinds["cause"].nunique().to_numpy().astype(np.intp),
        feature_kind=features.index.get_level_values("kind").map(numbers).to_numpy(dtype=np.intp),
        feature_share=features.to_numpy(),
        log_size=np.array([prior.SIZES.log_prior if own is None else own for own in sizes]),
        weight=prior.URN,
        alike=prior.ALIKE,
        further=prior.FURTHER,
        log_place=np.log(table.groupby("cause", sort=False)["in_kind"].sum().to_numpy()),
    )


def _log_shares(cat: Catalogue, free: Sequence[int]) -> tuple[Array, float]:
    """Log prior of each candidate given that something is there: named ones share, and nameless ones; and by how much, in the
    log, a fleet makes something likelier to be there. What it says of one candidate's odds leaves those of others alone."""
    own = np.array([cat.log_prior[i] for i in free])
    named = np.array([cat.has_law(i) for i in free], dtype=bool)
    share = prior.UNNAMED_SHARE if not named.all() else 0.0
    out = np.empty(len(free))
    for part, whole in ((named, 1.0 - share), (~named, share)):
        if part.any():
            out[part] = own[part] - logsumexp(own[part]) + np.log(whole)
    if cat.learned is None or not free:
        return out, 0.0
    odds = [cat.learned.log_odds(cat.cause(i)) for i in free]
    if not any(odds):
        return out, 0.0
    out += odds
    more = float(logsumexp(out))
    return out - more, more


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
