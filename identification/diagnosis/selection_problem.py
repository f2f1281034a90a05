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
from truepose.models.machine.placed import EffectAtPlace

FAINT = 0.3
"""Information, in units of its prior's, below which a direction of the errors of form is left out."""
FLAT = 0.1
"""Variance that a direction of the remainder adds to all readings, at a remainder of one sigma, below which it is left out."""


@dataclass(frozen=True)
class SelectionProblem:
    """The posterior's problem, and what its numbers mean.

    candidates: for each term the one of the catalogue that it is; causes: by number; classes: of parts, in the order of
    the grid's widenings; richness: how many terms machines have.
    remainder (c, r): turns its r directions into coefficients of ``nameless`` (c,), columns of G.
    """

    spike_slab: SpikeSlab
    candidates: tuple[int, ...]
    causes: tuple[EffectAtPlace, ...]
    classes: tuple[PartClass, ...]
    richness: prior.Richness
    nameless: Index
    remainder: Array


def selection_problem(lin: Linearisation, cat: Catalogue, rms: float) -> SelectionProblem:
    """``rms`` of the whitened residual of the ordinary fit bounds the noise and the remainder."""
    nameless = np.array(lin.indices(cat.smooth), dtype=np.intp)
    turn = _remainder(lin, cat, nameless)
    free = tuple(i for i in range(len(cat.candidates)) if i not in cat.stated)
    shares, more = _log_shares(cat, free)
    causes, terms = _terms(cat, lin, free, shares)
    classes = tuple(dict.fromkeys(lin.parts))
    unknowns = Unknowns.over(len(lin.grams), rms, widenings(classes), rms if turn.shape[1] else 0.0)
    spike_slab = SpikeSlab(_design(lin, cat, classes, nameless, turn), unknowns, terms, prior.SIZES)
    richness = prior.RICHNESS.scaled(more)
    return SelectionProblem(spike_slab, free, causes, classes, richness, nameless, turn)


def _remainder(lin: Linearisation, cat: Catalogue, nameless: Index) -> Array:
    """(c, r) the remainder: the robot's nameless forms all at once, sharing one variance in the readings; its directions that
    are seen."""
    if not len(nameless):
        return np.zeros((0, 0))
    at = lin.free + nameless
    gram = lin.among(at)
    rms = np.sqrt(np.diag(gram) / lin.n_observations)
    sizes = [len(cat.candidates[i].coefficients) for i in cat.smooth]
    share = np.concatenate([np.full(k, (k * len(sizes)) ** -0.5) for k in sizes])
    seen = rms > 1e-9 * np.max(rms)
    scale = np.where(seen, share / np.where(seen, rms, 1.0), 0.0)
    values, vectors = np.linalg.eigh(gram * scale[:, None] * scale)
    return np.asarray(scale[:, None] * vectors[:, values > FLAT])


def design_with_forms(
    lin: Linearisation, cat: Catalogue, problem: SelectionProblem, columns: Index
) -> Design:
    """The design of a problem with some of its columns of G (k,) alone, and the errors of form behind them."""
    width = lin.columns[-1].stop
    wanted = np.concatenate([columns, np.arange(width, width + lin.forms)]).astype(np.intp)
    return _design(lin, cat, problem.classes, problem.nameless, problem.remainder, wanted)


def _design(
    lin: Linearisation, cat: Catalogue, classes: Sequence[PartClass], nameless: Index, turn: Array,
    wanted: Index | None = None,
) -> Design:  # fmt: skip
    """Columns of every model (geometry, what the file states, errors of form, remainder), of terms, and the residual.

    ``wanted``: columns of [G F] that stand for those of terms, by default all of G.
    """
    n, width = lin.free, lin.columns[-1].stop if lin.columns else 0
    stated = n + np.array(lin.indices(cat.stated), dtype=np.intp)
    forms = n + width + np.arange(lin.forms)
    noise = max(sum(float(gram[-1, -1]) for gram in lin.grams) / lin.n_observations, 1.0)
    bend = np.zeros((0, 0))
    if lin.forms:  # the directions that readings see, of coefficients N(0, 1)
        values, vectors = np.linalg.eigh(lin.among(forms) / noise)
        bend = vectors[:, values > FAINT]
    fixed = np.concatenate([np.arange(n), stated]).astype(np.intp)
    mixed = np.zeros((len(lin.grams[0]), bend.shape[1] + turn.shape[1] + 1))
    mixed[forms, : bend.shape[1]] = bend
    mixed[n + nameless, bend.shape[1] : -1] = turn
    # e: the residual at the drawing values without effects, as a reading less its prediction
    mixed[:-1, -1], mixed[-1, -1] = lin.departure, -1.0
    picked = np.concatenate([fixed, n + (np.arange(width) if wanted is None else wanted)]).astype(np.intp)
    own = np.divide(1.0, lin.weight, out=np.full(n, np.inf), where=lin.weight > 0.0)
    sigma = np.concatenate([own, np.full(len(stated), prior.STATED), np.ones(mixed.shape[1] - 1)])
    numbers = [classes.index(part) for part in lin.parts]
    part = np.array([*numbers, *[-1] * (len(sigma) - n)], dtype=np.intp)
    always = Always(sigma, part, np.arange(len(sigma)) >= len(fixed) + bend.shape[1])
    return Design(tuple(_turned(gram, picked, len(fixed), mixed) for gram in lin.grams), lin.counts, always)


def _turned(gram: Array, picked: Index, first: int, mixed: Array) -> Array:
    """The Gram matrix of the first ``picked`` columns, the ``mixed`` ones but the last, the other picked ones, the last."""
    product = gram @ mixed
    r, p = mixed.shape[1] - 1, len(picked)
    here = np.concatenate([np.arange(first), np.arange(first + r, p + r)])
    there = np.append(np.arange(first, first + r), p + r)
    out = np.empty((p + r + 1,) * 2)
    out[np.ix_(here, here)] = gram[np.ix_(picked, picked)]
    out[np.ix_(here, there)] = product[picked]
    out[np.ix_(there, here)] = product[picked].T
    out[np.ix_(there, there)] = mixed.T @ product
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
    share = np.log(table["in_kind"].to_numpy())
    terms = list[Term]()
    for k, (i, one) in enumerate(zip(free, placed, strict=True)):
        columns, numbers = tuple(lin.indices([i])), (int(number[k]), int(feature[k]), float(share[k]))
        seen = one.coefficients[: len(columns)]
        lower, upper = tuple(c.lower / c.scale for c in seen), tuple(c.upper / c.scale for c in seen)
        alone = cat.named(i) and not one.effect.adds(one.settings_map)
        terms.append(Term(columns, *numbers, lower, upper, alone, len(one.coefficients)))
    return tuple(causes), Terms(terms, _urn(table, cat.learned))


def _kind(cat: Catalogue, index: int) -> str:
    """What has a name is likelier where its like is; what has none is like nothing else but at its own place.

    An effect of several parts at once is another kind than that of parts alone: it says the same of them once more.
    """
    placed = cat.candidates[index]
    if not cat.named(index):
        return placed.label.partition(",")[0]
    return f"{placed.effect.slug} of {len(placed.place)}"


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
    named = np.array([cat.named(i) for i in free], dtype=bool)
    share = prior.UNNAMED_SHARE if not named.all() else 0.0
    out = np.empty(len(free))
    for part, whole in ((named, 1.0 - share), (~named, share)):
        if part.any():
            out[part] = own[part] - logsumexp(own[part]) + np.log(whole)
    if cat.learned is None or not free:
        return out, 0.0
    out += [cat.learned.log_odds(cat.cause(i)) for i in free]
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
