"""The model with some columns marginalised, at one point of the grid: all that is needed to weigh any set of terms.

With V the covariance of e when A (and terms already taken in) are marginalised, M = G' V^-1 G and t = G' V^-1 e,
a set S of terms with sizes q has the log Bayes factor

    ln B(S) = 1/2 t' Q (I + Q M Q)^-1 Q t - 1/2 ln |I + Q M Q|,   Q = diag(q)

M itself is never formed: its rows and diagonal blocks follow from G'G and one triangular solve. Members that were
taken in are left out again one by one by

    M_without = M + P' C^-1 P,   C: their part of (I + Q M Q)^-1,   P: their rows of (I + Q M Q)^-1 Q M

which costs no more than the member is wide.
"""

from __future__ import annotations

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.posterior.design import Design, GridPoint, Unknowns
from truepose.identification.posterior.halves import Halves, cholesky, half_log_det, solved, taken
from truepose.identification.posterior.large import map_large
from truepose.identification.posterior.terms import SameSize, Terms
from truepose.identification.prior import LONG
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

    def among_terms(self, left: Index, terms: Terms) -> Own:
        """Return the same products by the columns ``left`` (w,) alone, by which ``terms`` count theirs."""
        return Own(self._design, terms, self._weights, self._at[left])

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
        return Marginal(terms, above.among_terms(left, terms), halves, self.log_evidence + gain)

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
    sigma, keep = _sigma(design, unknowns, point)
    inside, sigma = np.flatnonzero(keep), sigma[keep]
    rows = sum(gram[inside] * weight for gram, weight in zip(design.grams, weights, strict=True))
    scale = 1.0 / np.sqrt(np.maximum(rows[np.arange(len(inside)), inside] + sigma**-2.0, 1e-300))
    a = rows[:, inside] * scale[:, None] * scale
    a[np.diag_indices(len(a))] += (scale / sigma) ** 2 + ROUNDING
    factor = cholesky(a)
    turned = solved(factor, rows[:, -1] * scale)
    beside = rows[:, design.n : -1] * scale[:, None] * design.seen
    square = sum(gram[-1, -1] * weight for gram, weight in zip(design.grams, weights, strict=True))
    known = np.isfinite(sigma)
    log_det = half_log_det(factor) + float(np.sum(np.log(sigma[known])) - np.sum(np.log(scale)))
    log_evidence = -float(np.array(design.counts) @ np.log(scales)) - log_det
    log_evidence -= 0.5 * float(square - turned @ turned)
    own = Own(design, terms, weights)
    return Marginal(terms, own, Halves(factor, beside, turned), log_evidence + unknowns.log_prior(point))


def _sigma(design: Design, unknowns: Unknowns, point: GridPoint) -> tuple[Array, Mask]:
    """(n,) 1-sigmas of A at a point, and which columns are there at all: without a size the remainder is not."""
    always, tau = design.always, unknowns.size.values[point.remainder]
    factors = np.array([*unknowns.widening[point.widening], 1.0])  # part -1: none
    sigma = always.sigma * np.where(always.remainder, tau, factors[always.part])
    return sigma, ~always.remainder | (tau > 0.0)
