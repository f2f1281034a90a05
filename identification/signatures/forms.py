"""Errors of form: a formula is right to some percent, so a large effect brings smooth deviations of its own.

The fitted signal of each cause (an effect at a place, all its terms together) is modulated by the first two Chebyshev
polynomials of every joint and driver. Without them a large effect of slightly other form needs small false names beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.prior import FORM_ERROR
from truepose.identification.recording.recording import Recording
from truepose.models.effects.empirical import chebyshev, scaled

PAIR = 2
"""Modulations of a source: its first two polynomials."""
Signal = tuple[Index, Array]
"""Columns of G of one cause's terms, and their fitted coefficients."""


@dataclass(frozen=True)
class Forms:
    """Modulations (n, u) of every row, the signals that are modulated, and the joints and drivers that modulate them, with
    ``PAIR`` modulations each."""

    modulations: Array
    signals: tuple[Signal, ...]
    sources: tuple[str, ...] = ()

    @classmethod
    def none(cls) -> Forms:
        """No errors of form."""
        return cls(np.zeros((0, 0)), ())

    @classmethod
    def of(cls, recording: Recording, used: Mask, signals: Sequence[Signal]) -> Forms:
        """Of the signals, over the ranges of the rows ``used`` (n,)."""
        if not signals:
            return cls.none()
        columns = recording.columns(smooth=True)
        varied = {name: values for name, values in columns.items() if np.ptp(values[used]) > 0}
        pairs = [_chebyshev(values, used) for values in varied.values()]
        phi = np.column_stack(pairs) if pairs else np.zeros((len(used), 0))
        total = np.sqrt(max(float(np.mean(np.sum(phi[used] ** 2, axis=1))), 1e-300)) if pairs else 1.0
        return cls(FORM_ERROR * phi / total, tuple(signals), tuple(varied))

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.signals) * int(self.modulations.shape[1])

    def of_rows(self, rows: Index) -> Array:
        """(k, u) modulations of some rows."""
        return self.modulations[rows] if self.signals else np.zeros((len(rows), 0))

    def columns(self, signature: Array, rows: Index) -> Array:
        """(k, m, width) of rows (k,) with signatures (k, m, w), each N(0, 1)."""
        out = [
            (signature[:, :, at] @ amplitude)[:, :, None] * self.modulations[rows][:, None, :]
            for at, amplitude in self.signals
        ]
        return np.concatenate(out, axis=2) if out else np.zeros((*signature.shape[:2], 0))


def _chebyshev(values: Array, used: Mask) -> Array:
    """(n, PAIR) the first two polynomials over the range of the used rows."""
    t = scaled(values, float(values[used].min()), float(values[used].max()))
    return np.column_stack(chebyshev(np.clip(t, -1.0, 1.0), PAIR)[1:])
