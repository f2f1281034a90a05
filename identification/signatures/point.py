"""Where columns of rows are drawn: what a fit says of effects, parameters and rows, and nothing else of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.estimate import Estimate
from truepose.models.effects.base import PlacedEffect


@dataclass(frozen=True)
class Point:
    """p (np,) parameters then coefficients of the ``effects``; ``free`` (g,) parameters that columns are drawn of, in steps of
    ``scale`` (g,); of n rows the passive coordinates x (n, nx), which are ``used`` (n,), and their ``weights`` (n,)."""

    effects: tuple[PlacedEffect, ...]
    p: Array
    free: Index
    scale: Array
    x: Array
    used: Mask
    weights: Array

    @classmethod
    def of(cls, fit: Estimate, free: Index) -> Point:
        """At a fit."""
        return cls(fit.effects, fit.p, free, fit.prior.scale[free], fit.x, fit.used, fit.weights)

    def of_rows(self, rows: Index) -> Point:
        """The same of some rows (k,)."""
        return replace(self, x=self.x[rows], used=self.used[rows], weights=self.weights[rows])

    def among(self, names: Sequence[str]) -> Array:
        """(k,) p for names that go on with ports behind its own: these are at nothing."""
        return np.concatenate([self.p, np.zeros(len(names) - len(self.p))])
