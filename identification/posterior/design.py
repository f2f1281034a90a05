"""The linear model as sums over its readings, and the grid of what is not known of its noise and priors.

    e = A a + G c + noise,   noise ~ N(0, k^2) for each kind of channel,   a ~ N(0, (l s)^2),   c ~ N(0, q^2)

e: whitened residual at the drawing. A: what every model has, geometry under its tolerances. G: columns of the terms. Only
Gram matrices of [A G e] are needed.

What may be part of a linear model, as columns with prior odds: all that the posterior knows of physics.

Polya urns: what is part of a set already makes its like likelier (Blackwell and MacQueen 1973, Ann. Statist. 1:353).

Causes come in kinds, every kind with some features (its settings) and sizes. Each is drawn from an urn of its own:

    p(next is k | counts m) = (w b_k + m_k) / (w + sum m),   b: prior shares, w: how many draws they count for

so where one gear errs the others may well, alike in period and size. A cause is not drawn twice: the more of a kind are
there, the fewer places are left to each further one. Kinds of a single cause have no like, and no part in any of this.
Integrated over the unknown shares this is a Dirichlet-multinomial, in which the order of draws does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.special import gammaln

from truepose.arrays import Array, Index, Mask
from truepose.identification import prior

UNSEEN = 1e-9
"""Share of a column's own length below which what is left of it is rounding."""


@dataclass(frozen=True)
class Always:
    """The columns A (n,) of every model: 1-sigma of each (inf: no prior), and its class of parts, -1 for none."""

    sigma: Array
    part: Index


@dataclass(frozen=True)
class Design:
    """Gram matrices (n + w + 1 square) of [A G e] for each kind of channel, with the number of readings of each."""

    grams: tuple[Array, ...]
    counts: tuple[int, ...]
    always: Always

    @cached_property
    def seen(self) -> Mask:
        """(w,) columns of terms of which those of A without a prior leave more than rounding."""
        flat = np.flatnonzero(~np.isfinite(self.always.sigma))
        gram = np.asarray(sum(self.grams[1:], self.grams[0]))
        length = np.diag(gram)[self.n : -1]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(gram)[flat], 1e-300))
        own = gram[np.ix_(flat, flat)] * scale[:, None] * scale + 1e-12 * np.eye(len(flat))
        across = gram[flat, self.n : -1] * scale[:, None]
        half = np.linalg.solve(np.linalg.cholesky(own), across) if len(flat) else across
        return np.asarray((length > 0.0) & (length - np.sum(half**2, axis=0) > UNSEEN * length))

    def restricted(self, columns: Index) -> Design:
        """With some columns of terms only."""
        keep = np.concatenate([np.arange(self.n), self.n + columns, [self.n + self.width]])
        part = Design(tuple(gram[np.ix_(keep, keep)] for gram in self.grams), self.counts, self.always)
        part.__dict__["seen"] = self.seen[columns]
        return part

    def turned(self, columns: Index, turn: Array) -> Design:
        """With combinations of some columns of terms in their place: ``turn`` (k, w) of ``columns`` (k,), mostly zeros."""
        first, last, few = np.arange(self.n), self.n + self.width, csr_array(turn)

        def of(gram: Array) -> Array:
            part = np.asarray(gram[:, self.n + columns] @ few)
            own = np.asarray(few.T @ part[self.n + columns])
            rest = np.append(first, last)
            out = np.empty((self.n + turn.shape[1] + 1,) * 2)
            here, there = np.append(first, len(out) - 1), np.arange(self.n, len(out) - 1)
            out[np.ix_(here, here)] = gram[np.ix_(rest, rest)]
            out[np.ix_(here, there)] = part[rest]
            out[np.ix_(there, here)] = part[rest].T
            out[np.ix_(there, there)] = own
            return out

        return Design(tuple(of(gram) for gram in self.grams), self.counts, self.always)

    @property
    def n(self) -> int:
        """Number of columns that every model has."""
        return len(self.always.sigma)

    @property
    def width(self) -> int:
        """Number of columns of all terms."""
        return len(self.grams[0]) - self.n - 1


@dataclass(frozen=True)
class Axis:
    """Values of one unknown, with the log prior of each."""

    values: tuple[float, ...]
    log_prior: tuple[float, ...]


class GridPoint(NamedTuple):
    """Indices on the axes of a grid: the noise of each kind of channel, and the widening of tolerances."""

    noise: tuple[int, ...]
    widening: int

    def louder(self, steps: int) -> GridPoint:
        """The noise of all kinds moved by so many steps."""
        return self._replace(noise=tuple(k + steps for k in self.noise))

    def widened(self, widening: int) -> GridPoint:
        """Another widening of tolerances."""
        return self._replace(widening=widening)

    def with_noise(self, kind: int, at: int) -> GridPoint:
        """Another noise of one kind."""
        return self._replace(noise=(*self.noise[:kind], at, *self.noise[kind + 1 :]))


@dataclass(frozen=True)
class Unknowns:
    """The grid: noise (values of k) for each kind, and rows of ``widening`` (one factor a class of parts)."""

    noise: tuple[Axis, ...]
    widening: tuple[tuple[float, ...], ...]
    log_widening: tuple[float, ...]

    @classmethod
    def over(
        cls, kinds: int, rms: float, widenings: tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]
    ) -> Unknowns:
        """Noise of so many kinds up to ``rms``, what geometry alone leaves."""
        top = np.log(max(2.0, 1.3 * rms)) + prior.NOISE_STEP
        noise = np.exp(np.arange(np.log(prior.NOISE_FROM), top, prior.NOISE_STEP)).tolist()
        return cls((Axis(tuple(noise), prior.noise_log_prior(noise)),) * kinds, *widenings)

    def holds(self, point: GridPoint) -> bool:
        """Whether a point is on the grid."""
        sizes = (*(len(a.values) for a in self.noise), len(self.widening))
        return all(0 <= k < n for k, n in zip((*point.noise, point.widening), sizes, strict=True))

    def all_widenings(self, point: GridPoint) -> list[GridPoint]:
        """All points that differ in their widening alone."""
        return [point.widened(k) for k in range(len(self.widening))]

    def nearest(self, point: GridPoint) -> GridPoint:
        """A point of another grid with like axes, moved onto this one."""
        noise = tuple(min(k, len(a.values) - 1) for k, a in zip(point.noise, self.noise, strict=True))
        return GridPoint(noise, min(point.widening, len(self.widening) - 1))

    def all_at(self, noise: int, widening: int = 0) -> GridPoint:
        """The point with one index of noise for every kind (the largest there is, where an axis is shorter)."""
        return GridPoint(tuple(min(noise, len(a.values) - 1) for a in self.noise), widening)

    def scales(self, point: GridPoint) -> Array:
        """(k,) noise of each kind of channel in stated sigmas."""
        return np.array([a.values[k] for a, k in zip(self.noise, point.noise, strict=True)])

    def log_prior(self, point: GridPoint) -> float:
        """Of a point; the first noise is paid by how far it is from stated, others by how far they are from the first."""
        steps = np.log(self.scales(point))
        apart = float(np.sum(prior.RATIO_DOUBT.log_prior(steps[1:] - steps[0])))
        own = self.noise[0].log_prior[point.noise[0]] + apart
        return own + self.log_widening[point.widening]


class Counts(NamedTuple):
    """Causes of each kind (g,), members of each feature (f,), and members of each kind at each size (s, g)."""

    kinds: Index
    features: Index
    sizes: Index


@dataclass(frozen=True)
class Urn:
    """kind (n,): of each cause; share (g,): prior share of each kind; number (g,): of its causes; feature_kind (f,): kind of
    each feature; feature_share (f,): in its kind; log_size (g, s): log prior of each size in each kind; weight: of the
    shares of kinds; alike: of those of features and sizes within a kind; further: prior odds of a further term of a cause
    that is there; log_place (n,): share of each cause in its kind."""

    kind: Index
    share: Array
    number: Index
    feature_kind: Index
    feature_share: Array
    log_size: Array
    weight: float
    alike: float
    further: float
    log_place: Array

    @cached_property
    def grows(self) -> Mask:
        """(g,) kinds of several causes."""
        return np.asarray(self.number > 1)

    @cached_property
    def base(self) -> Array:
        """(g,) prior shares among the kinds that grow, as so many draws; nothing for others."""
        grown = np.where(self.grows, self.share, 0.0)
        return np.asarray(self.weight * grown / max(float(grown.sum()), 1e-300))

    @cached_property
    def plain(self) -> Array:
        """(g,) log share of the kind, or of all kinds that grow together."""
        together = max(float(self.share[self.grows].sum()), 1e-300)
        return np.log(np.maximum(np.where(self.grows, together, self.share), 1e-300))

    def log_next(self, counts: Counts) -> tuple[Array, Array, Array]:
        """Log prior beside so many: of one more of each kind (g,), of each feature less its share (f,), of each size (s, g)."""
        kinds, features, sizes = counts
        own = np.where(self.grows, kinds, 0)
        drawn = np.where(self.grows, (self.base + own) / (self.weight + own.sum()), 1.0)
        left = self.number / np.maximum(self.number - own, 1)
        members, share, w = np.where(self.grows, sizes.sum(axis=0), 0), self.feature_share, self.alike
        seen = np.where(self.grows[self.feature_kind], features, 0)
        feature = (w * share + seen) / (w + members[self.feature_kind]) / share
        size = (w * np.exp(self.log_size).T + np.where(self.grows, sizes, 0)) / (w + members)
        return self.plain + np.log(drawn * left), np.log(feature), np.log(size)

    def log_prior(self, counts: Counts) -> float:
        """Of so many, whatever their order, less the shares of terms in their kinds."""
        kinds, features, sizes = counts
        own, w = np.where(self.grows, kinds, 0), self.alike
        left = own * np.log(self.number) - gammaln(self.number + 1) + gammaln(self.number - own + 1)
        out = float(kinds @ self.plain + left.sum()) + polya(own, self.base, self.weight)
        for k in np.flatnonzero(sizes.sum(axis=0)):
            mine = self.feature_kind == k
            if not self.grows[k]:
                out += float(sizes[:, k] @ self.log_size[k])
                continue
            out += polya(features[mine], w * self.feature_share[mine], w)
            out -= float(features[mine] @ np.log(self.feature_share[mine]))
            out += polya(sizes[:, k], w * np.exp(self.log_size[k]), w)
        return out


def polya(counts: Index, base: Array, weight: float) -> float:
    """Log probability of draws in some order, ``base`` (k,) summing to ``weight``."""
    some = np.flatnonzero(counts)
    drawn = float(np.sum(gammaln(base[some] + counts[some]) - gammaln(base[some])))
    return drawn - float(gammaln(weight + counts.sum()) - gammaln(weight))


@dataclass(frozen=True)
class Term:
    """One thing that may be there: its columns, N(0, size^2) each, in units of an expected largest size.

    columns (k,): of the design; cause: number of what it blames (terms of one cause differ in settings or form); feature:
    number of its settings, the same for like terms of other causes; log_share: prior share of the term in its kind; lower,
    upper (k,): physical bounds; alone: no other term of its cause may stand beside it.
    """

    columns: tuple[int, ...]
    cause: int
    feature: int
    log_share: float
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    alone: bool = True
    length: int = 0
    """Number of coefficients, where columns are directions of more of them."""
    group: int = 0
    """What may give way at once to terms of another group."""


WIDTHS = (2, 6, 18)
"""Numbers of columns to which shorter terms are filled up, with a column that is not there."""


@dataclass(frozen=True)
class SameSize:
    """Terms (c,) of one number k of columns: their columns (c, k) and bounds (c, k), which all of them have or none.

    ``there`` (c, k) tells columns from fillings, which stand at column 0.
    """

    terms: Index
    columns: Index
    lower: Array
    upper: Array
    bounded: bool
    there: Mask


class Terms:
    """All terms, as arrays."""

    def __init__(self, terms: Sequence[Term], urn: Urn, closed: Sequence[int] = ()) -> None:
        self.all, self.urn, self._closed = tuple(terms), urn, frozenset(closed)
        self.columns = tuple(np.array(t.columns, dtype=np.intp) for t in terms)
        self.cause = np.array([t.cause for t in terms], dtype=np.intp)
        self.feature = np.array([t.feature for t in terms], dtype=np.intp)
        self.n_causes, self.kind = len(urn.kind), urn.kind[self.cause]
        self.group = np.array([t.group for t in terms], dtype=np.intp)
        self._share = np.array([t.log_share for t in terms])
        self.bounded = np.array([bool(np.any(np.isfinite([t.lower, t.upper]))) for t in terms], dtype=bool)

    def restricted(self, kept: Sequence[int], place: Index) -> Terms:
        """Some of the terms, their columns renumbered by ``place``; causes keep their numbers."""
        terms = [self.all[k] for k in kept]
        moved = [replace(t, columns=tuple(int(place[c]) for c in t.columns)) for t in terms]
        return Terms(moved, self.urn)

    def beside(self, given: Sequence[int]) -> tuple[Terms, Index]:
        """The same terms beside some that are there for good, and the columns that are left: those of terms that may still
        join them. Columns of the others are gone, and nobody asks for them."""
        closed = np.flatnonzero(self.excludes[list(given)].any(axis=0))
        rest = [k for k in range(len(self)) if k not in set(closed.tolist())]
        left = np.unique(
            np.concatenate([*(self.columns[k] for k in rest), np.zeros(0, dtype=np.intp)])
        ).astype(np.intp)
        place = np.zeros(1 + max((int(c.max()) for c in self.columns), default=0), dtype=np.intp)
        place[left] = np.arange(len(left))
        terms = [replace(t, columns=tuple(int(place[c]) for c in t.columns)) for t in self.all]
        return Terms(terms, self.urn, closed.tolist()), left

    def __len__(self) -> int:
        return len(self.all)

    @cached_property
    def by_size(self) -> tuple[SameSize, ...]:
        """Terms grouped by their number of columns, filled up to a few widths, and by whether they have bounds."""
        groups: dict[tuple[int, bool], list[int]] = {}
        for k, term in enumerate(self.all):
            if k in self._closed:
                continue
            own = len(term.columns)
            width = next((w for w in WIDTHS if own <= w), own)
            groups.setdefault((width, bool(self.bounded[k])), []).append(k)
        return tuple(self._group(members, *like) for like, members in groups.items())

    def _group(self, members: Sequence[int], width: int, bounded: bool) -> SameSize:
        def filled(rows: list[Sequence[float]], value: float) -> Array:
            return np.array([[*row, *[value] * (width - len(row))] for row in rows])

        lower = filled([self.all[k].lower for k in members], -np.inf)
        upper = filled([self.all[k].upper for k in members], np.inf)
        columns = filled([self.all[k].columns for k in members], -1).astype(np.intp)
        return SameSize(np.array(members), np.maximum(columns, 0), lower, upper, bounded, columns >= 0)

    @cached_property
    def excludes(self) -> Mask:
        """(c, c) pairs that cannot stand together: the same term, columns in common, or a cause that takes one alone."""
        alone = np.array([t.alone for t in self.all], dtype=bool)
        same = self.cause[:, None] == self.cause[None, :]
        out = same & (alone[:, None] | alone[None, :])
        width = 1 + max((int(c.max()) for c in self.columns), default=0)
        used = np.zeros((len(self), width), dtype=np.float32)
        for k, columns in enumerate(self.columns):
            used[k, columns] = 1.0
        return np.asarray(out | (used @ used.T > 0.0))

    @cached_property
    def log_first(self) -> Array:
        """(c,) log prior of each term beside nothing, whatever its size."""
        return np.asarray(self._share + np.log(self.urn.share)[self.kind])

    @property
    def log_sizes(self) -> Array:
        """(s, c) log prior of each size of each term."""
        return np.ascontiguousarray(self.urn.log_size.T[:, self.kind])

    def log_prior(self, present: Sequence[tuple[int, int]]) -> Array:
        """(s, c) log prior of each term at each size beside those present (term, size); minus infinity where it cannot stand
        beside them."""
        terms = [t for t, _ in present]
        by_kind, by_feature, by_size = self.urn.log_next(self._counts(present))
        again = np.bincount(self.cause[terms], minlength=self.n_causes)[self.cause] > 0
        own = self._share + by_feature[self.feature] + np.where(again, self._further, by_kind[self.kind])
        own[self.excludes[terms].any(axis=0)] = -np.inf
        return np.asarray(own + by_size[:, self.kind])

    def log_prior_of(self, present: Sequence[tuple[int, int]]) -> float:
        """Log prior of these terms at their sizes together, whatever their order."""
        terms = np.array([t for t, _ in present], dtype=np.intp)
        _, first = np.unique(self.cause[terms], return_index=True)  # whichever: further ones cost the same
        further = np.delete(terms, first)
        own = float(np.sum(self._share[terms]) + np.sum(self._further[further]))
        return own + self.urn.log_prior(self._counts(present))

    @cached_property
    def _further(self) -> Array:
        """(c,) log prior odds of a further term of a cause that is there, beside those of its settings: its place is known."""
        return np.asarray(np.log(self.urn.further) - self.urn.log_place[self.cause])

    def _counts(self, present: Sequence[tuple[int, int]]) -> Counts:
        """Of causes, and of all members."""
        terms, sizes = (np.array([m[k] for m in present], dtype=np.intp) for k in (0, 1))
        by_size = np.zeros(self.urn.log_size.shape[::-1], dtype=np.intp)
        np.add.at(by_size, (sizes, self.kind[terms]), 1)
        kinds = np.bincount(self.urn.kind[np.unique(self.cause[terms])], minlength=len(self.urn.share))
        return Counts(kinds, np.bincount(self.feature[terms], minlength=len(self.urn.feature_share)), by_size)
