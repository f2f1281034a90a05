"""Rows that no smooth physics explains: far beyond the spread of their neighbours, one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from truepose.identification.estimate import Estimate

Array = NDArray[np.float64]
LIMIT = 0.05
"""Beyond this share of the rows, far residuals are no outliers but a model that is wrong."""


def row_scale(residual: Array) -> tuple[Array, float]:
    """Rms of each row's whitened residual and a robust estimate of the noise scale of rows."""
    size = np.sqrt(np.mean(residual**2, axis=1))
    m = residual.shape[1]
    typical = float(np.median(size)) / np.sqrt(chi2.ppf(0.5, m) / m)
    return size, max(typical, 1e-300)


def outlying_rows(
    fit: Estimate, candidates: NDArray[np.bool_], *, significance: float = 1e-3
) -> NDArray[np.bool_]:
    """(n,) rows among ``candidates`` whose residual chance would not make once in 1/significance recordings.

    The noise scale is the larger of the stated one and the rows' own median, so that a model that is wrong
    everywhere flags nothing.
    """
    out = np.zeros(len(fit.residual), dtype=bool)
    rows = np.flatnonzero(candidates & np.isfinite(fit.residual).all(axis=1))
    if len(rows) < 10:
        return out
    size, typical = row_scale(fit.residual[rows])
    m = fit.residual.shape[1]
    scale = max(typical, 1.0)
    # heavy tails are common: the Gaussian limit, and half as much again
    limit = 1.5 * scale * np.sqrt(chi2.isf(significance / len(rows), m) / m)
    far = rows[size > limit]
    if len(far) <= LIMIT * len(rows):
        out[far] = True
    return out
