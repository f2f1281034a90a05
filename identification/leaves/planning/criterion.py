"""Measure what a set of poses is worth."""

from __future__ import annotations

import numpy as np

from truepose.arrays import Array

CRITERION, TITLE = "d", "log det(J'J + prior)"


def log_det(rows: Array, weight: Array) -> float:
    """Return log det of the information of rows (n, m, k) of a Jacobian and of what tolerances say, ``weight`` (k,).

    From singular values: the information has the square of their condition, and its small eigenvalues would be lost in
    rounding.
    """
    return float(np.sum(np.log(spectrum(rows, weight)[0])))


def spectrum(rows: Array, weight: Array) -> tuple[Array, Array]:
    """Return eigenvalues (k,) of the information, ascending, and eigenvectors as columns."""
    stacked = np.vstack([rows.reshape(-1, rows.shape[-1]), np.diag(weight)])
    _, s, vt = np.linalg.svd(np.linalg.qr(stacked, mode="r"), full_matrices=False)
    return np.asarray(s[::-1] ** 2), np.asarray(vt[::-1].T)
