"""Polya urns: what is part of a set already makes its like likelier (Blackwell and MacQueen 1973, Ann. Statist. 1:353).

Causes come in kinds, every kind with some features (its settings) and sizes. Each is drawn from an urn of its own:

    p(next is k | counts m) = (w b_k + m_k) / (w + sum m),   b: prior shares, w: how many draws they count for

so where one gear errs the others may well, alike in period and size. Causes are not drawn twice; the more of a kind are there,
the fewer places are left to each further one. Integrated over the unknown shares this is a Dirichlet-multinomial, in which
the order of draws does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Counts(NamedTuple):
    """Causes of each kind (g,), of each feature (f,), and those of each kind at each size (s, g)."""

    kinds: Index
    features: Index
    sizes: Index


@dataclass(frozen=True)
class Urn:
    """kind (n,): of each cause; share (g,): prior share of each kind; number (g,): of its causes; feature_kind (f,): kind of
    each feature; feature_share (f,): in its kind; log_size (s,): log prior of each size; weight: of the shares of kinds; alike:
    of those of features and sizes within a kind."""

    kind: Index
    share: Array
    number: Index
    feature_kind: Index
    feature_share: Array
    log_size: Array
    weight: float
    alike: float

    def counts(self, causes: Index, features: Index, sizes: Sequence[int]) -> Counts:
        """Of causes with the feature and the size of each."""
        kinds = self.kind[causes]
        by_size = np.zeros((len(self.log_size), len(self.share)), dtype=np.intp)
        np.add.at(by_size, (np.array(sizes, dtype=np.intp), kinds), 1)
        return Counts(by_size.sum(axis=0), np.bincount(features, minlength=len(self.feature_share)), by_size)

    def log_next(self, counts: Counts) -> tuple[Array, Array, Array]:
        """Log prior beside so many: of one more of each kind (g,), of each feature less its share (f,), of each size (s, g)."""
        kinds, features, sizes = counts
        drawn = (self.weight * self.share + kinds) / (self.weight + kinds.sum())
        left = self.number / np.maximum(self.number - kinds, 1)
        own, w = self.feature_share, self.alike
        of_kind = kinds[self.feature_kind]
        feature = (w * own + features) / (w + of_kind) / own
        size = (w * np.exp(self.log_size)[:, None] + sizes) / (w + sizes.sum(axis=0))
        return np.log(drawn * left), np.log(feature), np.log(size)

    def log_prior(self, counts: Counts) -> float:
        """Of so many, whatever their order, less the shares of terms in their kinds."""
        kinds, features, sizes = counts
        left = kinds * np.log(self.number) - gammaln(self.number + 1) + gammaln(self.number - kinds + 1)
        out = polya(kinds, self.weight * self.share, self.weight) + float(left.sum())
        own, w = self.feature_share, self.alike
        for k in np.flatnonzero(kinds):
            mine = self.feature_kind == k
            out += polya(features[mine], w * own[mine], w) - float(features[mine] @ np.log(own[mine]))
        for k in np.flatnonzero(sizes.sum(axis=0)):
            out += polya(sizes[:, k], w * np.exp(self.log_size), w)
        return out


def polya(counts: Index, base: Array, weight: float) -> float:
    """Log probability of draws in some order, ``base`` (k,) summing to ``weight``."""
    some = np.flatnonzero(counts)
    drawn = float(np.sum(gammaln(base[some] + counts[some]) - gammaln(base[some])))
    return drawn - float(gammaln(weight + counts.sum()) - gammaln(weight))


__all__ = ["Counts", "Urn", "polya"]
