"""Log odds of every term at every size beside what a marginal has taken in already."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from truepose.identification.posterior.marginal import Marginal
from truepose.identification.posterior.terms import SameSize
from truepose.identification.prior import BOUND_DOUBT, Sizes

Array = NDArray[np.float64]
LARGEST_COST = 50.0
"""The most that a coefficient beyond its bound costs in the log."""


def log_gains(marginal: Marginal, sizes: Sizes, wanted: NDArray[np.bool_]) -> Array:
    """(s, c) log Bayes factor of each term ``wanted`` (c,) at each size; bounds count."""
    out = np.full((len(sizes.values), len(marginal.terms)), -np.inf)
    for group in marginal.terms.by_size:
        chosen = np.flatnonzero(wanted[group.terms])
        if len(chosen):
            score = marginal.score[group.columns[chosen]] * group.there[chosen]
            part = group.of(chosen)
            out[:, part.terms] = _gains(part, marginal.block(group, chosen), score, sizes.values**2)
    return out


def _gains(group: SameSize, block: Array, score: Array, squared: Array) -> Array:
    """(s, c) of terms of one number of columns: blocks (c, k, k), scores (c, k), squared sizes (s,)."""
    if score.shape[1] == 1:  # a single coefficient needs no turning
        values, turned, vectors = np.maximum(block[:, :, 0], 0.0), score, None
    else:
        values, vectors = np.linalg.eigh(block)
        values = np.maximum(values, 0.0)
        turned = np.einsum("ckl,ck->cl", vectors, score)
    q = squared[:, None, None]
    damped = 1.0 + q * values
    out: Array = 0.5 * np.sum(q * turned**2 / damped - np.log(damped), axis=2)
    some = group.bounded
    if some.any():
        mean, variance = (q * turned / damped)[:, some], (q / damped)[:, some]
        if vectors is not None:
            own = vectors[some]
            mean = np.einsum("ckl,scl->sck", own, mean)
            variance = np.einsum("ckl,scl->sck", own**2, variance)
        out[:, some] += plausibility(mean, np.sqrt(variance), group.lower[some], group.upper[some])
    return out


def log_gains_together(marginal: Marginal, columns: NDArray[np.intp], sizes: Sizes) -> Array:
    """(s,) log Bayes factor of columns (k,) together at each size, with the size's log prior."""
    values, vectors = np.linalg.eigh(marginal.among(columns))
    values, turned = np.maximum(values, 0.0), vectors.T @ marginal.scores(columns)
    q = sizes.values[:, None] ** 2
    damped = 1.0 + q * values
    return np.asarray(0.5 * np.sum(q * turned**2 / damped - np.log(damped), axis=1) + sizes.log_prior)


def plausibility(mean: Array, std: Array, lower: Array, upper: Array) -> Array:
    """(s, c) log factor of physical signs and bounds (c, k): coefficients ``mean`` +- ``std`` (s, c, k)."""
    positive = np.where(lower == 0.0, np.log(2.0) + log_ndtr(mean / np.maximum(std, 1e-300)), 0.0)
    bound = np.where(mean > 0, upper, -lower)
    least = np.abs(mean) - 3.0 * std
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.where((bound > 0) & (least > bound), np.log(least / bound) / BOUND_DOUBT, 0.0)
    out: Array = np.sum(positive - np.minimum(0.5 * beyond**2, LARGEST_COST), axis=2)
    return out
