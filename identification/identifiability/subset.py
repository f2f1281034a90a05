"""A set of parameters that the readings can tell apart, found from the Jacobian and not listed by hand.

Pivoted QR: what shows most within its tolerance is kept first. ``subset_of`` completes a set that was chosen otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.identification.fit.decomposition import ROUNDING, Decomposition
from truepose.identification.fit.estimated import Estimate

TIE = 1e-6
"""Columns whose lengths agree to this share are equal: the first in order is taken, whatever rounding says."""
SMALLEST_TERM = 1e-6
"""Terms of a relation below this share of its largest, in steps, are rounding."""


@dataclass(frozen=True)
class Columns:
    """Jacobian H of the readings (in sigmas) by named parameters: a triangular factor (k, n) or all rows,
    each column for a step ``scale`` (n,) of its parameter."""

    names: tuple[str, ...]
    factor: Array
    scale: Array

    @classmethod
    def of(cls, fit: Estimate) -> Columns:
        """Of a fit, at its parameters."""
        free = fit.prior.free
        names = tuple(fit.prior.names[k] for k in free)
        return cls(names, fit.slopes, fit.prior.scale[free])

    @property
    def rank(self) -> int:
        """How many columns can be independent."""
        return Decomposition.of(self.factor, np.zeros(len(self.names))).rank


@dataclass(frozen=True)
class Subset:
    """Parameters kept, in the order they were taken; for each one left out the kept ones that show like it.

    ``relations[left][kept]``: so many units of ``kept`` show in the readings as one unit of ``left`` does.
    ``condition``: of the kept columns, in steps.
    """

    kept: tuple[str, ...]
    relations: Mapping[str, Mapping[str, float]]
    condition: float


def independent_subset(columns: Columns, *, least: float = 0.0) -> Subset:
    """A maximal set of independent columns: each time the one whose new part is longest.

    With ``least`` > 0 the new part must be so many sigmas for one step: 1 leaves out what its tolerance tells
    better than the readings would.
    """
    left, kept = columns.factor.astype(float), list[int]()
    basis = np.zeros((len(left), 0))
    for _ in range(columns.rank):
        lengths = np.linalg.norm(left, axis=0)
        lengths[kept] = -1.0
        longest = float(np.max(lengths))
        if longest <= least:
            break
        chosen = int(np.flatnonzero(lengths >= (1.0 - TIE) * longest)[0])
        basis = extended(basis, columns.factor[:, chosen])
        kept.append(chosen)
        left = columns.factor - basis @ (basis.T @ columns.factor)
    return subset_of(columns, kept)


def extended(basis: Array, column: Array) -> Array:
    """``basis`` (k, m) with ``column`` (k,) as one more orthonormal vector. Projected twice: enough against rounding."""
    for _ in range(2):
        column = column - basis @ (basis.T @ column)
    return np.column_stack([basis, column / np.linalg.norm(column)])


def subset_of(columns: Columns, kept: Sequence[int]) -> Subset:
    """The set of the columns ``kept``, by their numbers, and what each other column shows like."""
    matrix = columns.factor[:, kept]
    others = [k for k in range(len(columns.names)) if k not in set(kept)]
    shown = np.linalg.norm(columns.factor, axis=0)
    terms = np.zeros((len(kept), len(others)))
    if len(kept):
        terms = np.asarray(np.linalg.lstsq(matrix, columns.factor[:, others], rcond=None)[0], dtype=float)
    relations = {}
    for term, k in zip(terms.T, others, strict=True):
        size = float(np.max(np.abs(term), initial=0.0)) if shown[k] > ROUNDING * np.max(shown) else np.inf
        relations[columns.names[k]] = {
            columns.names[i]: float(value * columns.scale[i] / columns.scale[k])
            for value, i in zip(term, kept, strict=True)
            if abs(value) > SMALLEST_TERM * size
        }
    singular = np.linalg.svd(matrix, compute_uv=False)
    condition = float(singular[0] / singular[-1]) if len(singular) else 0.0
    return Subset(tuple(columns.names[k] for k in kept), relations, condition)
