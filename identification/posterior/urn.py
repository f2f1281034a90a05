"""Polya urns: what is part of a set already makes its like likelier (Blackwell and MacQueen 1973, Ann. Statist. 1:353).

Causes come in kinds, every kind with some features (its settings) and sizes. Each is drawn from an urn of its own:

    p(next is k | counts m) = (w b_k + m_k) / (w + sum m),   b: prior shares, w: how many draws they count for

so where one gear errs the others may well, alike in period and size. A cause is not drawn twice: the more of a kind are
there, the fewer places are left to each further one. Kinds of a single cause have no like, and no part in any of this.
Integrated over the unknown shares this is a Dirichlet-multinomial, in which the order of draws does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln

from truepose.arrays import Array, Index, Mask


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
