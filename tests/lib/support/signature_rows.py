"""Rows of [J G r] of the fitted readings: geometry, every candidate and the residual, written out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from truepose.identification.fit.estimated import Estimate
from truepose.identification.signatures.signatures import Point, Signatures


def columns_at(signatures: Signatures, fit: Estimate) -> NDArray[np.float64]:
    """(k, free + width + 1) at a fit."""
    free = fit.prior.free
    at = Point.of(fit, free[free < len(signatures.machine.parameters)])
    blocks = signatures.stacked(at, None)
    return np.vstack([block.reshape(-1, block.shape[2]) for block in blocks])
