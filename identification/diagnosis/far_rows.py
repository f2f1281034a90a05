"""Rows that a calibration does not fit, to be looked at before its model is suspected: typing errors, a lost beam.

A fit that trusts every row is pulled by them, so a fit that bends for outliers is asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis.outliers import bridges, outlying_rows
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimate import Estimate, estimate

APART = 2.0
"""How much farther than all others a row must be: physics that was left out has its largest residuals, too."""


@dataclass(frozen=True)
class FarRow:
    """A row of a file (its first line of data is row 1), and its largest residual in sigmas."""

    file: str
    row: int
    sigma: float


def far_rows(found: Calibration) -> tuple[FarRow, ...]:
    """Rows whose residuals chance would not make, farthest first; empty where none stands out from the others."""
    recording, fit = found.recording, _robust(found)
    if fit is None:
        return ()
    own = ~recording.validation & ~bridges(recording) & np.isfinite(fit.residual).all(axis=1)
    far, size = outlying_rows(fit, recording, own), np.max(np.abs(fit.residual), axis=1)
    far &= size > APART * np.max(size[own & ~far], initial=0.0)
    ranked = sorted(np.flatnonzero(far).tolist(), key=lambda k: -size[k])
    files, rows = recording.source_file, recording.source_row
    return tuple(FarRow(recording.files[files[k]], int(rows[k]), float(size[k])) for k in ranked)


def _robust(found: Calibration) -> Estimate | None:
    """A fit that far rows do not pull; None where there is none."""
    fit = found.fit
    if found.method["estimator"] == "huber":
        return fit
    try:
        return estimate(fit.machine, found.recording, fit.effects, start=fit.p, loss="huber")
    except ConvergenceError:
        return None


__all__ = ["FarRow", "far_rows"]
