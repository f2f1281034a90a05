"""Which tolerances a fit may give up: those of parameters that the readings can tell from each other.

A description with more constants than readings can see (every joint frame of a graph has six) leaves
directions along which a fit under wide tolerances only wanders. Widening an independent set of the
parameters gives the readings all the freedom that they can use, to first order; the rest stay as stated.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

from truepose.arrays import Array, Index
from truepose.identification.fit.leastsquares import triangular
from truepose.identification.fit.problem import Prior, Problem

LEAST_SHOWN = 0.1
"""Sigmas that a widened tolerance must move the readings by, beside all others, to count."""
FRAME = "frame"


def widened(problem: Problem, factor: float) -> Prior:
    """The problem's prior with the tolerances of an independent set of parameters multiplied.

    The set is found by pivoted QR of the readings' Jacobian at the start, columns in widened tolerances.
    Frames keep theirs: moving the whole chain between base and tool changes no reading. Frames and unknown
    parameters (infinite tolerance) come first in the order, since they are free already.
    """
    prior, free = problem.prior, problem.prior.free
    sigma = prior.sigma[free]
    unknown = np.isinf(sigma)
    first = unknown | np.array([prior.parts[k] == FRAME for k in free], dtype=bool)
    size = np.where(unknown, 1.0, sigma / prior.scale[free])
    factored = triangular(problem.data(problem.p, problem.x), len(free) + 1)[:, : len(free)]
    jacobian = factored * size * factor
    chosen = free[~first][independent_columns(jacobian[:, first], jacobian[:, ~first])]
    multiplied = prior.sigma.copy()
    multiplied[chosen] *= factor
    return prior.with_sigma(multiplied)


def untied(problem: Problem) -> Prior:
    """No tolerances for an independent set of the parameters; the rest, and what is exactly known, are held.

    The set holds what the readings see by a tenth of a sigma a tolerance at least: what they see worse is left
    to the drawing, since an estimate from readings alone would stray by more than ten tolerances.
    """
    prior, free = problem.prior, problem.prior.free
    sigma = prior.sigma[free]
    size = np.where(np.isinf(sigma), 1.0, sigma / prior.scale[free])
    jacobian = triangular(problem.data(problem.p, problem.x), len(free) + 1)[:, : len(free)] * size
    chosen = np.zeros(len(prior.sigma))
    chosen[free[independent_columns(jacobian[:, :0], jacobian)]] = np.inf
    return prior.with_sigma(chosen)


def independent_columns(taken: Array, columns: Array) -> Index:
    """Places of the columns that show something new beside ``taken`` and each other."""
    if not columns.shape[1] or not np.isfinite(columns).all():
        return np.arange(columns.shape[1])
    if taken.shape[1]:
        left, size, _ = np.linalg.svd(taken, full_matrices=False)
        span = left[:, size > 1e-12 * max(float(np.max(size)), 1e-300)]
        columns = columns - span @ (span.T @ columns)
    upper, order = qr(columns, mode="r", pivoting=True)
    shown = np.abs(np.diag(upper)) > LEAST_SHOWN
    return np.asarray(order[: len(shown)][shown], dtype=np.intp)


__all__ = ["independent_columns", "untied", "widened"]
