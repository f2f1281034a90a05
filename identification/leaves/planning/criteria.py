"""When is a set of poses better than another? Criteria of the information that its readings hold.

All are functions of the eigenvalues of an information matrix, which makes their gradients exact in one line.
``d`` and ``a`` weigh the readings together with the tolerances (Bayesian), so that a direction nothing can see
costs nothing; ``o1`` to ``o5`` are the observability indices of the readings alone, on the directions that
poses of this machine can show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array

OPEN = 1e-28
"""A direction is open when its share of the information is below this: rounding of singular values, squared."""


@dataclass(frozen=True)
class Criterion:
    """What is maximised: ``value`` of the eigenvalues (..., k), ascending, and its derivative ``slope`` by them.

    ``with_prior``: the information includes that of the tolerances. ``determinant``: the value is log det.
    """

    name: str
    title: str
    with_prior: bool
    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    determinant: bool = False


def _log_sum(power: float, factor: float) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """factor * log(sum of eigenvalue^power) with its slope."""

    def value(w: Array) -> Array:
        return np.asarray(factor * np.log(np.sum(w**power, axis=-1)))

    def slope(w: Array) -> Array:
        return np.asarray(factor * power * w ** (power - 1.0) / np.sum(w**power, axis=-1, keepdims=True))

    return value, slope


def _ends(least: float, largest: float) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """least * log(smallest eigenvalue) + largest * log(largest eigenvalue) with its slope."""

    def value(w: Array) -> Array:
        return np.asarray(least * np.log(w[..., 0]) + largest * np.log(w[..., -1]))

    def slope(w: Array) -> Array:
        out = np.zeros_like(w)
        out[..., 0] += least / w[..., 0]
        out[..., -1] += largest / w[..., -1]
        return out

    return value, slope


def _log_det(w: Array) -> Array:
    return np.asarray(np.sum(np.log(w), axis=-1))


def _log_det_slope(w: Array) -> Array:
    return np.asarray(1.0 / w)


# singular values of the Jacobian are roots of the eigenvalues: log O = 1/2 of the same in eigenvalues
CRITERIA: Mapping[str, Criterion] = {
    c.name: c
    for c in (
        Criterion("d", "log det(J'J + prior)", True, _log_det, _log_det_slope, True),
        Criterion("a", "-log trace (J'J + prior)^-1", True, *_log_sum(-1.0, -1.0)),
        Criterion("o1", "log det J'J", False, _log_det, _log_det_slope, True),
        Criterion("o2", "log (s_min / s_max)", False, *_ends(0.5, -0.5)),
        Criterion("o3", "log s_min", False, *_ends(0.5, 0.0)),
        Criterion("o4", "log (s_min^2 / s_max)", False, *_ends(1.0, -0.5)),
        Criterion("o5", "-log sum 1/s", False, *_log_sum(-0.5, -1.0)),
    )
}
"""By name. o1 Borm and Menq, o2 Driels and Pathre, o3 and o4 Nahvi and Hollerbach 1996, o5 Sun and Hollerbach 2008."""


@dataclass(frozen=True)
class Objective:
    """A criterion in the coordinates it is judged in: ``basis`` (k, r); ``prior`` (r, r), root of its information.

    Values come from singular values of the rows: the information has the square of their condition, and its
    small eigenvalues would be lost in rounding. The information itself serves to rank candidates.
    """

    criterion: Criterion
    basis: Array
    prior: Array

    def project(self, rows: Array) -> Array:
        """Rows of a Jacobian (..., k) in the objective's r directions: (..., r)."""
        return np.asarray(rows @ self.basis)

    def value(self, rows: Array) -> float:
        """Criterion of projected rows (n, m, r); -inf where they leave a direction open."""
        w, _ = self._spectrum(rows)
        return float(self.criterion.value(w)) if w[0] > OPEN * w[-1] else -np.inf

    def slope(self, rows: Array) -> Array:
        """(r, r) symmetric derivative of the criterion by the information, at projected rows."""
        w, v = self._spectrum(rows)
        return np.asarray((v * self.criterion.slope(np.maximum(w, OPEN * w[-1]))) @ v.T)

    def whitening(self, rows: Array) -> Array:
        """(r, r) W with W W' the inverse of the information at projected rows."""
        w, v = self._spectrum(rows)
        return np.asarray(v / np.sqrt(w))

    def information(self, rows: Array) -> Array:
        """(r, r) information of projected rows (n, m, r) and prior."""
        flat = rows.reshape(-1, rows.shape[-1])
        return np.asarray(flat.T @ flat + self.prior.T @ self.prior)

    def ranks(self, matrices: Array) -> Array:
        """(c,) criterion of information matrices (c, r, r), as well as these hold it."""
        w = np.linalg.eigvalsh(matrices)
        good = w[:, 0] > OPEN * w[:, -1]
        return np.where(good, self.criterion.value(np.where(good[:, None], w, 1.0)), -np.inf)

    def _spectrum(self, rows: Array) -> tuple[Array, Array]:
        """Eigenvalues of the information, ascending, and eigenvectors as columns."""
        stacked = np.vstack([rows.reshape(-1, rows.shape[-1]), self.prior])
        _, s, vt = np.linalg.svd(np.linalg.qr(stacked, mode="r"), full_matrices=False)
        return np.asarray(s[::-1] ** 2), np.asarray(vt[::-1].T)
