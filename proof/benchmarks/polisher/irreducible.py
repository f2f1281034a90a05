"""Both ways of the paper's section 4.1 to an irreducible set of source errors (T. Huang et al., hybrid polishing robot).

* ``sequential_subset``: column by column in a given order; what adds nothing new is left out (second way).
* ``spectral_reduction``: combinations along the eigenvectors of H'H (first way). A combination is no part of the machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.fit.decomposition import ROUNDING, Decomposition
from truepose.identification.identifiability.observability import Columns, Subset, extended, subset_of
from truepose.wording import close_matches

NEW_SHARE = 1e-8
"""Share of a column's own length that must stand out of the columns kept, to count as new."""


@dataclass(frozen=True)
class SpectralReduction:
    """Combinations that the readings see: eigenvalues (r,) of H'H, largest first, directions (r, n) in steps.

    The reduced Jacobian is H directions' (n readings, r), of full column rank.
    """

    names: tuple[str, ...]
    eigenvalues: Array
    directions: Array


def sequential_subset(
    columns: Columns,
    first: Sequence[str] = (),
    *,
    order: Iterable[str] | None = None,
    tolerance: float = NEW_SHARE,
) -> Subset:
    """Columns in order (those of ``first`` before all), each kept when it raises the rank.

    A column raises it when its part outside the span of the kept ones exceeds ``tolerance`` of its own length.
    ``order`` defaults to that of the columns; what it does not name is left out. Raises InputError for an
    unknown name.
    """
    wanted = list(dict.fromkeys([*first, *(columns.names if order is None else order)]))
    for name in wanted:
        if name not in columns.names:
            raise InputError(f"found no free parameter {name!r}; {close_matches(name, columns.names)}")
    largest = float(np.max(np.linalg.norm(columns.factor, axis=0), initial=0.0))
    basis, kept = np.zeros((len(columns.factor), 0)), list[int]()
    for name in wanted:
        k = columns.names.index(name)
        column = columns.factor[:, k]
        new = column - basis @ (basis.T @ column)
        length = float(np.linalg.norm(column))
        if length > ROUNDING * largest and np.linalg.norm(new) > tolerance * length:
            basis = extended(basis, column)
            kept.append(k)
    return subset_of(columns, kept)


def spectral_reduction(columns: Columns) -> SpectralReduction:
    """Eigenvectors of H'H whose eigenvalues are not zero."""
    parts = Decomposition.of(columns.factor, np.zeros(len(columns.names)))
    return SpectralReduction(columns.names, parts.singular[: parts.rank] ** 2, parts.seen)
