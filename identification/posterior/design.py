"""The linear model as sums over its readings, and the grid of what is not known of its noise and priors.

    e = A a + G c + noise,   noise ~ N(0, k^2) for each kind of channel,   a ~ N(0, (l s)^2),   c ~ N(0, q^2)

e: whitened residual at the drawing. A: what every model has: geometry under its tolerances, and the remainder, smooth
functions whose size tau nobody knows. G: columns of the terms. Only Gram matrices of [A G e] are needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from truepose.arrays import Array, Index, Mask
from truepose.identification import prior

UNSEEN = 1e-9
"""Share of a column's own length below which what is left of it is rounding."""


@dataclass(frozen=True)
class Always:
    """The columns A (n,) of every model: 1-sigma of each (inf: no prior), and its class of parts, -1 for none.

    ``remainder`` (n,) marks those whose 1-sigma is to be multiplied by tau.
    """

    sigma: Array
    part: Index
    remainder: Mask


@dataclass(frozen=True)
class Design:
    """Gram matrices (n + w + 1 square) of [A G e] for each kind of channel, with the number of readings of each."""

    grams: tuple[Array, ...]
    counts: tuple[int, ...]
    always: Always

    @cached_property
    def seen(self) -> Mask:
        """(w,) columns of terms of which those of A without a prior leave more than rounding."""
        flat = np.flatnonzero(~np.isfinite(self.always.sigma))
        gram = np.asarray(sum(self.grams[1:], self.grams[0]))
        length = np.diag(gram)[self.n : -1]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(gram)[flat], 1e-300))
        own = gram[np.ix_(flat, flat)] * scale[:, None] * scale + 1e-12 * np.eye(len(flat))
        across = gram[flat, self.n : -1] * scale[:, None]
        half = np.linalg.solve(np.linalg.cholesky(own), across) if len(flat) else across
        return np.asarray((length > 0.0) & (length - np.sum(half**2, axis=0) > UNSEEN * length))

    def restricted(self, columns: Index) -> Design:
        """With some columns of terms only."""
        keep = np.concatenate([np.arange(self.n), self.n + columns, [self.n + self.width]])
        part = Design(tuple(gram[np.ix_(keep, keep)] for gram in self.grams), self.counts, self.always)
        part.__dict__["seen"] = self.seen[columns]
        return part

    def turned(self, columns: Index, turn: Array) -> Design:
        """With combinations of some columns of terms in their place: ``turn`` (k, w) of ``columns`` (k,), mostly zeros."""
        first, last, few = np.arange(self.n), self.n + self.width, csr_array(turn)

        def of(gram: Array) -> Array:
            part = np.asarray(gram[:, self.n + columns] @ few)
            own = np.asarray(few.T @ part[self.n + columns])
            rest = np.append(first, last)
            out = np.empty((self.n + turn.shape[1] + 1,) * 2)
            here, there = np.append(first, len(out) - 1), np.arange(self.n, len(out) - 1)
            out[np.ix_(here, here)] = gram[np.ix_(rest, rest)]
            out[np.ix_(here, there)] = part[rest]
            out[np.ix_(there, here)] = part[rest].T
            out[np.ix_(there, there)] = own
            return out

        return Design(tuple(of(gram) for gram in self.grams), self.counts, self.always)

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
    """Values of one unknown, with the log prior of each."""

    values: tuple[float, ...]
    log_prior: tuple[float, ...]


class GridPoint(NamedTuple):
    """Indices on the axes of a grid: the noise of each kind of channel, the widening of tolerances, the remainder's size."""

    noise: tuple[int, ...]
    widening: int
    remainder: int

    def louder(self, steps: int) -> GridPoint:
        """The noise of all kinds moved by so many steps."""
        return self._replace(noise=tuple(k + steps for k in self.noise))

    def at(self, axis: str, value: int) -> GridPoint:
        """Another ``widening`` or ``remainder``."""
        return self._replace(widening=value) if axis == "widening" else self._replace(remainder=value)

    def with_noise(self, kind: int, at: int) -> GridPoint:
        """Another noise of one kind."""
        return self._replace(noise=(*self.noise[:kind], at, *self.noise[kind + 1 :]))


@dataclass(frozen=True)
class Unknowns:
    """The grid: noise (values of k) for each kind, rows of ``widening`` (one factor a class of parts), ``size`` of the
    remainder."""

    noise: tuple[Axis, ...]
    widening: tuple[tuple[float, ...], ...]
    log_widening: tuple[float, ...]
    size: Axis

    @classmethod
    def over(
        cls,
        kinds: int,
        rms: float,
        widenings: tuple[tuple[tuple[float, ...], ...], tuple[float, ...]],
        remainder_rms: float,
    ) -> Unknowns:
        """Noise of so many kinds up to ``rms``, what geometry alone leaves; a remainder up to ``remainder_rms``, 0 for none."""
        top = np.log(max(2.0, 1.3 * rms)) + prior.NOISE_STEP
        noise = np.exp(np.arange(np.log(prior.NOISE_FROM), top, prior.NOISE_STEP)).tolist()
        axis, first, step = (
            Axis(tuple(noise), prior.noise_log_prior(noise)),
            prior.REMAINDER_FROM,
            prior.REMAINDER_STEP,
        )
        count = int(np.ceil(np.log(2.0 * remainder_rms / first + 2.0) / np.log(step)))
        sizes = [first * step**k for k in range(count)] if remainder_rms else []
        share = np.log(prior.REMAINDER / max(len(sizes), 1))
        none = np.log(1.0 - prior.REMAINDER) if sizes else 0.0
        return cls((axis,) * kinds, *widenings, Axis((0.0, *sizes), (none, *[share] * len(sizes))))

    def holds(self, point: GridPoint) -> bool:
        """Whether a point is on the grid."""
        sizes = (*(len(a.values) for a in self.noise), len(self.widening), len(self.size.values))
        return all(0 <= k < n for k, n in zip((*point.noise, *point[1:]), sizes, strict=True))

    def along(self, point: GridPoint, axis: str) -> list[GridPoint]:
        """All points that differ in ``widening`` or ``remainder`` alone."""
        count = len(self.widening if axis == "widening" else self.size.values)
        return [point.at(axis, k) for k in range(count)]

    def nearest(self, point: GridPoint) -> GridPoint:
        """A point of another grid with like axes, moved onto this one."""
        noise = tuple(min(k, len(a.values) - 1) for k, a in zip(point.noise, self.noise, strict=True))
        widening, remainder = min(point.widening, len(self.widening) - 1), len(self.size.values) - 1
        return GridPoint(noise, widening, min(point.remainder, remainder))

    def all_at(self, noise: int, widening: int = 0, remainder: int = 0) -> GridPoint:
        """The point with one index of noise for every kind (the largest there is, where an axis is shorter)."""
        return GridPoint(tuple(min(noise, len(a.values) - 1) for a in self.noise), widening, remainder)

    def scales(self, point: GridPoint) -> Array:
        """(k,) noise of each kind of channel in stated sigmas."""
        return np.array([a.values[k] for a, k in zip(self.noise, point.noise, strict=True)])

    def log_prior(self, point: GridPoint) -> float:
        """Of a point; the first noise is paid by how far it is from stated, others by how far they are from the first."""
        steps = np.log(self.scales(point))
        apart = float(np.sum(prior.RATIO_DOUBT.log_prior(steps[1:] - steps[0])))
        own = self.noise[0].log_prior[point.noise[0]] + apart
        return own + self.log_widening[point.widening] + self.size.log_prior[point.remainder]
