"""The linear model as sums over its readings, and the grid of what is not known of its noise and priors.

    e = A a + G c + noise,   noise ~ N(0, k^2) for each kind of channel,   a ~ N(0, (l s)^2),   c ~ N(0, q^2)

e: whitened residual at the drawing. A: what every model has: geometry under its tolerances, and the remainder, smooth
functions whose size tau nobody knows. G: columns of the terms. Only Gram matrices of [A G e] are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
UNSEEN = 1e-9
"""Share of a column's own length below which what is left of it is rounding."""


@dataclass(frozen=True)
class Always:
    """The columns A (n,) of every model: 1-sigma of each (inf: no prior), and its class of parts, -1 for none.

    ``remainder`` (n,) marks those whose 1-sigma is to be multiplied by tau.
    """

    sigma: Array
    part: NDArray[np.intp]
    remainder: NDArray[np.bool_]


@dataclass(frozen=True)
class Design:
    """Gram matrices (n + w + 1 square) of [A G e] for each kind of channel, with the number of readings of each."""

    grams: tuple[Array, ...]
    counts: tuple[int, ...]
    always: Always

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """(w,) columns of terms of which those of A without a prior leave more than rounding."""
        flat = np.flatnonzero(~np.isfinite(self.always.sigma))
        gram = np.asarray(sum(self.grams[1:], self.grams[0]))
        length = np.diag(gram)[self.n : -1]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(gram)[flat], 1e-300))
        own = gram[np.ix_(flat, flat)] * scale[:, None] * scale + 1e-12 * np.eye(len(flat))
        across = gram[flat, self.n : -1] * scale[:, None]
        half = np.linalg.solve(np.linalg.cholesky(own), across) if len(flat) else across
        return np.asarray((length > 0.0) & (length - np.sum(half**2, axis=0) > UNSEEN * length))

    def restricted(self, columns: NDArray[np.intp]) -> Design:
        """With some columns of terms only."""
        keep = np.concatenate([np.arange(self.n), self.n + columns, [self.n + self.width]])
        part = Design(tuple(gram[np.ix_(keep, keep)] for gram in self.grams), self.counts, self.always)
        part.__dict__["seen"] = self.seen[columns]
        return part

    @property
    def n(self) -> int:
        """Number of columns that every model has."""
        return len(self.always.sigma)

    @property
    def width(self) -> int:
        """Number of columns of all terms."""
        return len(self.grams[0]) - self.n - 1


@dataclass(frozen=True)
class Axis:
    """Values of one unknown, in rising order or any other, with the log prior of each; ``near``: neighbours are alike."""

    values: tuple[float, ...]
    log_prior: tuple[float, ...]


Point = tuple[int, ...]
"""Indices on the axes: a noise for each kind of channel, a widening of tolerances, the remainder's size."""


@dataclass(frozen=True)
class Unknowns:
    """The grid: noise (values of k) for each kind, rows of ``widening`` (one factor a class of parts), ``size`` of the
    remainder."""

    noise: tuple[Axis, ...]
    widening: tuple[tuple[float, ...], ...]
    log_widening: tuple[float, ...]
    size: Axis

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis of a point."""
        return (*(len(a.values) for a in self.noise), len(self.widening), len(self.size.values))

    def log_prior(self, point: Point) -> float:
        """Of a point; the first noise is paid by how far it is from stated, others by how far they are from the first."""
        *noise, widening, size = point
        own = [a.log_prior[k] for a, k in zip(self.noise, noise, strict=True)]
        steps = [np.log(a.values[k]) for a, k in zip(self.noise, noise, strict=True)]
        apart = [ratio_log_prior(step - steps[0]) for step in steps[1:]]
        return own[0] + sum(apart) + self.log_widening[widening] + self.size.log_prior[size]


def ratio_log_prior(step: float) -> float:
    """Kinds of channel come from one instrument: their sigmas are mostly off by one factor, and sometimes each by its own."""
    together = np.log(0.7 / 0.1) - 0.5 * (step / 0.1) ** 2
    apart = np.log(0.3 / 0.6) - 0.5 * (step / 0.6) ** 2
    return float(np.logaddexp(together, apart))


def stated_log_prior(values: Sequence[float]) -> tuple[float, ...]:
    """Stated sigmas are mostly right and sometimes far off."""
    step = np.log(values)
    right = np.log(0.7 / 0.1) - 0.5 * (step / 0.1) ** 2
    off = np.log(0.3 / 0.8) - 0.5 * (step / 0.8) ** 2
    return tuple(np.logaddexp(right, off).tolist())
