"""Motions of the mirror near the end of a fringe, fitted to the light: x(t) smooth, or with one sudden change.

x is the phase from the end of the fringe, rad; v = low + size * fringe(x) with low and size near 0 and 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from truepose.arrays import Array
from truepose.identification.fit.leastsquares import minimise
from truepose.models.sensors.irradiance import fringe, fringe_slope

_FAR = 0.6  # rad
_STILL = 0.1  # rad a half of the samples: speed of a mirror that rests
_STEPS, _DAMPING = 30, 1e-3
_LEFT, _SHARE = 5e-4, 1e-5  # of chi2 to gain: absolute, or as a part


@dataclass(frozen=True)
class Held:
    """Where samples begin or stop: the ``distance`` from the end of the fringe and its 1-sigma, rad.

    ``still``: the mirror rests there.
    """

    distance: float
    sigma: float
    still: bool


@dataclass(frozen=True)
class Light:
    """Groups of samples around an end of a fringe: times u (n,) in [-1, 1], v (n,) and its 1-sigma (n,).

    ``distance`` (n,) from the end that ``high`` or low names, rad, without sign; ``slack``: 1-sigma of the
    levels; ``edges``: what else is known where the samples begin and stop.
    """

    u: Array
    v: Array
    sigma: Array
    distance: Array
    high: bool
    g: float
    slack: float
    edges: tuple[Held | None, Held | None]


@dataclass(frozen=True)
class Motion:
    """A fitted motion: coefficients with low and size - 1 behind them, chi2, and whether it passes the end."""

    problem: Problem
    a: Array
    chi2: float
    passes: bool

    def level(self) -> tuple[float, float]:
        """v at the end of the fringe, and its 1-sigma."""
        jacobian, share = self.problem.rows(self.a)[:, :-1], np.array([1.0, float(self.problem.light.high)])
        covariance = np.linalg.pinv(jacobian.T @ jacobian)[-2:, -2:]
        variance = float(share @ covariance @ share)
        return float(share @ self.a[-2:] + share[1]), float(np.sqrt(max(variance, 0.0)))


def basis(u: Array, degree: int, change: float | None) -> Array:
    """(n, p) functions of time u (n,): polynomials, and from a sudden ``change`` on another speed and acceleration."""
    rows = chebyshev.chebvander(u, degree)
    if change is not None:
        after = np.maximum(u - change, 0.0)
        rows = np.column_stack([rows, after, after**2])
    return np.asarray(rows, dtype=np.float64)


def speed(u: Array, degree: int, change: float | None) -> Array:
    """(n, p) derivative of `basis` by u (n,), which may be -1 or 1 only."""
    power = np.arange(degree + 1)
    rows = u[:, None] ** (power + 1) * power**2
    if change is not None:
        after = np.maximum(u - change, 0.0)
        rows = np.column_stack([rows, after > 0.0, 2.0 * after])
    return np.asarray(rows, dtype=np.float64)


@dataclass(frozen=True)
class Problem:
    """Least squares of the light for motions in one ``basis`` (n, p) that go on (``side`` 1) or come back (-1).

    ``held`` (k, p): conditions at the edges, ``at`` (k,) what they should give, ``tight`` (k,) their 1-sigma.
    """

    light: Light
    side: float
    basis: Array
    held: Array
    at: Array
    tight: Array

    @classmethod
    def of(cls, light: Light, side: float, degree: int, change: float | None = None) -> Problem:
        """Distances are negative where the motion begins; where the mirror is still its speed is 0."""
        rows, at, tight = [basis(light.u[:0], degree, change)], [], []
        for edge, end, sign in zip(light.edges, (-1.0, 1.0), (-1.0, side), strict=True):
            if edge is None:
                continue
            u = np.array([end])
            rows.append(basis(u, degree, change))
            at.append(sign * edge.distance)
            tight.append(edge.sigma)
            if edge.still:
                rows.append(speed(u, degree, change))
                at.append(0.0)
                tight.append(_STILL)
        held = np.vstack(rows), np.array(at), np.array(tight)
        return cls(light, side, basis(light.u, degree, change), *held)

    @property
    def freedom(self) -> int:
        """Data less coefficients; levels are held by their own condition."""
        return max(len(self.light.u) + len(self.at) - int(self.basis.shape[1]), 1)

    def shape(self, x: Array) -> tuple[Array, Array]:
        """The fringe (n,) and its slope at distances x (n,) from the end."""
        phase = x + (np.pi if self.light.high else 0.0)
        return fringe(np.cos(phase), self.light.g), fringe_slope(phase, self.light.g)

    def rows(self, a: Array) -> Array:
        """(m, p + 3) whitened rows of light, edges and levels: derivatives by ``a`` (p + 2,), then the residual."""
        x, size = self.basis @ a[:-2], 1.0 + a[-1]
        shape, slope = self.shape(x)
        off = a[-2] + size * shape - self.light.v
        light = np.vstack([self.basis.T * (size * slope), np.ones_like(x), shape, off]) / self.light.sigma
        edges = (
            np.vstack([self.held.T, np.zeros((2, len(self.at))), self.held @ a[:-2] - self.at]) / self.tight
        )
        levels = np.vstack([np.zeros((len(a) - 2, 2)), np.eye(2), a[-2:]]) / self.light.slack
        return np.hstack([light, edges, levels]).T

    def starts(self) -> Iterator[Array]:
        """Guesses (p + 2,): coefficients of the motion, and corrections of the two levels.

        One unfolds the distances at the smallest one; one trusts only those far from the end of the fringe,
        where noise matters little; for a motion that comes back, one goes beyond the end in between.
        """
        distance, p = self.light.distance, self.basis.shape[1]
        order = np.arange(len(distance))
        near = np.flatnonzero(distance <= float(np.min(distance)) + 0.15)
        x = np.where(order < np.median(near), -distance, self.side * distance)
        far = distance > min(_FAR, 0.5 * float(np.max(distance)))
        everything = np.ones(len(x), dtype=bool)
        guesses = [(everything, x, p), (far, x, min(p, 4))]  # few far samples determine low powers only
        if self.side < 0.0 and near[-1] > near[0] + 2:
            between = (order > near[0]) & (order < near[-1])
            guesses.append((everything, np.where(between, distance, -distance), p))
        for rows, guess, powers in guesses:
            columns = np.vstack([self.basis[rows], 10.0 * self.held])[:, :powers]
            a = np.zeros(p + 2)
            right = np.concatenate([guess[rows], 10.0 * self.at])
            a[:powers] = np.linalg.lstsq(columns, right, rcond=None)[0]
            yield a

    def best(self, *further: Array) -> list[Motion]:
        """The motions reached from all guesses, and from ``further`` ones (p + 2,)."""
        return [self.reached(a) for a in (*self.starts(), *further)]

    def reached(self, a: Array) -> Motion:
        """The motion that least squares reach from coefficients ``a`` (p + 2,)."""
        found = minimise(
            lambda a: [self.rows(a)], a, limit=_STEPS, tolerance=_LEFT, share=_SHARE, damping=_DAMPING
        )
        a = found.t
        ends = self.basis[[0, -1]] @ a[:-2]
        # a held edge keeps a motion on its side; without one it may end up on the other
        passes = self.side > 0.0 if len(self.at) else bool(ends[0] * ends[1] < 0.0)
        return Motion(self, a, 2.0 * found.cost, passes)
