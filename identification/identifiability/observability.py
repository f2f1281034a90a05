"""Which parameters the readings determine, and which combinations they cannot see.

``Knowledge`` is what readings and tolerances say of the free parameters, of a fit or of one to come.
``unseen`` and ``nearly_unseen`` give directions that one parameter each leads.

Remarks beside results, as data: the report words them.

A set of parameters that the readings can tell apart, found from the Jacobian and not listed by hand.

Pivoted QR: what shows most within its tolerance is kept first. ``subset_of`` completes a set that was chosen otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.fit.decomposition import ROUNDING, TAKES_PART, Decomposition
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.problem import Prior
from truepose.models.machine.machine import FRAME_OF

Kind = Literal[
    "unassembled", "crossing", "validation", "own class", "nameless", "payload", "strokes", "creep", "motions", "unread"
]  # fmt: skip


@dataclass(frozen=True)
class Note:
    """A remark of some kind about a row, a name or a driver."""

    kind: Kind
    about: str = ""


LEAST_GAIN = 0.5
"""Readings determine a parameter when they at least halve the variance that its tolerance leaves."""
SMALLEST_PART = 0.02
SMALLEST_LEAD = 0.1
LEVER = 300.0
"""mm at which angles are compared with lengths where the readings do not tell."""
FAINT = 1e-9
"""A column below this share of the largest is rounding."""


@dataclass(frozen=True)
class Knowledge:
    """Free entries (n): names, units, values at which the readings' Jacobian was taken, 1-sigma of the prior
    (inf without), steps; and the Jacobian's decomposition in these steps."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    sigma: Array
    scale: Array
    decomposition: Decomposition

    @classmethod
    def of(cls, fit: Estimate) -> Knowledge:
        """What a fit knows."""
        units = fit.nominal.with_effects(fit.effects).parameter_units
        return cls.at(fit.prior, units, fit.p, fit.decomposition)

    @classmethod
    def at(cls, prior: Prior, units: Mapping[str, str], p: Array, decomposition: Decomposition) -> Knowledge:
        """What is known at the parameters ``p`` (np,)."""
        free = prior.free
        names = tuple(prior.names[k] for k in free)
        return cls(
            names,
            tuple(units[n] for n in names),
            p[free],
            prior.sigma[free],
            prior.scale[free],
            decomposition,
        )

    @property
    def std(self) -> Array:
        """(n,) 1-sigma from readings and tolerances together; inf where neither holds."""
        return self.decomposition.std * self.scale

    @cached_property
    def lever(self) -> Array:
        """(n,) mm that shows in the readings as much as one unit does: 1 for lengths, an arm for angles.

        Entries of one unit share the median of their columns of the Jacobian; without one, ``LEVER`` serves.
        """
        column = self.decomposition.lengths / self.scale
        mm = _typical(column, [unit == "mm" for unit in self.units])
        out = np.ones(len(self.names))
        for unit in set(self.units) - {"mm"}:
            same = [other == unit for other in self.units]
            ratio = _typical(column, same) / mm if mm else 0.0
            fallback = LEVER if unit == "rad" else LEVER * 1e-3 / self.scale[same]
            out[same] = ratio or fallback
        return out

    def physical(self, directions: Array) -> Array:
        """(k, n) orthonormal directions, in mm at a lever, that span the same as ``directions`` (k, n) in steps."""
        if not len(directions):
            return directions
        return np.linalg.qr((directions * self.scale * self.lever).T)[0].T


def _typical(column: Array, among: Sequence[bool]) -> float:
    """Median size of those columns that the readings see, 0 without any."""
    some = column[among][column[among] > FAINT * np.max(column, initial=0.0)]
    return float(np.median(some)) if len(some) else 0.0


@dataclass(frozen=True)
class Direction:
    """Parameters that move together: by how much (mm, rad, or the unit of an effect), the leading one first.

    ``size`` is how far the readings see it, in sigmas for one step in tolerances; 0 when they do not.
    ``open_ended``: no tolerance holds it either.
    """

    parts: Mapping[str, float]
    size: float = 0.0
    open_ended: bool = False


def identifiable(fit: Estimate) -> Mapping[str, bool]:
    """For each free entry: no unseen direction moves it, and the readings halve its variance at least.

    What is identifiable has a finite 1-sigma (``Estimate.std``), with tolerances and without.
    """
    known = Knowledge.of(fit)
    return {name: bool(flag) for name, flag in zip(known.names, determined(known), strict=True)}


def determined(known: Knowledge, std: Array | None = None, blind: Array | None = None) -> Mask:
    """(n,) the same for what is known; ``std`` (n,) and unseen directions ``blind`` (k, n) default to its own."""
    std = known.std if std is None else std
    moved = shares(known, known.decomposition.null_space if blind is None else blind)
    return (moved < TAKES_PART) & np.isfinite(std) & (std**2 <= LEAST_GAIN * known.sigma**2)


def shares(known: Knowledge, directions: Array) -> Array:
    """(n,) how much of each entry directions (k, n) in steps move at most, in mm at a lever."""
    if not len(directions):
        return np.zeros(len(known.names))
    out: Array = np.max(np.abs(known.physical(directions)), axis=0)
    return out


def unseen(known: Knowledge, directions: Array | None = None) -> tuple[Direction, ...]:
    """The directions that the readings cannot see, or ``directions`` (k, n) in steps; frames lead where they can.

    Those of the fewest parts come first.
    """
    rows = known.decomposition.null_space if directions is None else directions
    found = [_direction(known, row) for row in _sparse(known.physical(rows), known.names)]
    return tuple(sorted(found, key=lambda d: len(d.parts)))


def nearly_unseen(known: Knowledge) -> tuple[Direction, ...]:
    """Directions that the readings see worse than the tolerances say, the least seen first.

    Entries of infinite tolerance follow freely. ``size`` below 1: the readings alone would leave 1 / size
    tolerances.
    """
    bounded = np.isfinite(known.sigma)
    parts = known.decomposition
    wide = parts.singular[: parts.rank, None] * parts.seen
    free, held = wide[:, ~bounded], wide[:, bounded] * (known.sigma / known.scale)[bounded]
    left = Decomposition.of(free.T, np.zeros(len(free))).seen if free.size else np.zeros((0, len(wide)))
    own = held - left.T @ (left @ held)
    found = Decomposition.of(own, np.ones(int(bounded.sum())))
    weak = found.singular[: found.rank] < 1.0
    rows = np.zeros((int(weak.sum()), len(known.names)))
    rows[:, bounded] = found.seen[weak] * (known.sigma / known.scale)[bounded]
    out = []
    for row in _sparse(known.physical(rows), known.names):
        step = (row / known.lever / known.sigma)[bounded]
        size = float(np.linalg.norm(own @ step) / np.linalg.norm(step))
        out.append(_direction(known, row, size))
    return tuple(sorted(out, key=lambda d: d.size))


def _direction(known: Knowledge, row: Array, size: float = 0.0) -> Direction:
    """From a row in mm at a lever."""
    order = np.argsort(-np.round(np.abs(row), 6), kind="stable")
    parts = [int(k) for k in order if abs(row[k]) >= SMALLEST_PART]
    open_ended = all(np.isinf(known.sigma[k]) for k in parts)
    return Direction({known.names[k]: float(row[k] / known.lever[k]) for k in parts}, size, open_ended)


def _sparse(basis: Array, names: Sequence[str]) -> Array:
    """The same directions, each led by one parameter that no other one moves: frames first; largest part 1.

    ``basis`` (k, n) has orthonormal rows. Which parameters lead follows from the space alone, so that it does not matter how
    a processor has turned its basis.
    """
    pivots = _pivots(basis, [k for k, name in enumerate(names) if name in FRAME_OF])
    rows = np.linalg.solve(basis[:, pivots], basis)
    return np.asarray(rows / np.max(np.abs(rows), axis=1, keepdims=True) if len(rows) else rows)


def _pivots(basis: Array, frames: Sequence[int]) -> list[int]:
    """The columns that lead: frames that take part, then always what is moved most by what is left, the first of equals."""
    left, out = basis.copy(), list[int]()

    def taken(pivot: int) -> Array:
        along = left[:, pivot] / np.linalg.norm(left[:, pivot])
        return np.asarray(left - np.outer(along, along @ left))

    for pivot in frames:
        moved = left[:, pivot] @ left  # the shortest change that moves it
        if len(out) < len(basis) and moved[pivot] > max(SMALLEST_LEAD * np.max(np.abs(moved)), FAINT):
            left = taken(pivot)
            out.append(pivot)
    while len(out) < len(basis):
        out.append(int(np.argmax(np.round(np.sum(left**2, axis=0), 6))))
        left = taken(out[-1])
    return out


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
