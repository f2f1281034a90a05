"""What a recording says of every effect at every place, free of the prior it was weighed with: for a fleet's statistics.

``diagnose(..., examine=evidence)`` has it in ``Diagnosis.examined``.

The log Bayes factor of a cause is its posterior log odds less its prior ones. Prior odds depend on what else is there (how
rich the machine is, what is alike); they are averaged over the posterior's states, each without the cause:

    ln B = logit P - logit p,   p = sum over states of their share times P(cause | the rest of the state)

Sizes that nobody would notice here are no part of P, and none of p. Of all sizes together ln (u + (1 - u) B) remains, with u
their prior share: where nothing would be noticed, nothing is said.

Rivals share what they explain: where a slot of the posterior may hold one of several, each of them has a Bayes factor that is
large, but they are not all there. ``credit`` is a cause's share of its slots.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.posterior_summary import Inclusion
from truepose.identification.diagnosis.search import Found
from truepose.identification.posterior.spike_slab import Members
from truepose.identification.posterior.state import State, moments, slot_odds, typical

STATES, MOMENTS = 24, 6
"""States of the posterior that prior odds are averaged over, and those that sizes are taken from."""
SMALLEST, LARGEST = -12.0, 15.0
"""Log Bayes factors beyond which a chain of some hundred sweeps tells no more. Chosen."""
THERE = 0.02
"""Probability from which on sizes are told."""


@dataclass(frozen=True)
class Amount:
    """How large an effect is, given that it is there: mean and 1-sigma of the log of its rms coefficient in units of the
    largest expected one, and the same mean in its ``unit``, which is empty where coefficients have several."""

    log_mean: float
    log_std: float
    log_amount: float
    unit: str


@dataclass(frozen=True)
class PlaceEvidence:
    """What is said of an effect at a place (at any, where ``place`` is empty), and what of that the recording said.

    probability, prior: that it is there, after and before; log_bayes_factor: of it at the sizes that would be noticed against
    nothing, free of the prior; unseen: prior share of the other sizes; credit: its share among the explanations of what it
    would explain; sizes: how probable each size of the slab is.
    """

    effect: str
    place: tuple[str, ...]
    probability: float
    prior: float
    log_bayes_factor: float
    unseen: float
    credit: float = 1.0
    sizes: tuple[float, ...] = ()
    size: Amount | None = None


@dataclass(frozen=True)
class _Odds:
    """Log prior odds (n,) of each cause beside a state's other members: at any size, and at sizes that would be noticed."""

    whole: Array
    noticed: Array


def evidence(found: Found, said: Inclusion) -> tuple[tuple[PlaceEvidence, ...], tuple[PlaceEvidence, ...]]:
    """Of each effect at each place, and of each effect at any of its places."""
    problem = found.problem
    causes, states = problem.causes, typical(found.posterior.states, STATES)
    raw = np.asarray(found.posterior.causes)
    own = np.array([said.places.get(c, p) for c, p in zip(causes, raw.tolist(), strict=True)])
    sizes, amounts = _sizes(found), _amounts(found)
    slugs = list(dict.fromkeys(c.effect for c in causes))
    slug = np.array([slugs.index(c.effect) for c in causes], dtype=np.intp)
    prior, noticed, any_prior, any_noticed = np.zeros((4, len(causes)))
    for state, share in states:
        beside = _Beside(found, state)
        alone = [beside.without({k}) for k in range(len(causes))]
        prior += share * expit([odds.whole[k] for k, odds in enumerate(alone)])
        noticed += share * expit([odds.noticed[k] for k, odds in enumerate(alone)])
        for j in range(len(slugs)):
            at = np.flatnonzero(slug == j)
            odds = beside.without(set(at.tolist()))
            any_prior[j] += share * _any(odds.whole[at])
            any_noticed[j] += share * _any(odds.noticed[at])
    credit, any_credit = _credits(found, slug, own)
    present = _present(found, slug, len(slugs), own, raw)
    places = tuple(
        _told(*causes[k], (own[k], prior[k], noticed[k]), credit[k], sizes[k], amounts.get(k))
        for k in range(len(causes))
    )
    anywhere = tuple(
        _told(name, (), (present[j], any_prior[j], any_noticed[j]), any_credit[j], np.zeros(0), None)
        for j, name in enumerate(slugs)
    )
    return places, anywhere


def _any(log_odds: Array) -> float:
    """Probability of one at least."""
    return float(-np.expm1(-np.sum(np.logaddexp(0.0, log_odds))))


def _told(
    effect: str, place: tuple[str, ...], chances: tuple[float, float, float], credit: float, sizes: Array,
    amount: Amount | None,
) -> PlaceEvidence:  # fmt: skip
    """``chances``: its probability, the prior one, and that at sizes which would be noticed."""
    probability, prior, noticed = chances
    least = 1e-12
    unseen = 1.0 - float(np.clip(noticed / max(prior, least), 0.0, 1.0))
    ends = np.clip([probability, noticed], least, 1.0 - least)
    factor = float(np.clip(logit(ends[0]) - logit(ends[1]), SMALLEST, LARGEST)) if noticed > least else 0.0
    there = probability > THERE and sizes.sum() > 0.0
    return PlaceEvidence(
        effect=effect,
        place=tuple(place),
        probability=float(probability),
        prior=float(prior),
        log_bayes_factor=factor,
        unseen=unseen,
        credit=float(credit),
        sizes=tuple((sizes / sizes.sum()).tolist()) if there else (),
        size=amount if there else None,
    )


def _credits(found: Found, slug: Index, own: Array) -> tuple[Array, Array]:
    """Share (n,) of each cause of what its slots may hold; and (e,) of each effect, its places weighed by how probable they
    are. What no slot held has no rivals."""
    beside = found.posterior.beside
    held = beside.sum(axis=1)
    some = np.where(held > 0.0, held, 1.0)
    alone = np.where(held > 0.0, np.diag(beside) / some, 1.0)
    alike = np.where(held > 0.0, np.sum(beside * (slug[:, None] == slug), axis=1) / some, 1.0)
    weight, count = np.maximum(own, 1e-12), int(slug.max(initial=-1)) + 1
    summed = np.bincount(slug, weights=weight * alike, minlength=count)
    return alone, summed / np.bincount(slug, weights=weight, minlength=count)


class _Beside:
    """Prior odds of causes beside the members of a state, without some of them."""

    def __init__(self, found: Found, state: State) -> None:
        self._problem, self._members = found.problem, state.members
        self._cause = found.problem.spike_slab.terms.cause
        self._known = dict[Members, _Odds]()

    def without(self, causes: set[int]) -> _Odds:
        """Beside the members that are of no such cause."""
        rest = tuple(m for m in self._members if int(self._cause[m[0]]) not in causes)
        if rest not in self._known:
            self._known[rest] = self._odds(rest)
        return self._known[rest]

    def _odds(self, rest: Members) -> _Odds:
        spike_slab = self._problem.spike_slab
        by_size = spike_slab.terms.log_prior(rest) + slot_odds(self._problem.richness, len(rest))
        return _Odds(self._summed(by_size), self._summed(np.where(spike_slab.noticeable, by_size, -np.inf)))

    def _summed(self, by_size: Array) -> Array:
        out = np.full(len(self._problem.causes), -np.inf)
        np.logaddexp.at(out, self._cause, np.logaddexp.reduce(by_size, axis=0))
        return out


def _present(found: Found, slug: Index, count: int, own: Array, raw: Array) -> Array:
    """(count,) probability of each effect anywhere, less what is only like it: as its likeliest place has it."""
    cause, out = found.problem.spike_slab.terms.cause, np.zeros(count)
    for state, share in found.posterior.states:
        out[np.unique(slug[cause[[t for t, _ in state.members]]])] += share
    for j in range(count):
        at = np.flatnonzero(slug == j)
        best = at[np.argmax(raw[at])]
        out[j] = max(out[j] * min(own[best] / max(raw[best], 1e-300), 1.0), own[at].max())
    return np.minimum(out, 1.0)


def _sizes(found: Found) -> Array:
    """(n, s) probability of each cause at each size."""
    spike_slab = found.problem.spike_slab
    out = np.zeros((len(found.problem.causes), len(spike_slab.sizes.values)))
    for state, share in found.posterior.states:
        for term, size in state.members:
            out[spike_slab.terms.cause[term], size] += share
    return out


def _amounts(found: Found) -> Mapping[int, Amount]:
    """Size of each cause that is in one of some typical states, averaged over these."""
    drawn: dict[int, list[tuple[float, float, float, float, str]]] = {}
    for state, share in typical(found.posterior.states, MOMENTS):
        for cause, size in _of_state(found, state):
            drawn.setdefault(cause, []).append((share, *size))
    return {cause: _averaged(every) for cause, every in drawn.items()}


def _averaged(every: list[tuple[float, float, float, float, str]]) -> Amount:
    weight, mean, std, amount = (np.array([one[k] for one in every], dtype=float) for k in range(4))
    weight /= weight.sum()
    centre = float(weight @ mean)
    spread = float(np.sqrt(weight @ (std**2 + (mean - centre) ** 2)))
    return Amount(centre, spread, float(weight @ amount), every[0][4])


def _of_state(found: Found, state: State) -> Iterator[tuple[int, tuple[float, float, float, str]]]:
    """Of each cause of a state, the fields of its ``Amount``."""
    problem, spike_slab = found.problem, found.problem.spike_slab
    if not state.members:
        return
    known = moments(spike_slab, state)
    columns, _ = spike_slab.columns(state.members)
    first = len(known.at) - len(columns)
    term = np.repeat(
        [t for t, _ in state.members], [len(spike_slab.terms.columns[t]) for t, _ in state.members]
    )
    owner = spike_slab.terms.cause[term]
    coefficients = [
        c
        for t, _ in state.members
        for c in found.catalogue.candidates[problem.candidates[t]].coefficients[
            : len(spike_slab.terms.columns[t])
        ]
    ]
    for cause in np.unique(owner):
        at = np.flatnonzero(owner == cause)
        mean, variance = known.mean[first + at], np.diag(known.covariance)[first + at]
        square = np.maximum(mean**2, 1e-300)
        std = np.sqrt(square @ variance) / square.sum()
        units = {coefficients[k].unit for k in at}
        scale = np.array([coefficients[k].scale for k in at])
        rms = 0.5 * np.log(np.mean(square + variance))
        amount = 0.5 * np.log(np.mean((square + variance) * scale**2))
        yield (
            int(cause),
            (float(rms), float(min(std, 3.0)), float(amount), units.pop() if len(units) == 1 else ""),
        )
