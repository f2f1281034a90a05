"""Whether the mirror passed the end of a fringe or turned around there.

At the end of a fringe the signal turns either way. Far from the end a turning point is seen by its level;
near it only the motion tells: a smooth motion that passes, mirrored at the end, has a kink, and so has one that
turns when it is taken for a passage. Both are fitted and chi2 weighs them. Where no smooth motion fits, motions
that change suddenly, once, are tried; where none of those fits either, nothing is concluded.

Motions of the mirror near the end of a fringe, fitted to the light: x(t) smooth, or with one sudden change.

x is the phase from the end of the fringe, rad; v = low + size * fringe(x) with low and size near 0 and 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev

from truepose.arrays import Array, Index
from truepose.identification.fit.leastsquares import minimise
from truepose.identification.leaves.fringes.levels import Noise
from truepose.models.sensors.irradiance import fringe, fringe_slope

# -- Motions of the mirror near the end of a fringe, fitted to the light: x(t) smooth, or with one sudden change

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


# -- Whether the mirror passed the end of a fringe or turned around there

DECISIVE = 25.0
"""Difference in chi2 from which on a verdict stands."""
_POINTS = 160
_SIMPLE, _FREE = (3, 5, 7), (7, 9, 11, 13)
_SUDDEN = 2  # degree beside a sudden change
_PLACES, _ROUNDS = 7, 3
_FLOOR = 0.0015  # of a fringe: motions are not polynomials
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
        """This verdict with odds no surer than those of ``other``, which freer motions gave; 0 where the two differ."""
        agree = self.odds * other.odds > 0.0
        odds = float(np.copysign(min(abs(self.odds), abs(other.odds)), self.odds)) if agree else 0.0
        return replace(self, odds=odds)

    @property
    def passed(self) -> bool:
        """Whether it passed for certain."""
        return self.odds > DECISIVE


def judge(light: Light) -> Verdict:
    """Return passed or turned: the simplest motions that fit decide; odds are 0 when none does."""
    for attempt in (_SIMPLE, None, _FREE):
        verdict = _sudden_verdict(light) if attempt is None else smooth_verdict(light, attempt)
        if verdict is not None and verdict.fits:
            return verdict
    return Verdict(0.0, False, float(light.high), np.inf)


def smooth_verdict(light: Light, degrees: tuple[int, ...]) -> Verdict | None:
    """The verdict of the first degree that fits, confirmed by the next one."""
    verdict: Verdict | None = None
    simpler: dict[float, Array] = {}
    for degree in degrees:
        if len(light.u) < degree + 3 or (degree == degrees[-1] and not (verdict and verdict.fits)):
            break  # the last one only confirms
        motions: list[Motion] = []
        for side in (-1.0, 1.0):
            # what a lower degree reached is reached again
            lower = [
                np.insert(a, -2, [0.0] * (degree + 3 - len(a))) for a in (simpler.get(side),) if a is not None
            ]
            found = Problem.of(light, side, degree).best(*lower)
            simpler[side] = min(found, key=lambda motion: motion.chi2).a
            motions += found
        now = _weighed(motions)
        if verdict is not None and verdict.fits:
            return verdict.confirmed(now)
        verdict = now
    return verdict


def _sudden_verdict(light: Light) -> Verdict | None:
    """The verdict of motions with one sudden change of speed, wherever it fits best."""
    if len(light.u) < _SUDDEN + 6:
        return None
    motions: list[Motion] = []
    for side in (-1.0, 1.0):
        centre, reach = 0.0, 1.0 - 2.0 / _PLACES
        best: Motion | None = None
        for _ in range(_ROUNDS):
            places = (centre + reach * np.linspace(-1.0, 1.0, _PLACES)).tolist()
            found = [(_at(light, side, place, best), place) for place in places if abs(place) < 1.0]
            best, centre = min(found, key=lambda one: one[0].chi2)
            reach *= 2.0 / (_PLACES - 1)
        assert best is not None
        motions.append(best)
    return _weighed(motions)


def _at(light: Light, side: float, place: float, near: Motion | None) -> Motion:
    """The best motion that changes at a place; from a motion ``near`` it, or from guesses."""
    problem = Problem.of(light, side, _SUDDEN, place)
    return min(problem.best() if near is None else [problem.reached(near.a)], key=lambda motion: motion.chi2)


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


def grouped_light(
    t: Array,
    v: Array,
    noise: Noise,
    distance: Callable[[Array, Index], Array],
    high: bool,
    g: float,
    slack: float,
    edges: tuple[Held | None, Held | None],
) -> Light:
    """Return samples (n,) in groups, with the 1-sigma of their means and that of the model.

    ``distance`` gives that of groups' means from the end of the fringe that is visited, for samples that stand for them.
    """
    bounds = np.linspace(0, len(t), min(_POINTS, len(t)) + 1).astype(int)
    sizes = np.diff(bounds)
    time, mean = (np.add.reduceat(values, bounds[:-1]) / sizes for values in (t, v))
    sigma = np.sqrt(noise.sigma**2 / sizes + noise.stuck**2 + _FLOOR**2)
    u = 2.0 * (time - t[0]) / max(float(t[-1] - t[0]), 1e-300) - 1.0
    return Light(u, mean, sigma, distance(mean, bounds[:-1] + sizes // 2), high, g, slack, edges)
