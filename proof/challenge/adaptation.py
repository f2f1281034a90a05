"""What geometry, bound by its tolerances, can make of a change of readings: how the examiner measures sizes.

With D a whitened change of the fitted readings and J the geometry's derivative in tolerances,
    min over t of |D - J t|^2 + |t|^2  =  D' V^-1 D,    V = I + J J'
is what is left to be seen of it. The root is the signal-to-noise ratio by which sizes are stated. J comes from the
simulator (``slopes``), tolerances and sigma from the drawing.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from challenge.measures import difference
from challenge.slopes import Constant

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LOOSE = 100.0
"""Times which an ordinary free fit widens all tolerances but those of the frames."""
GONE = 1e-8
"""Share of a direction that may be left by rounding when all of it is swallowed."""


class Adaptation:
    """A specimen over a campaign, linear about its true constants.

    clean (n, k): exact readings without imperfection, mm and rad; sigma (k,); slopes (n, k, f) by the constants' steps;
    fitted (n,): rows that are not for validation.
    """

    def __init__(
        self,
        columns: tuple[str, ...],
        clean: Array,
        sigma: Array,
        slopes: Array,
        free: tuple[Constant, ...],
        fitted: Mask,
    ) -> None:
        self.free, self.fitted = free, fitted
        self._columns, self._clean, self._sigma = columns, clean, sigma
        self.jacobian: Array = (slopes / sigma[:, None])[fitted].reshape(-1, len(free))
        """(N, f) whitened readings by the free constants' steps."""

    @property
    def weight(self) -> Array:
        """(f,) what a step of each free constant costs; 0 without a tolerance."""
        return np.array([c.weight for c in self.free])

    def change(self, observed: Array) -> Array:
        """(N,) whitened change of the fitted readings (n, k) since the clean ones."""
        off = difference(observed, self._clean, self._columns) / self._sigma
        return np.asarray(off[self.fitted].ravel())

    def left(self, changes: Array, beside: Sequence[Array] = ()) -> Array:
        """(N + f, c) what of the changes (N, c) neither geometry nor the directions ``beside`` (N,), at any size, follow."""
        return self.beyond(self.bound(changes), beside)

    def bound(self, changes: Array) -> Array:
        """(N + f, c) what of the changes (N, c) geometry within its tolerances does not follow."""
        stacked = np.vstack([changes, np.zeros((len(self.free), changes.shape[1]))])
        out: Array = stacked - self._basis @ (self._basis.T @ stacked)
        return out

    def beyond(self, left: Array, beside: Sequence[Array]) -> Array:
        """(N + f, c) what ``bound`` has left, less what the directions ``beside`` (N,) follow at any size."""
        other = self._directions(beside)
        out: Array = left - other @ (other.T @ left)
        return out

    def snr(self, change: Array, beside: Sequence[Array] = ()) -> float:
        """Signal-to-noise ratio of a change (N,) when geometry adapts within tolerances, and ``beside`` (N,) freely."""
        return float(np.linalg.norm(self.left(change[:, None], beside)))

    def free_chi2(self, change: Array, calm: Mask | None = None) -> float:
        """chi2 per degree of freedom of the ordinary free fit to first order.

        change (N,): of readings with their noise; calm (n,): rows that are fitted among those that may be.
        """
        used = np.repeat(
            (np.ones(len(self.fitted), bool) if calm is None else calm)[self.fitted], self._width
        )
        loose = np.array([c.weight if c.frame else c.weight / LOOSE for c in self.free])
        basis = _span(np.vstack([self.jacobian[used], np.diag(loose)]))
        target = np.append(change[used], np.zeros(len(loose)))
        missed = float(np.sum((target - basis @ (basis.T @ target)) ** 2))
        telling = np.any(self.jacobian[used] != 0.0, axis=1)
        spent = float(np.sum(basis[: len(telling)] ** 2))
        return missed / max(float(telling.sum()) - spent, 1.0)

    @property
    def _width(self) -> int:
        return len(self._columns)

    @cached_property
    def _basis(self) -> Array:
        return _span(np.vstack([self.jacobian, np.diag(self.weight)]))

    def _directions(self, beside: Sequence[Array]) -> Array:
        """(N + f, b) orthonormal: what geometry leaves of the directions that follow freely."""
        if not beside:
            return np.zeros((len(self._basis), 0))
        other = np.column_stack(beside)
        size = np.linalg.norm(other, axis=0)
        left = self.bound(other)[:, size > 0] / size[size > 0]
        shown = np.linalg.norm(left, axis=0)
        return _span(left[:, shown > GONE] / shown[shown > GONE])


def _span(columns: Array) -> Array:
    """Orthonormal basis of what columns of any length span."""
    if not columns.shape[1]:
        return columns
    norms = np.linalg.norm(columns, axis=0)
    left, values, _ = np.linalg.svd(columns / np.where(norms > 0, norms, 1.0), full_matrices=False)
    return np.asarray(left[:, values > 1e-11 * max(values[0], 1e-300)])


__all__ = ["Adaptation"]
