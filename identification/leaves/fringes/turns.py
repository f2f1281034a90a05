"""Whether the mirror passed the end of a fringe or turned around there.

At the end of a fringe the signal turns either way. Far from the end a turning point is seen by its level;
near it only the motion tells: a smooth motion that passes, mirrored at the end, has a kink, and so has one that
turns when it is taken for a passage. Both are fitted and chi2 weighs them. If no smooth motion fits, nothing is concluded.

x is the phase from the end of the fringe, rad; v = low + size * fringe(x) with low and size near 0 and 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev

from truepose.arrays import Array
from truepose.identification.fit.leastsquares import minimise
from truepose.models.sensors.irradiance import fringe, fringe_slope

# -- Motions of the mirror near the end of a fringe, fitted to the light: x(t) smooth

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
        """Return v at the end of the fringe, and its 1-sigma."""
        jacobian, share = self.problem.rows(self.a)[:, :-1], np.array([1.0, float(self.problem.light.high)])
        covariance = np.linalg.pinv(jacobian.T @ jacobian)[-2:, -2:]
        variance = float(share @ covariance @ share)
        return float(share @ self.a[-2:] + share[1]), float(np.sqrt(max(variance, 0.0)))


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
    def of(cls, light: Light, side: float, degree: int) -> Problem:
        """Return the problem in polynomials of a degree; distances are negative where the motion begins."""
        power = np.arange(degree + 1)
        rows: list[Array] = [np.empty((0, degree + 1))]
        at, tight = list[float](), list[float]()
        for edge, end, sign in zip(light.edges, (-1.0, 1.0), (-1.0, side), strict=True):
            if edge is None:
                continue
            rows.append(np.asarray(chebyshev.chebvander(np.array([end]), degree), dtype=np.float64))
            at.append(sign * edge.distance)
            tight.append(edge.sigma)
            if edge.still:  # the derivative of each polynomial there
                rows.append(np.asarray(end ** (power[None] + 1) * power**2, dtype=np.float64))
                at.append(0.0)
                tight.append(_STILL)
        held = np.vstack(rows), np.array(at), np.array(tight)
        return cls(light, side, np.asarray(chebyshev.chebvander(light.u, degree), dtype=np.float64), *held)

    @property
    def freedom(self) -> int:
        """Data less coefficients; levels are held by their own condition."""
        return max(len(self.light.u) + len(self.at) - int(self.basis.shape[1]), 1)

    def rows(self, a: Array) -> Array:
        """Return (m, p + 3) whitened rows of light, edges and levels: derivatives by ``a`` (p + 2,), then the residual."""
        size = 1.0 + a[-1]
        phase = self.basis @ a[:-2] + (np.pi if self.light.high else 0.0)
        shape, slope = fringe(np.cos(phase), self.light.g), fringe_slope(phase, self.light.g)
        off = a[-2] + size * shape - self.light.v
        light = np.vstack([self.basis.T * (size * slope), np.ones_like(phase), shape, off]) / self.light.sigma
        edges = (
            np.vstack([self.held.T, np.zeros((2, len(self.at))), self.held @ a[:-2] - self.at]) / self.tight
        )
        levels = np.vstack([np.zeros((len(a) - 2, 2)), np.eye(2), a[-2:]]) / self.light.slack
        return np.hstack([light, edges, levels]).T

    def starts(self) -> Iterator[Array]:
        """Yield guesses (p + 2,): coefficients of the motion, and corrections of the two levels.

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

    def reached(self, a: Array) -> Motion:
        """Return the motion that least squares reach from coefficients ``a`` (p + 2,)."""
        found = minimise(
            lambda a: [self.rows(a)], a, limit=_STEPS, tolerance=_LEFT, share=_SHARE, damping=_DAMPING
        )
        a = found.t
        ends = self.basis[[0, -1]] @ a[:-2]
        # a held edge keeps a motion on its side; without one it may end up on the other
        passes = self.side > 0.0 if len(self.at) else bool(ends[0] * ends[1] < 0.0)
        return Motion(self, a, 2.0 * found.cost, passes)


# -- Whether the mirror passed the end of a fringe or turned around there

DECISIVE = 25.0
"""Difference in chi2 from which on a verdict stands."""
_SIMPLE, _FREE = (3, 5, 7), (7, 9, 11, 13)
_SURE = 1e3


@dataclass(frozen=True)
class Verdict:
    """``odds``: chi2 of turning less chi2 of passing, scaled so that the better motion fits; ``fits``: it does.

    ``level``: v at the end of the fringe by the better motion (near 0 or 1), ``sigma`` its 1-sigma.
    """

    odds: float
    fits: bool
    level: float
    sigma: float

    def confirmed(self, other: Verdict) -> Verdict:
        """Return this verdict with odds no surer than those of ``other``, which freer motions gave; 0 where the two differ."""
        agree = self.odds * other.odds > 0.0
        odds = float(np.copysign(min(abs(self.odds), abs(other.odds)), self.odds)) if agree else 0.0
        return replace(self, odds=odds)

    @property
    def passed(self) -> bool:
        """Whether it passed for certain."""
        return self.odds > DECISIVE


def judge(light: Light) -> Verdict:
    """Return passed or turned: the simplest motions that fit decide; odds are 0 when none does."""
    for degrees in (_SIMPLE, _FREE):
        verdict = smooth_verdict(light, degrees)
        if verdict is not None and verdict.fits:
            return verdict
    return Verdict(0.0, False, float(light.high), np.inf)


def smooth_verdict(light: Light, degrees: tuple[int, ...]) -> Verdict | None:
    """Return the verdict of the first degree that fits, confirmed by the next one."""
    verdict: Verdict | None = None
    simpler: dict[float, Array] = {}
    for degree in degrees:
        if len(light.u) < degree + 3 or (degree == degrees[-1] and not (verdict and verdict.fits)):
            break  # the last one only confirms
        motions: list[Motion] = []
        for side in (-1.0, 1.0):
            # what a lower degree reached is reached again
            problem = Problem.of(light, side, degree)
            starts = [*problem.starts()]
            if side in simpler:
                starts.append(np.insert(simpler[side], -2, [0.0] * (degree + 3 - len(simpler[side]))))
            found = [problem.reached(a) for a in starts]
            simpler[side] = min(found, key=lambda motion: motion.chi2).a
            motions += found
        now = _weighed(motions)
        if verdict is not None and verdict.fits:
            return verdict.confirmed(now)
        verdict = now
    return verdict


def _weighed(motions: list[Motion]) -> Verdict:
    better = min(motions, key=lambda motion: motion.chi2)
    freedom = better.problem.freedom
    scale = max(1.0, better.chi2 / freedom)
    # where every guess became a motion of the one kind, none of the other comes near the data
    turned, passed = (
        min((motion.chi2 for motion in motions if motion.passes is kind), default=better.chi2 + _SURE * scale)
        for kind in (False, True)
    )
    fits = better.chi2 < freedom * (1.0 + 4.0 * np.sqrt(2.0 / freedom))
    level, sigma = better.level()
    return Verdict((turned - passed) / scale, bool(fits), level, sigma * float(np.sqrt(scale)))
