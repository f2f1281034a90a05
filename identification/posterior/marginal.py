"""The model with some columns marginalised, at one point of the grid: all that is needed to weigh any set of terms.

With V the covariance of e when A (and terms already taken in) are marginalised, M = G' V^-1 G and t = G' V^-1 e,
a set S of terms with sizes q has the log Bayes factor

    ln B(S) = 1/2 t' Q (I + Q M Q)^-1 Q t - 1/2 ln |I + Q M Q|,   Q = diag(q)

M itself is never formed: its rows and diagonal blocks follow from G'G and one triangular solve. Members that were
taken in are left out again one by one by

    M_without = M + P' C^-1 P,   C: their part of (I + Q M Q)^-1,   P: their rows of (I + Q M Q)^-1 Q M

which costs no more than the member is wide.

Log odds of every term at every size beside what marginals have taken in already.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.special import log_ndtr

from truepose.arrays import Array, Index, Mask
from truepose.identification.posterior.design import Design, GridPoint, SameSize, Terms, Unknowns
from truepose.identification.posterior.halves import Halves, cholesky, half_log_det, map_large, solved, taken
from truepose.identification.prior import BOUND_DOUBT, LONG, Sizes
from truepose.threads import Cached

ROUNDING = 1e-13
"""Of columns scaled to one length. Added to their diagonal, for columns without a prior may depend on each other; a share of
the largest eigenvalue below which nothing determines a direction."""


class Own:
    """G'G and G'e at the noise of a point, entry by entry as asked for; zero for columns that cannot be seen.

    ``left`` (w,): columns of the design that the terms count by, where these are not all.
    """

    def __init__(self, design: Design, terms: Terms, weights: Array, left: Index | None = None) -> None:
        self._design, self._terms, self._weights = design, terms, weights
        self._at = np.arange(design.width) if left is None else left
        self._seen = design.seen[self._at]

    @Cached
    def score(self) -> Array:
        """(w,) products with e."""
        return self.scores(np.arange(len(self._at)))

    def scores(self, columns: Index) -> Array:
        """(k,) products of some columns with e."""
        return self._sum(self._at[columns], np.array(self._design.width)) * self._seen[columns]

    def told(self, columns: Index) -> tuple[Array, Array]:
        """Entries (k, k) among some columns, and their scores (k,)."""
        return self.among(columns), self.scores(columns)

    def rows(self, columns: Index) -> Array:
        """(k, w) rows."""
        found = self._sum(self._at[columns][:, None], self._at)
        return _without(found, self._seen[columns][:, None], self._seen)

    def among(self, columns: Index) -> Array:
        """(k, k) entries."""
        at, seen = self._at[columns], self._seen[columns]
        return _without(self._sum(at[:, None], at), seen[:, None], seen)

    @Cached
    def blocks(self) -> tuple[Array, ...]:
        """(c, k, k) diagonal blocks of the terms of each width."""
        return tuple(self._block(group) for group in self._terms.by_size)

    def _block(self, group: SameSize) -> Array:
        at, seen = self._at[group.columns], self._seen[group.columns] & group.there
        found = self._sum(at[:, :, None], at[:, None, :])
        return _without(found, seen[:, :, None], seen[:, None, :])

    def _sum(self, row: Index, column: Index) -> Array:
        """Entries by columns of G (w: e), which are broadcast; in one array, for those of a large set take long to make."""
        grams, first = self._design.grams, self._design.n
        at = (row + first) * len(grams[0]) + (column + first)
        out = grams[0].ravel().take(at)
        out *= self._weights[0]
        for gram, weight in zip(grams[1:], self._weights[1:], strict=True):
            more = gram.ravel().take(at)
            more *= weight
            out += more
        return np.asarray(out)


def _without(found: Array, *seen: Mask) -> Array:
    """With zeros for columns that cannot be seen, in place."""
    for one in seen:
        if not one.all():
            found *= one
    return found


class Told:
    """Scores t (w,) and M (w, w) of a few columns, written out: where many others were taken in for good."""

    def __init__(self, terms: Terms, score: Array, matrix: Array) -> None:
        self._terms, self.score, self._matrix = terms, score, matrix

    def scores(self, columns: Index) -> Array:
        """(k,) scores of some columns."""
        return np.asarray(self.score[columns])

    def told(self, columns: Index) -> tuple[Array, Array]:
        """Entries (k, k) of M among some columns, and their scores (k,)."""
        return self.among(columns), self.scores(columns)

    def rows(self, columns: Index) -> Array:
        """(k, w) rows of M."""
        return np.asarray(self._matrix[columns])

    def among(self, columns: Index) -> Array:
        """(k, k) entries of M."""
        return np.asarray(self._matrix.ravel().take(columns[:, None] * len(self._matrix) + columns))

    @Cached
    def blocks(self) -> tuple[Array, ...]:
        """(c, k, k) diagonal blocks of the terms of each width."""
        return tuple(
            self._matrix[group.columns[:, :, None], group.columns[:, None, :]]
            * (group.there[:, :, None] & group.there[:, None, :])
            for group in self._terms.by_size
        )


class Marginal:
    """Scores t (w,), log evidence, and rows and blocks of M with everything taken in so far marginalised.

    M is what ``above`` has (G'G, or another marginal) less half' half. Where something is left out again, half' half is
    added instead (``sign`` 1). ``half`` (r, w) is worked out for the columns that are asked for, or for all at once.
    """

    def __init__(
        self,
        terms: Terms,
        above: Own | Told | Marginal,
        beside: Halves,
        log_evidence: float,
        sign: float = -1.0,
    ) -> None:
        self.terms, self.log_evidence = terms, log_evidence
        self._above, self._beside, self._sign = above, beside, sign
        self._rows: dict[int, Array] = {}

    @Cached
    def score(self) -> Array:
        """(w,) scores t."""
        return np.asarray(self._above.score + self._sign * (self._beside.all.T @ self._beside.turned))

    def scores(self, columns: Index) -> Array:
        """(k,) scores of some columns."""
        half = self._beside.of(columns)
        return np.asarray(self._above.scores(columns) + self._sign * (half.T @ self._beside.turned))

    def rows(self, columns: Index) -> Array:
        """(k, w) rows of M."""
        new = [int(c) for c in columns if int(c) not in self._rows]
        if new:
            at = np.array(new)
            made = self._with(self._beside.of(at).T @ self._beside.all, self._above.rows(at))
            self._rows.update(zip(new, made, strict=True))
        return np.array([self._rows[int(c)] for c in columns])

    @Cached
    def blocks(self) -> tuple[Array, ...]:
        """(c, k, k) diagonal blocks of M of the terms of each width."""
        half, groups = self._beside.all, self.terms.by_size
        products = map_large(lambda group: self._product(half, group), groups, half.size * LONG)
        pairs = zip(products, self._above.blocks, strict=True)
        return tuple(above + self._sign * product for product, above in pairs)

    def _product(self, half: Array, group: SameSize) -> Array:
        part = half.take(group.columns.ravel(), axis=1).reshape(len(half), *group.columns.shape)
        turned = _without(part, group.there).transpose(1, 0, 2)
        return np.asarray(turned.transpose(0, 2, 1) @ turned)

    def _with(self, product: Array, above: Array) -> Array:
        """What is above with the product of halves, which is written over."""
        product *= self._sign
        product += above
        return product

    def including(self, columns: Index, sizes: Array) -> Marginal:
        """With columns (k,) taken in, N(0, size^2) each."""
        if not len(columns):
            return self
        rows = self.rows(columns)
        factor, turned, gain = taken(rows[:, columns], self.score[columns], sizes)
        half = Halves(factor, rows * sizes[:, None], turned)
        return Marginal(self.terms, self, half, self.log_evidence + gain)

    def beside(self, columns: Index, sizes: Array, left: Index, terms: Terms) -> Marginal:
        """With columns (k,) taken in for good, of the columns ``left`` (w,) alone, by which ``terms`` count theirs.

        Fewer columns than what was taken in are written out; of more the halves are cheaper.
        """
        if isinstance(self._above, Own) and len(left) > len(self._beside.all) + len(columns):
            return self._stacked(columns, sizes, left, terms, self._above)
        rows, (both, score) = len(columns), self.told(np.concatenate([columns, left]))
        factor, turned, gain = taken(both[:rows, :rows], score[:rows], sizes)
        across = solved(factor, both[:rows, rows:] * sizes[:, None])
        told = Told(terms, score[rows:] - across.T @ turned, both[rows:, rows:] - across.T @ across)
        nothing = Halves.from_turned(np.zeros((0, len(left))), np.zeros(0))
        return Marginal(terms, told, nothing, self.log_evidence + gain)

    def _stacked(self, columns: Index, sizes: Array, left: Index, terms: Terms, above: Own) -> Marginal:
        """Return what ``beside`` does, as products of halves."""
        rows = self.rows(columns)
        factor, turned, gain = taken(rows[:, columns], self.score[columns], sizes)
        further = solved(factor, rows[:, left] * sizes[:, None])
        halves = Halves.from_turned(
            np.vstack([self._beside.all[:, left], further]), np.concatenate([self._beside.turned, turned])
        )
        own = Own(above._design, terms, above._weights, above._at[left])
        return Marginal(terms, own, halves, self.log_evidence + gain)

    def without(self, at: Index) -> Marginal:
        """Without some of the columns that were taken in last: their places ``at`` (k,) among these."""
        half, gain = self._beside.without(at)
        return Marginal(self.terms, self, half, self.log_evidence - gain, sign=1.0)

    def gain(self, columns: Index, sizes: Array) -> float:
        """Log Bayes factor of columns (k,) together, N(0, size^2) each."""
        return taken(*self.told(columns), sizes)[2]

    def posterior(self, columns: Index, sizes: Array) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the coefficients of columns taken in together."""
        factor, turned, _ = taken(*self.told(columns), sizes)
        root = solved(factor, np.diag(sizes))
        return root.T @ turned, root.T @ root

    def last(self, columns: Index, sizes: Array, number: int) -> tuple[Array, Array]:
        """Mean and 1-sigma (``number``,) of the last coefficients of columns (k,) taken in together."""
        factor, turned, _ = taken(*self.told(columns), sizes)
        root = solved(factor[-number:, -number:], np.diag(sizes[-number:]))
        return root.T @ turned[-number:], np.sqrt(np.sum(root**2, axis=0))

    def told(self, columns: Index) -> tuple[Array, Array]:
        """Entries (k, k) of M among some columns, and their scores (k,)."""
        half, (among, score) = self._beside.of(columns), self._above.told(columns)
        return self._with(half.T @ half, among), self._with(half.T @ self._beside.turned, score)

    def among(self, columns: Index) -> Array:
        """(k, k) entries of M."""
        part = self._beside.of(columns)
        return self._with(part.T @ part, self._above.among(columns))


def nbytes(found: Marginal) -> int:
    """What a marginal takes of memory, without what it stands on."""
    above = found._above
    rows = sum(row.nbytes for row in list(found._rows.values())[:1]) * len(found._rows)  # all are as long
    told = above._matrix.nbytes if isinstance(above, Told) else 0
    blocks = sum(int(block.nbytes) for block in found.__dict__.get("blocks", ()))
    return rows + told + found._beside.nbytes + blocks


def marginal(design: Design, unknowns: Unknowns, terms: Terms, point: GridPoint) -> Marginal:
    """Everything that all models have marginalised at a point; its log evidence holds the point's log prior."""
    scales = unknowns.scales(point)
    weights = scales**-2.0
    sigma, n = prior_sigma(design, unknowns, point), design.n
    rows = sum(gram[:n] * weight for gram, weight in zip(design.grams, weights, strict=True))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(rows) + sigma**-2.0, 1e-300))
    a = rows[:, :n] * scale[:, None] * scale
    a[np.diag_indices(len(a))] += (scale / sigma) ** 2 + ROUNDING
    factor = cholesky(a)
    turned = solved(factor, rows[:, -1] * scale)
    beside = rows[:, n:-1] * scale[:, None] * design.seen
    square = sum(gram[-1, -1] * weight for gram, weight in zip(design.grams, weights, strict=True))
    known = np.isfinite(sigma)
    log_det = half_log_det(factor) + float(np.sum(np.log(sigma[known])) - np.sum(np.log(scale)))
    log_evidence = -float(np.array(design.counts) @ np.log(scales)) - log_det
    log_evidence -= 0.5 * float(square - turned @ turned)
    own = Own(design, terms, weights)
    return Marginal(terms, own, Halves(factor, beside, turned), log_evidence + unknowns.log_prior(point))


def prior_sigma(design: Design, unknowns: Unknowns, point: GridPoint) -> Array:
    """(n,) 1-sigmas of A at a point."""
    factors = np.array([*unknowns.widening[point.widening], 1.0])  # part -1: none
    return np.asarray(design.always.sigma * factors[design.always.part])


LARGEST_COST = 50.0
"""The most that a coefficient beyond its bound costs in the log."""
ROW_BY_ROW = 18
"""Columns up to which all terms and sizes are factored at once, row by row; wider ones are too few for that to pay."""


def log_gains(
    marginals: Sequence[Marginal], sizes: Sizes, groups: Collection[SameSize] | None = None
) -> Array:
    """(p, s, c) log Bayes factor of each term at each size beside each of the marginals; bounds count.

    ``groups``: of the terms by size those that are weighed; others have 0.
    """
    terms = marginals[0].terms
    out = np.zeros((len(marginals), len(sizes.values), len(terms)))
    for k, group in enumerate(terms.by_size):
        if groups is not None and not any(group is one for one in groups):
            continue
        block = np.array([m.blocks[k] for m in marginals])
        score = np.array([m.score[group.columns] * group.there for m in marginals])
        many = group.columns.shape[1] > ROW_BY_ROW
        gains = _bounded_gains if group.bounded else _gains_of_many if many else _gains
        out[:, :, group.terms] = gains(group, block, score, sizes.values**2).swapaxes(0, 1)
    return out


def _gains(group: SameSize, block: Array, score: Array, squared: Array) -> Array:
    """(s, p, c) of terms without bounds: blocks (p, c, k, k), scores (p, c, k), squared sizes (s,).

    I + q^2 M = L D L', row by row for all terms and sizes at once; a last column of D L' holds the scores turned by L.
    """
    width, q = score.shape[2], squared[:, None, None]
    factor = np.empty((width, width + 1, len(squared), *score.shape[:2]))
    np.multiply(q, np.ascontiguousarray(block.transpose(2, 3, 0, 1))[:, :, None], out=factor[:, :-1])
    np.multiply(np.sqrt(q), score.transpose(2, 0, 1)[:, None], out=factor[:, -1])
    pivots = factor.reshape(-1, *factor.shape[2:])[:: width + 2]
    pivots += 1.0
    for k in range(1, width):
        factor[k, k:] -= np.einsum("jspc,jkspc->kspc", factor[:k, k] / pivots[:k], factor[:k, k:])
        np.maximum(pivots[k], 1.0, out=pivots[k])  # smaller by rounding only
    return np.asarray(0.5 * np.sum(factor[:, -1] ** 2 / pivots - np.log(pivots), axis=0))


def _gains_of_many(group: SameSize, block: Array, score: Array, squared: Array) -> Array:
    """The same of terms of many columns, one matrix after another: the last row of its factor holds the scores turned by L."""
    width, q = score.shape[2], squared[:, None, None, None]
    bordered = np.zeros((len(squared), *score.shape[:2], width + 1, width + 1))
    bordered[..., :-1, :-1] = q[..., None] * block + np.eye(width)
    bordered[..., -1, :-1] = np.sqrt(q) * score
    bordered[..., -1, -1] = 1.0 + np.sum(bordered[..., -1, :-1] ** 2, axis=-1)  # so that it has a factor, too
    factor = np.linalg.cholesky(bordered)
    pivots = np.diagonal(factor, axis1=-2, axis2=-1)[..., :-1]
    return np.asarray(0.5 * np.sum(factor[..., -1, :-1] ** 2, axis=-1) - np.sum(np.log(pivots), axis=-1))


def _bounded_gains(group: SameSize, block: Array, score: Array, squared: Array) -> Array:
    """(s, p, c) of terms with bounds, which need the mean and variance of each coefficient, too."""
    values, vectors = np.linalg.eigh(block)
    turned = np.einsum("pckl,pck->pcl", vectors, score)
    q = squared[:, None, None, None]
    damped = 1.0 + q * np.maximum(values, 0.0)
    mean = np.einsum("pckl,spcl->spck", vectors, q * turned / damped)
    variance = np.einsum("pckl,spcl->spck", vectors**2, q / damped)
    gains = 0.5 * np.sum(q * turned**2 / damped - np.log(damped), axis=3)
    return np.asarray(gains + plausibility(mean, np.sqrt(variance), group.lower, group.upper))


def log_gains_together(marginal: Marginal, columns: Index, sizes: Sizes) -> Array:
    """(s,) log Bayes factor of columns (k,) together at each size, with the size's log prior."""
    values, vectors = np.linalg.eigh(marginal.among(columns))
    values, turned = np.maximum(values, 0.0), vectors.T @ marginal.scores(columns)
    q = sizes.values[:, None] ** 2
    damped = 1.0 + q * values
    return np.asarray(0.5 * np.sum(q * turned**2 / damped - np.log(damped), axis=1) + sizes.log_prior)


def plausibility(mean: Array, std: Array, lower: Array, upper: Array) -> Array:
    """(..., c) log factor of physical signs and bounds (c, k): coefficients ``mean`` +- ``std`` (..., c, k)."""
    positive = np.where(lower == 0.0, np.log(2.0) + log_ndtr(mean / np.maximum(std, 1e-300)), 0.0)
    bound = np.where(mean > 0, upper, -lower)
    least = np.abs(mean) - 3.0 * std
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.where((bound > 0) & (least > bound), np.log(least / bound) / BOUND_DOUBT, 0.0)
    return np.asarray(np.sum(positive - np.minimum(0.5 * beyond**2, LARGEST_COST), axis=-1))
