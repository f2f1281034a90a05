"""Where what a model leaves stands out: what to look at where nothing that was found explains it."""

from __future__ import annotations

import numpy as np

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.standing_out import FAR, Left, column_words, row_words


def left_words(diagnosis: Diagnosis) -> str:
    """Return the rows that stand out and what is wrong with them, else by how much each column is off."""
    fit, recording = diagnosis.after, diagnosis.recording
    places = np.flatnonzero(~recording.validation & np.isfinite(fit.residual).all(axis=1))
    left = Left.of(fit.residual[places], places, FAR)
    return row_words(fit.nominal, recording, left) or column_words(fit.nominal, left)


__all__ = ["left_words"]
