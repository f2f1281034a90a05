"""What may be part of a linear model, as columns with prior odds: all that the posterior knows of physics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class Term:
    """One thing that may be there: its columns, N(0, size^2) each, in units of an expected largest size.

    columns (k,): of the design; cause: number of what it blames (terms of one cause differ in settings or form);
    log_prior: of the term among all terms; log_further: the same where its cause is part of the model already;
    lower, upper (k,): physical bounds; alone: no other term of its cause may stand beside it.
    """

    columns: tuple[int, ...]
    cause: int
    log_prior: float
    log_further: float
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    alone: bool = True


WIDTHS = (1, 2, 4, 6, 12)
"""Numbers of columns to which shorter terms are filled up, with a column that is not there."""


@dataclass(frozen=True)
class SameSize:
    """Terms (c,) of one number k of columns: their columns (c, k), bounds (c, k) and which of them have any (c,).

    ``there`` (c, k) tells columns from fillings, which stand at column 0.
    """

    terms: Index
    columns: Index
    lower: Array
    upper: Array
    bounded: NDArray[np.bool_]
    there: NDArray[np.bool_]

    def of(self, chosen: Index) -> SameSize:
        """Some of these terms."""
        return SameSize(
            self.terms[chosen],
            self.columns[chosen],
            self.lower[chosen],
            self.upper[chosen],
            self.bounded[chosen],
            self.there[chosen],
        )


class Terms:
    """All terms, as arrays."""

    def __init__(self, terms: Sequence[Term], n_causes: int | None = None) -> None:
        self.all = tuple(terms)
        self.columns = tuple(np.array(t.columns, dtype=np.intp) for t in terms)
        self.cause = np.array([t.cause for t in terms], dtype=np.intp)
        self.n_causes = int(self.cause.max(initial=-1)) + 1 if n_causes is None else n_causes
        self._first = np.array([t.log_prior for t in terms])
        self._further = np.array([t.log_further for t in terms])

    def restricted(self, kept: Sequence[int], place: Index) -> Terms:
        """Some of the terms, their columns renumbered by ``place``; causes keep their numbers."""
        terms = [self.all[k] for k in kept]
        moved = [replace(t, columns=tuple(int(place[c]) for c in t.columns)) for t in terms]
        return Terms(moved, self.n_causes)

    def __len__(self) -> int:
        return len(self.all)

    @cached_property
    def by_size(self) -> tuple[SameSize, ...]:
        """Terms grouped by their number of columns, filled up to a few widths."""
        groups: dict[int, list[int]] = {}
        for k, term in enumerate(self.all):
            own = len(term.columns)
            width = next((w for w in WIDTHS if own <= w), own)
            groups.setdefault(width, []).append(k)
        return tuple(self._group(members, width) for width, members in groups.items())

    def _group(self, members: Sequence[int], width: int) -> SameSize:
        def filled(rows: list[Sequence[float]], value: float) -> Array:
            return np.array([[*row, *[value] * (width - len(row))] for row in rows])

        lower = filled([self.all[k].lower for k in members], -np.inf)
        upper = filled([self.all[k].upper for k in members], np.inf)
        columns = filled([self.all[k].columns for k in members], -1).astype(np.intp)
        bounded = np.any(np.isfinite(lower) | np.isfinite(upper), axis=1)
        return SameSize(np.array(members), np.maximum(columns, 0), lower, upper, bounded, columns >= 0)

    @cached_property
    def excludes(self) -> NDArray[np.bool_]:
        """(c, c) pairs that cannot stand together: the same term, columns in common, or a cause that takes one alone."""
        alone = np.array([t.alone for t in self.all], dtype=bool)
        same = self.cause[:, None] == self.cause[None, :]
        out = same & (alone[:, None] | alone[None, :])
        width = 1 + max((int(c.max()) for c in self.columns), default=0)
        used = np.zeros((len(self), width), dtype=np.float32)
        for k, columns in enumerate(self.columns):
            used[k, columns] = 1.0
        return np.asarray(out | (used @ used.T > 0.0))

    def log_prior(self, present: Sequence[int]) -> Array:
        """(c,) log prior of each term beside those present; minus infinity where it cannot stand beside them."""
        out = self._first.copy()
        for cause in {int(self.cause[k]) for k in present}:
            same = self.cause == cause
            out[same] = self._further[same]
        if len(present):
            out[self.excludes[list(present)].any(axis=0)] = -np.inf
        return out

    def log_prior_of(self, present: Sequence[int]) -> float:
        """Log prior of these terms together, whatever their number: the first of a cause pays for it."""
        out, seen = 0.0, set[int]()
        for k in sorted(present, key=lambda k: -self._first[k]):
            cause = int(self.cause[k])
            out += float(self._further[k] if cause in seen else self._first[k])
            seen.add(cause)
        return out
