"""A linearised problem: what geometry and every candidate do to the readings, as Gram matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.models.effects.base import PlacedEffect


@dataclass(frozen=True)
class Linearisation:
    """Gram matrices of [J G r] over the fitted readings at a fit, one for each kind of channel.

    J: free geometry in units of its prior scale (``free`` columns). G: candidates' coefficients in units of their
    scale, or directions of many of them (``turns``); ``columns[k]`` are those of candidate k. r: whitened residual.
    ``departure`` says how far the fit is from the drawing and from zero coefficients, so that any subset of candidates can be
    weighed from these matrices alone.
    """

    grams: tuple[Array, ...]
    counts: tuple[int, ...]
    free: int
    columns: tuple[slice, ...]
    departure: Array
    weight: Array
    parts: tuple[PartClass, ...]
    candidates: tuple[PlacedEffect, ...]
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

    def among(self, rows: Index, columns: Index) -> Array:
        """(k, l) entries of ``gram``."""
        at = np.ix_(rows, columns)
        return np.asarray(sum((gram[at] for gram in self.grams[1:]), self.grams[0][at]))

    def bare(self) -> Linearisation:
        """Of geometry and residual alone."""
        kept = np.append(np.arange(self.free), len(self.grams[0]) - 1)
        grams = tuple(gram[np.ix_(kept, kept)] for gram in self.grams)
        departure = self.departure[: self.free]
        return Linearisation(grams, self.counts, self.free, (), departure, self.weight, self.parts, ())

    @property
    def n_observations(self) -> int:
        """Readings of all kinds."""
        return sum(self.counts)

    def indices(self, chosen: Sequence[int]) -> list[int]:
        """Columns of G of the chosen candidates."""
        return [k for i in chosen for k in range(self.columns[i].start, self.columns[i].stop)]
