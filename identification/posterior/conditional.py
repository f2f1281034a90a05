"""Log odds of every term at every size beside what marginals have taken in already."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.special import log_ndtr

from truepose.arrays import Array, Index
from truepose.identification.posterior.marginal import Marginal
from truepose.identification.posterior.terms import SameSize
from truepose.identification.prior import BOUND_DOUBT, Sizes

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
