"""A linearised problem: what geometry, every candidate and errors of form do to the readings, as Gram matrices.

Errors of form: a formula is right to some percent, so a large effect brings smooth deviations of its own.

The fitted signal of each cause (an effect at a place, all its terms together) is modulated by the first two Chebyshev
polynomials of every joint and driver. Without them a large effect of slightly other form needs small false names beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.prior import FORM_ERROR
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
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
        ends = ((v, float(v[used].min()), float(v[used].max())) for v in varied.values())
        each = (np.clip(scaled(values, low, high), -1.0, 1.0) for values, low, high in ends)
        pairs = [np.column_stack(chebyshev(t, PAIR)[1:]) for t in each]
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


@dataclass(frozen=True)
class Linearisation:
    """Gram matrices of [J G F r] over the fitted readings at a fit, one for each kind of channel.

    J: free geometry in units of its prior scale (``free`` columns). G: candidates' coefficients in units of their
    scale, or directions of many of them (``turns``); ``columns[k]`` are those of candidate k. F: errors of form of the
    fit's effects, in units of their own prior 1-sigma (``forms`` columns). r: whitened residual. ``departure`` says how
    far the fit is from the drawing and from zero coefficients, so that any subset of candidates can be weighed from these
    matrices alone.
    """

    grams: tuple[Array, ...]
    counts: tuple[int, ...]
    free: int
    columns: tuple[slice, ...]
    forms: int
    departure: Array
    weight: Array
    parts: tuple[PartClass, ...]
    candidates: tuple[PlacedEffect, ...]
    bent: tuple[tuple[int, ...], ...] = ()
    """Candidates of each cause whose signal the errors of form bend, in their order; each has as many columns of F."""
    sources: tuple[str, ...] = ()
    """Joints and drivers that bend them, ``PAIR`` columns each."""
    turns: tuple[Array | None, ...] = ()
    """Of each candidate the directions (c, r) of its coefficients that columns stand for; None: the coefficients."""

    def turn(self, candidate: int) -> Array:
        """(c, r) from the columns of a candidate to its coefficients."""
        turn = self.turns[candidate] if self.turns else None
        return np.eye(len(self.candidates[candidate].coefficients)) if turn is None else turn

    @property
    def gram(self) -> Array:
        """All kinds of channels together."""
        return np.asarray(sum(self.grams[1:], self.grams[0]))

    def among(self, rows: Index, columns: Index | None = None) -> Array:
        """(k, l) entries of ``gram``, (k, k) where no columns are given."""
        at = np.ix_(rows, rows if columns is None else columns)
        return np.asarray(sum((gram[at] for gram in self.grams[1:]), self.grams[0][at]))

    def bare(self) -> Linearisation:
        """Of geometry and residual alone."""
        kept = np.append(np.arange(self.free), len(self.grams[0]) - 1)
        grams = tuple(gram[np.ix_(kept, kept)] for gram in self.grams)
        departure = self.departure[: self.free]
        return Linearisation(grams, self.counts, self.free, (), 0, departure, self.weight, self.parts, ())

    @property
    def n_observations(self) -> int:
        """Readings of all kinds."""
        return sum(self.counts)

    def indices(self, chosen: Sequence[int]) -> list[int]:
        """Columns of G of the chosen candidates."""
        return [k for i in chosen for k in range(self.columns[i].start, self.columns[i].stop)]
