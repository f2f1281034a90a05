"""Small linear problems in full, for laws of the posterior: every matrix that the code avoids is written out here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product
from math import lgamma

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from truepose.identification.posterior.conditional import Sizes
from truepose.identification.posterior.design import Always, Axis, Design, Point, Unknowns
from truepose.identification.posterior.sampler import Richness
from truepose.identification.posterior.terms import Term, Terms
from truepose.identification.posterior.weighing import NOTICED, Members, Weighing

Array = NDArray[np.float64]


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

    def sigma(self, point: Point) -> Array:
        """(n,) 1-sigma of the columns of A at a point."""
        *_, widening, size = point
        factors = np.array([*self.unknowns.widening[widening], 1.0])[self.always.part]
        tau = self.unknowns.size.values[size]
        return np.asarray(self.always.sigma * np.where(self.always.remainder, tau, factors))

    def covariance(self, point: Point, columns: Sequence[int] = (), sizes: Sequence[float] = ()) -> Array:
        """(r, r) of e, without what has no prior."""
        noise = [a.values[k] for a, k in zip(self.unknowns.noise, point[:-2], strict=True)]
        sigma = self.sigma(point)
        known = np.isfinite(sigma)
        scaled = np.column_stack(
            [self.a[:, known] * sigma[known], self.g[:, list(columns)] * np.array(sizes).reshape(1, -1)]
        )
        return np.asarray(np.diag(np.array(noise)[self.kind] ** 2) + scaled @ scaled.T)

    def precision(self, point: Point, columns: Sequence[int] = (), sizes: Sequence[float] = ()) -> Array:
        """(r, r) inverse of the covariance with flat columns projected out."""
        inverse = np.linalg.inv(self.covariance(point, columns, sizes))
        flat = self.a[:, ~np.isfinite(self.sigma(point))]
        across = inverse @ flat
        return np.asarray(inverse - across @ np.linalg.solve(flat.T @ across, across.T))

    def log_evidence(self, point: Point, columns: Sequence[int] = (), sizes: Sequence[float] = ()) -> float:
        """log N(e; 0, V) with flat columns integrated over, less what no model changes; the point's prior is in it."""
        covariance = self.covariance(point, columns, sizes)
        flat = self.a[:, ~np.isfinite(self.sigma(point))]
        inside = flat.T @ np.linalg.solve(covariance, flat)
        log_det = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inside)[1]
        square = self.e @ self.precision(point, columns, sizes) @ self.e
        return float(-0.5 * log_det - 0.5 * square) + self.unknowns.log_prior(point)


def points(unknowns: Unknowns) -> list[Point]:
    """The whole grid."""
    return list(product(*(range(n) for n in unknowns.shape)))


def axis(*values: float) -> Axis:
    """Values of which each is as likely."""
    return Axis(values, (-float(np.log(len(values))),) * len(values))


UNKNOWNS = Unknowns(
    noise=(axis(0.8, 1.0, 1.4), axis(0.9, 1.2)),
    widening=((1.0, 1.0), (3.0, 1.0), (2.0, 5.0)),
    log_widening=(-0.5, -1.5, -2.0),
    size=Axis((0.0, 0.5, 2.0), (-0.7, -1.4, -1.4)),
)


def random_problem(seed: int, *, readings: int = 30, width: int = 7, flat: int = 1) -> Dense:
    """Two kinds of channels; geometry of two classes, columns without a prior, two of a remainder; G of width columns."""
    rng = np.random.default_rng(seed)
    sigma = np.array([*rng.uniform(0.3, 3.0, 4), *[np.inf] * flat, 1.0, 1.0])
    n = len(sigma)
    always = Always(sigma, np.array([0, 0, 1, 1, *[-1] * (flat + 2)], dtype=np.intp), np.arange(n) >= n - 2)
    a, g = rng.standard_normal((readings, n)), rng.standard_normal((readings, width))
    e = rng.standard_normal(readings) + a @ rng.standard_normal(n) + 1.5 * g[:, 0]
    return Dense(e, np.arange(readings) % 3 // 2, a, g, always, UNKNOWNS)


def single(*widths: int, causes: Sequence[int] | None = None, alone: bool = True) -> Terms:
    """Terms of so many columns each, in order, without bounds; every one a cause of its own unless said."""
    ends = np.cumsum([0, *widths])
    own = range(len(widths)) if causes is None else causes
    free = [((-np.inf,) * w, (np.inf,) * w) for w in widths]
    share = -float(np.log(len(widths)))
    return Terms(
        [
            Term(tuple(range(a, b)), cause, share, share + 1.0, low, high, alone)
            for (a, b), cause, (low, high) in zip(pairwise(ends.tolist()), own, free, strict=True)
        ]
    )


RICHNESS = Richness((0.05, 0.3), (float(np.log(0.6)), float(np.log(0.4))), 8)
SIZES = Sizes(np.array([0.3, 1.0]), np.log([0.4, 0.6]))
FEW = Unknowns(
    noise=(Axis((0.8, 1.0, 1.3), (-1.5, -0.5, -1.5)),),
    widening=((1.0,), (4.0,)),
    log_widening=(-0.3, -1.4),
    size=Axis((0.0, 1.0), (-0.7, -0.7)),
)


def catalogue_problem(seed: int, *, strength: float = 0.8, alike: float = 0.85, terms: int = 6) -> Dense:
    """Six columns of terms, two and two alike, in 40 readings; some of them are there, none of them clearly."""
    rng, readings = np.random.default_rng(seed), 40
    g = rng.standard_normal((readings, terms))
    for k in range(1, terms, 2):
        g[:, k] = alike * g[:, k - 1] + np.sqrt(1.0 - alike**2) * g[:, k]
    a = rng.standard_normal((readings, 4))
    always = Always(
        np.array([1.0, 0.5, np.inf, 1.0]), np.array([0, 0, -1, -1], dtype=np.intp), np.arange(4) == 3
    )
    there = strength * rng.standard_normal(terms) * (rng.random(terms) < 0.5)
    e = rng.standard_normal(readings) + a[:, :2] @ rng.standard_normal(2) + g @ there
    return Dense(e, np.zeros(readings, dtype=np.intp), a, g, always, FEW)


@dataclass(frozen=True)
class Enumerated:
    """Exact probabilities: of each term, of each set of terms, of each point."""

    terms: Array
    sets: Mapping[tuple[int, ...], float]
    points: Mapping[Point, float]


def enumerated(weighing: Weighing, richness: Richness, dense: Dense) -> Enumerated:
    """Every set of terms at every size at every point, by dense densities and the prior written out."""
    terms, sizes = weighing.terms, weighing.sizes
    weights: dict[tuple[Members, Point], float] = {}
    noticed = _noticed(weighing, dense)
    for count in range(len(terms) + 1):
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
                prior = number + _first_pays(terms, chosen) + float(np.sum(sizes.log_prior[list(own)]))
                for point in points(weighing.unknowns):
                    members = tuple(zip(chosen, own, strict=True))
                    weights[members, point] = prior + dense.log_evidence(point, columns, spread)
    top = float(logsumexp(list(weights.values())))
    inclusion = np.zeros(len(terms))
    sets: dict[tuple[int, ...], float] = {}
    grid: dict[Point, float] = {}
    for (members, point), weight in weights.items():
        share, chosen = float(np.exp(weight - top)), tuple(k for k, _ in members)
        inclusion[list(chosen)] += share
        sets[chosen] = sets.get(chosen, 0.0) + share
        grid[point] = grid.get(point, 0.0) + share
    return Enumerated(inclusion, sets, grid)


def _noticed(weighing: Weighing, dense: Dense) -> NDArray[np.bool_]:
    """(s, c) which terms make a signal of more than two sigma at which size, at the noise nearest to that stated."""
    stated = [int(np.argmin([abs(np.log(v)) for v in axis.values])) for axis in weighing.unknowns.noise]
    seen = dense.g.T @ dense.precision((*stated, 0, 0)) @ dense.g
    signal = [sum(seen[c, c] for c in columns) for columns in weighing.terms.columns]
    return np.asarray(np.outer(weighing.sizes.values**2, signal) > NOTICED)


def _first_pays(terms: Terms, chosen: Sequence[int]) -> float:
    """Log prior of terms together: the first of a cause pays for it."""
    out, seen = 0.0, set[int]()
    for k in chosen:
        own = terms.all[k]
        out += own.log_further if own.cause in seen else own.log_prior
        seen.add(own.cause)
    return out


def reordered(dense: Dense, order: Sequence[int]) -> Dense:
    """The same problem with the columns of terms in another order."""
    return replace(dense, g=dense.g[:, list(order)])
