"""Rows of a fit in which forms of several sources are screened: slopes by ports, what is left, what the fit may still do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from truepose.arrays import Array, Index
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.signatures.signatures import Signatures

ROWS = 400
"""Rows that are screened at most, spread evenly: what stands out shows in some. Cost alone."""
STIFF = 1e6
"""1-sigma, in units of the noise, of what a parameter without a prior does to the readings."""


@dataclass(frozen=True)
class ScreenedRows:
    """Some rows of a fit, whitened and weighed.

    index (n,): of the recording; slopes (n, k, p): of predictions by the ``ports``; residual (n, m); known (n, m, u): what
    geometry and effects of the fit may still do, N(0, 1) each; changes: turns (n, k, w) of predictions into (n, m, w) of
    residuals; by_row: whether every reading stands for itself, so that the two are the same.
    """

    index: Index
    ports: Mapping[str, int]
    slopes: Array
    residual: Array
    known: Array
    changes: Callable[[Array], Array]
    by_row: bool
    loads: Mapping[str, Array]

    @cached_property
    def flat(self) -> Array:
        """(n m, u) what geometry and effects may do, of all readings."""
        return self.known.reshape(-1, self.known.shape[2])

    @cached_property
    def factor(self) -> tuple[Array, bool]:
        """Cholesky factor of I + U'U, U what geometry and effects may do."""
        return cho_factor(self.flat.T @ self.flat + np.eye(self.flat.shape[1]))

    @cached_property
    def left(self) -> Array:
        """(n, m) residual without what geometry and effects may take of it."""
        residual = self.residual.reshape(-1)
        taken = self.flat @ cho_solve(self.factor, self.flat.T @ residual)
        return np.asarray((residual - taken).reshape(self.residual.shape))


def screened_rows(signatures: Signatures, fit: Estimate, ports: Sequence[str]) -> ScreenedRows:
    """Return the rows of a fit; all of them where readings compare rows, else ``ROWS`` at most."""
    predictor, by_row = signatures.predictor(fit.effects), signatures.by_row
    index = np.flatnonzero(fit.used) if by_row else np.arange(len(fit.used))
    if by_row and len(index) > ROWS:
        index = index[np.linspace(0, len(index) - 1, ROWS).astype(np.intp)]
    some = predictor.of_rows(index) if by_row else predictor
    p = np.concatenate([fit.p, np.zeros(len(predictor.model.names) - len(fit.p))])
    weights, x = fit.used[index] * fit.weights[index], fit.x[index]
    root = np.sqrt(weights)[:, None, None]
    at = [predictor.model.names.index(port) for port in ports]
    blocks = list(some.blocks(p, x, weights))
    slopes = np.concatenate([block.here[:, :, at] for block in blocks])
    known = np.concatenate([block.jacobian[:, :, fit.prior.free] for block in blocks]) * root
    residual = np.concatenate([block.residual for block in blocks]) * root[..., 0]

    def changes(change: Array) -> Array:
        return np.concatenate([block.changes(change[block.rows]) for block in blocks]) * root

    steps = _steps(known, fit.prior.sigma[fit.prior.free])
    return ScreenedRows(
        index, {port: k for k, port in enumerate(ports)}, slopes * root if by_row else slopes,
        np.nan_to_num(residual), known * steps, changes, by_row, _loads(some, p, x),
    )  # fmt: skip


def _steps(known: Array, sigma: Array) -> Array:
    """(u,) 1-sigma of each free parameter; of one without a prior so much that it is free beside the noise."""
    most = STIFF / np.maximum(np.sqrt(np.sum(known**2, axis=(0, 1))), 1e-300)
    return np.asarray(np.minimum(np.where(np.isfinite(sigma), sigma, np.inf), most))


def _loads(predictor: Predictor, p: Array, x: Array) -> Mapping[str, Array]:
    """(n,) load at the displacement of each joint; none where nothing weighs."""
    machine = predictor.machine
    return predictor.loads(p, x) if machine.loaded else {}
