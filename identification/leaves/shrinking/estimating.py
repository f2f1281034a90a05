"""Biased estimators of a linear problem y = H b + noise, as shares of the least-squares coordinates.

All of them take many right-hand sides at once. Their bias pulls b towards zero: let b count from where it is expected to be.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from truepose.arrays import Array
from truepose.identification.fit.relinearised import Linear, LinearEstimate, Spectrum, shrink

Rule = Literal["plug-in", "unbiased"]


def liu(problem: Spectrum, d: float | None = None, *, rule: Rule = "plug-in") -> LinearEstimate:
    """(H'H + I)^-1 (H'y + d b_ols), 0 <= d <= 1 (Liu 1993; polisher paper, eq. 11); d from ``liu_parameter``."""
    lam = _upright(problem.values**2, problem.alpha)
    tuning = liu_parameter(problem, rule) if d is None else np.full(problem.noise.shape, float(d))
    return shrink(problem, (lam + tuning) / (lam + 1.0), tuning)


def liu_parameter(problem: Spectrum, rule: Rule = "plug-in") -> Array:
    """(...) the d that minimises the mean square error, kept within 0 and 1.

    The error of coordinate j is s2 (l + d)^2 / (l (l + 1)^2) + (d - 1)^2 a^2 / (l + 1)^2 (polisher paper,
    eq. 13). Its sum is least at sum (a^2 - s2)/(l + 1)^2 / sum (s2 + l a^2)/(l (l + 1)^2), the paper's eq. 14.
    ``plug-in`` puts the least-squares a there, as the paper does, although its square is s2/l too large on
    average; ``unbiased`` takes a^2 - s2/l, which gives Liu's own 1 - s2 sum 1/(l (l + 1)) / sum a^2/(l + 1)^2
    and shrinks more. The paper divides the sum of squares for s2 by n; here it is n less the rank.
    """
    lam, square = _upright(problem.values**2, problem.alpha), problem.alpha**2
    noise = problem.noise
    if rule == "plug-in":
        above = np.sum((square - noise) / (lam + 1.0) ** 2, axis=0)
        below = np.sum((noise + lam * square) / (lam * (lam + 1.0) ** 2), axis=0)
    else:
        below = np.sum(square / (lam + 1.0) ** 2, axis=0)
        above = below - np.sum(noise / (lam * (lam + 1.0)), axis=0)
    return np.clip(_ratio(above, below), 0.0, 1.0)


def ridge(problem: Spectrum, k: float | None = None) -> LinearEstimate:
    """(H'H + k I)^-1 H'y; k by Hoerl, Kennard and Baldwin (1975): rank * noise / |least-squares b|^2."""
    lam = _upright(problem.values**2, problem.alpha)
    if k is None:
        tuning = _ratio(len(problem.values) * problem.noise, np.sum(problem.alpha**2, axis=0))
    else:
        tuning = np.full(problem.noise.shape, float(k))
    return shrink(problem, lam / (lam + tuning), tuning)


def pcr(problem: Spectrum, components: int | None = None) -> LinearEstimate:
    """Least squares on the leading principal components, the rest at zero.

    Their number minimises the estimated mean square error, sum s2/l over what is kept plus sum (a^2 - s2/l)
    over what is dropped (a^2 - s2/l is the unbiased estimate of a coordinate's square).
    """
    lam = _upright(problem.values**2, problem.alpha)
    rank = len(problem.values)
    if components is None:
        gain = 2.0 * problem.noise / lam - problem.alpha**2  # what keeping a coordinate adds to the error
        total = np.concatenate([np.zeros((1, *problem.noise.shape)), np.cumsum(gain, axis=0)])
        number = np.argmin(total, axis=0).astype(float)
    else:
        number = np.full(problem.noise.shape, float(components))
    place = _upright(np.arange(rank, dtype=float), problem.alpha)
    return shrink(problem, np.where(place < number, 1.0, 0.0), np.asarray(number))


def _upright(values: Array, like: Array) -> Array:
    """(r,) values as (r, 1) where there are many right-hand sides."""
    return values[:, None] if like.ndim == 2 else values


def _ratio(above: Array, below: Array) -> Array:
    """above / below; 0 where there is nothing to divide."""
    above, below = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
    return np.divide(above, below, out=np.zeros_like(above), where=below > 0.0)


ESTIMATORS: Mapping[str, tuple[str, Linear]] = {
    "liu": ("d", liu),
    "ridge": ("k", ridge),
    "pcr": ("components", lambda problem, tuning: pcr(problem, None if tuning is None else round(tuning))),
}
"""What each is tuned by, and the estimator, by the name that ``calibrate`` knows it by."""
