"""Small linear problems in full, for laws of the posterior: every matrix that the code avoids is written out here."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product
from math import lgamma
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from truepose.arrays import Array
from truepose.identification.posterior.design import (
    Always,
    Axis,
    Design,
    GridPoint,
    Term,
    Terms,
    Unknowns,
    Urn,
)
from truepose.identification.posterior.spike_slab import NOTICED, Members, SpikeSlab
from truepose.identification.prior import Richness, Sizes

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class Dense:
    """Readings e (r,) of several kinds (r,), columns A (r, n) of every model and G (r, w) of terms."""

    e: Array
    kind: NDArray[np.intp]
    a: Array
    g: Array
    always: Always
    unknowns: Unknowns

    @property
    def design(self) -> Design:
        """The Gram matrices that the code works with."""
        rows = np.column_stack([self.a, self.g, self.e])
        kinds = range(int(self.kind.max()) + 1)
        grams = tuple(rows[self.kind == k].T @ rows[self.kind == k] for k in kinds)
        return Design(grams, tuple(int(np.sum(self.kind == k)) for k in kinds), self.always)

    def sigma(self, point: GridPoint) -> Array:
        """(n,) 1-sigma of the columns of A at a point."""
        factors = np.array([*self.unknowns.widening[point.widening], 1.0])[self.always.part]
        return np.asarray(self.always.sigma * factors)

    def covariance(self, point: GridPoint, columns: Sequence[int] = (), sizes: Sequence[float] = ()) -> Array:
        """(r, r) of e, without what has no prior."""
        noise = [a.values[k] for a, k in zip(self.unknowns.noise, point.noise, strict=True)]
        sigma = self.sigma(point)
        known = np.isfinite(sigma)
        scaled = np.column_stack(
            [self.a[:, known] * sigma[known], self.g[:, list(columns)] * np.array(sizes).reshape(1, -1)]
        )
        return np.asarray(np.diag(np.array(noise)[self.kind] ** 2) + scaled @ scaled.T)

    def precision(self, point: GridPoint, columns: Sequence[int] = (), sizes: Sequence[float] = ()) -> Array:
        """(r, r) inverse of the covariance with flat columns projected out."""
        inverse = np.linalg.inv(self.covariance(point, columns, sizes))
        flat = self.a[:, ~np.isfinite(self.sigma(point))]
        across = inverse @ flat
        return np.asarray(inverse - across @ np.linalg.solve(flat.T @ across, across.T))

    def log_evidence(
        self, point: GridPoint, columns: Sequence[int] = (), sizes: Sequence[float] = ()
    ) -> float:
        """log N(e; 0, V) with flat columns integrated over, less what no model changes; the point's prior is in it."""
        covariance = self.covariance(point, columns, sizes)
        flat = self.a[:, ~np.isfinite(self.sigma(point))]
        inside = flat.T @ np.linalg.solve(covariance, flat)
        log_det = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inside)[1]
        square = self.e @ self.precision(point, columns, sizes) @ self.e
        return float(-0.5 * log_det - 0.5 * square) + self.unknowns.log_prior(point)


def points(unknowns: Unknowns) -> list[GridPoint]:
    """The whole grid."""
    noises = product(*(range(len(a.values)) for a in unknowns.noise))
    widenings = range(len(unknowns.widening))
    return [GridPoint(noise, widening) for noise, widening in product(noises, widenings)]


def axis(*values: float) -> Axis:
    """Values of which each is as likely."""
    return Axis(values, (-float(np.log(len(values))),) * len(values))


UNKNOWNS = Unknowns(
    noise=(axis(0.8, 1.0, 1.4), axis(0.9, 1.2)),
    widening=((1.0, 1.0), (3.0, 1.0), (2.0, 5.0)),
    log_widening=(-0.5, -1.5, -2.0),
)


def random_problem(seed: int, *, readings: int = 30, width: int = 7, flat: int = 1) -> Dense:
    """Two kinds of channels; geometry of two classes, columns without a prior, two of no class; G of width columns."""
    rng = np.random.default_rng(seed)
    sigma = np.array([*rng.uniform(0.3, 3.0, 4), *[np.inf] * flat, 1.0, 1.0])
    n = len(sigma)
    always = Always(sigma, np.array([0, 0, 1, 1, *[-1] * (flat + 2)], dtype=np.intp))
    a, g = rng.standard_normal((readings, n)), rng.standard_normal((readings, width))
    e = rng.standard_normal(readings) + a @ rng.standard_normal(n) + 1.5 * g[:, 0]
    return Dense(e, np.arange(readings) % 3 // 2, a, g, always, UNKNOWNS)


SIZES = Sizes(np.array([0.3, 1.0]), np.log([0.4, 0.6]))
WEIGHT, EQUAL = 2.0, 0.7
"""Of the urns of kinds, and of settings and sizes."""
FURTHER = 0.4
"""Prior odds of a further term of a cause."""


def single(
    *widths: int,
    causes: Sequence[int] | None = None,
    kinds: Sequence[int] | None = None,
    alone: bool = True,
    sizes: Sizes | None = None,
) -> Terms:
    """Terms of so many columns each, in order, without bounds; every one a cause, and every cause a kind, unless said.

    Terms of a cause differ in their setting; so do kinds, and the k-th terms of causes of one kind are alike.
    """
    ends = np.cumsum([0, *widths])
    own = list(range(len(widths))) if causes is None else list(causes)
    kind = np.arange(max(own) + 1) if kinds is None else np.array(kinds)
    numbered = [(int(kind[c]), own[:k].count(c)) for k, c in enumerate(own)]
    features = list(dict.fromkeys(numbered))
    of_kind = np.bincount(kind[own])
    return Terms(
        [
            Term(
                tuple(range(a, b)), cause, features.index(feature), -float(np.log(of_kind[feature[0]])),
                (-np.inf,) * (b - a), (np.inf,) * (b - a), alone, group=int(kind[cause]),
            )
            for (a, b), cause, feature in zip(pairwise(ends.tolist()), own, numbered, strict=True)
        ],
        Urn(
            kind=kind,
            share=of_kind / len(own),
            number=np.bincount(kind),
            feature_kind=np.array([k for k, _ in features]),
            feature_share=np.array([numbered.count(f) / of_kind[f[0]] for f in features]),
            log_size=np.tile((sizes or SIZES).log_prior, (len(of_kind), 1)),
            weight=WEIGHT,
            alike=EQUAL,
            further=FURTHER,
            log_place=np.log([own.count(c) / of_kind[kind[c]] for c in range(len(kind))]),
        ),
    )  # fmt: skip


RICHNESS = Richness((0.05, 0.3), (float(np.log(0.6)), float(np.log(0.4))), 8)
FEW = Unknowns(
    noise=(Axis((0.8, 1.0, 1.3), (-1.5, -0.5, -1.5)),),
    widening=((1.0,), (4.0,)),
    log_widening=(-0.3, -1.4),
)


def catalogue_problem(seed: int, *, strength: float = 0.8, alike: float = 0.85, terms: int = 6) -> Dense:
    """Six columns of terms, two and two alike, in 40 readings; some of them are there, none of them clearly."""
    rng, readings = np.random.default_rng(seed), 40
    g = rng.standard_normal((readings, terms))
    for k in range(1, terms, 2):
        g[:, k] = alike * g[:, k - 1] + np.sqrt(1.0 - alike**2) * g[:, k]
    a = rng.standard_normal((readings, 4))
    always = Always(np.array([1.0, 0.5, np.inf, 1.0]), np.array([0, 0, -1, -1], dtype=np.intp))
    there = strength * rng.standard_normal(terms) * (rng.random(terms) < 0.5)
    e = rng.standard_normal(readings) + a[:, :2] @ rng.standard_normal(2) + g @ there
    return Dense(e, np.zeros(readings, dtype=np.intp), a, g, always, FEW)


def spike_slab(dense: Dense, terms: Terms | None = None, sizes: Sizes = SIZES) -> SpikeSlab:
    """A problem of the terms, or of one for each column."""
    own = single(*[1] * dense.g.shape[1]) if terms is None else terms
    return SpikeSlab(dense.design, dense.unknowns, own, sizes)


@dataclass(frozen=True)
class Enumerated:
    """Exact probability of each state: terms in order with their sizes, and the point."""

    states: Mapping[tuple[Members, GridPoint], float]
    count: int

    @property
    def terms(self) -> Array:
        """(c,) of each term."""
        out = np.zeros(self.count)
        for (members, _), share in self.states.items():
            out[[term for term, _ in members]] += share
        return out

    @property
    def sets(self) -> Mapping[tuple[int, ...], float]:
        """Of each set of terms."""
        return _summed((tuple(term for term, _ in members), p) for (members, _), p in self.states.items())

    @property
    def points(self) -> Mapping[GridPoint, float]:
        """Of each point."""
        return _summed((point, share) for (_, point), share in self.states.items())

    def given(self, members: Members) -> Enumerated:
        """Of the states that hold these members, among themselves."""
        own = {state: share for state, share in self.states.items() if set(members) <= set(state[0])}
        total = sum(own.values())
        return Enumerated({state: share / total for state, share in own.items()}, self.count)


def _summed(pairs: Iterable[tuple[Key, float]]) -> dict[Key, float]:
    out: dict[Key, float] = {}
    for key, share in pairs:
        out[key] = out.get(key, 0.0) + share
    return out


def enumerated(spike_slab: SpikeSlab, richness: Richness, dense: Dense) -> Enumerated:
    """Every set of terms at every size at every point, by dense densities and the prior written out."""
    terms, sizes = spike_slab.terms, spike_slab.sizes
    weights: dict[tuple[Members, GridPoint], float] = {}
    noticed = _noticed(spike_slab, dense)
    for count in range(min(len(terms), richness.slots) + 1):
        number = float(logsumexp(richness.log_weights(count)))
        number += lgamma(richness.slots + 1) - lgamma(richness.slots - count + 1)
        for chosen in combinations(range(len(terms)), count):
            if any(terms.excludes[i, j] for i, j in combinations(chosen, 2)):
                continue
            columns = [int(c) for k in chosen for c in terms.columns[k]]
            for own in product(range(len(sizes.values)), repeat=count):
                if not all(noticed[s, k] for k, s in zip(chosen, own, strict=True)):
                    continue
                spread = [sizes.values[s] for k, s in zip(chosen, own, strict=True) for _ in terms.columns[k]]
                prior = number + drawn(terms, tuple(zip(chosen, own, strict=True)))
                for point in points(spike_slab.unknowns):
                    members = tuple(zip(chosen, own, strict=True))
                    weights[members, point] = prior + dense.log_evidence(point, columns, spread)
    top = float(logsumexp(list(weights.values())))
    states = {state: float(np.exp(weight - top)) for state, weight in weights.items()}
    return Enumerated(states, len(terms))


def _noticed(spike_slab: SpikeSlab, dense: Dense) -> NDArray[np.bool_]:
    """(s, c) which terms make a signal of more than two sigma at which size, at the noise nearest to that stated."""
    stated = [int(np.argmin([abs(np.log(v)) for v in axis.values])) for axis in spike_slab.unknowns.noise]
    seen = dense.g.T @ dense.precision(GridPoint(tuple(stated), 0)) @ dense.g
    signal = [sum(seen[c, c] for c in columns) for columns in spike_slab.terms.columns]
    return np.asarray(np.outer(spike_slab.sizes.values**2, signal) > NOTICED)


def drawn(terms: Terms, members: Members) -> float:
    """Log prior of terms at their sizes: one after the other drawn from their urns, as the book has it."""
    urn, out, before = terms.urn, 0.0, list[tuple[int, int]]()
    grown = sum(float(urn.share[k]) for k in range(len(urn.share)) if urn.number[k] > 1)
    seen = list[int]()
    for k, size in members:
        own = terms.all[k]
        kind = int(urn.kind[own.cause])
        alike = [m for m in before if urn.kind[terms.all[m[0]].cause] == kind] if urn.number[kind] > 1 else []
        same = sum(terms.all[t].feature == own.feature for t, _ in alike)
        equal = sum(s == size for _, s in alike)
        share, base = float(urn.share[kind]), float(urn.feature_share[own.feature])
        out += np.log((EQUAL * base + same) / (EQUAL + len(alike))) + own.log_share - np.log(base)
        out += np.log((EQUAL * np.exp(urn.log_size[kind, size]) + equal) / (EQUAL + len(alike)))
        if own.cause in seen:
            out += np.log(FURTHER) - urn.log_place[own.cause]
        elif urn.number[kind] == 1:
            out += np.log(share)
        else:
            growing = [c for c in seen if urn.number[urn.kind[c]] > 1]
            of_kind = sum(urn.kind[c] == kind for c in growing)
            out += np.log(grown * (WEIGHT * share / grown + of_kind) / (WEIGHT + len(growing)))
            out += np.log(urn.number[kind] / (urn.number[kind] - of_kind))
        before.append((k, size))
        seen += [own.cause] if own.cause not in seen else []
    return float(out)


def reordered(dense: Dense, order: Sequence[int]) -> Dense:
    """The same problem with the columns of terms in another order."""
    return replace(dense, g=dense.g[:, list(order)])
