"""Whether the mirror passed the end of a fringe or turned around there.

At the end of a fringe the signal turns either way. Far from the end a turning point is seen by its level;
near it only the motion tells: a smooth motion that passes, mirrored at the end, has a kink, and so has one that
turns when it is taken for a passage. Both are fitted and chi2 weighs them. Where no smooth motion fits, motions
that change suddenly, once, are tried; where none of those fits either, nothing is concluded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.leaves.fringes.levels import Noise
from truepose.identification.leaves.fringes.motions import Held, Light, Motion, Problem
from truepose.models.sensors.irradiance import folded_phase

DECISIVE = 25.0
"""Difference in chi2 from which on a verdict stands."""
_POINTS = 160
_SIMPLE, _FREE = (3, 5, 7), (7, 9, 11, 13)
_SUDDEN = 2  # degree beside a sudden change
_PLACES, _ROUNDS = 7, 3
_FLOOR = 0.0015  # of a fringe: motions are not polynomials
_SURE = 1e3


@dataclass(frozen=True)
class Visit:
    """Samples around the visit to the ``high`` or low end of a fringe, and how they lie from it.

    t and v (n,) with their ``noise``; ``slack``: 1-sigma of the levels by which v was normalised. The end nearest to
    a sample is ``halves`` (n,) half fringes away from the one that is visited, and high where ``kind`` (n,) is true;
    ``beyond`` (n,): the sample lies past it. ``edges``: what else is known where the samples begin and stop.
    """

    t: Array
    v: Array
    noise: Noise
    high: bool
    g: float
    slack: float
    halves: Index
    beyond: Mask
    kind: Mask
    edges: tuple[Held | None, Held | None] = (None, None)


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


def judge(visit: Visit) -> Verdict:
    """Passed or turned: the simplest motions that fit decide; odds are 0 when none does."""
    light = light_of(visit)
    fitting = (verdict for verdict in _attempts(light) if verdict is not None and verdict.fits)
    return next(fitting, Verdict(0.0, False, float(visit.high), np.inf))


def _attempts(light: Light) -> Iterator[Verdict | None]:
    """One after another, as they are asked for: the first, which decides most visits, takes a fraction of the time of all."""
    yield smooth_verdict(light, _SIMPLE)
    yield _sudden(light)
    yield smooth_verdict(light, _FREE)


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
            simpler[side] = min(found, key=_chi2).a
            motions += found
        now = _weighed(motions)
        if verdict is not None and verdict.fits:
            return verdict.confirmed(now)
        verdict = now
    return verdict


def _sudden(light: Light) -> Verdict | None:
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
    return min(problem.best() if near is None else [problem.reached(near.a)], key=_chi2)


def _weighed(motions: list[Motion]) -> Verdict:
    better = min(motions, key=_chi2)
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


def _chi2(motion: Motion) -> float:
    return motion.chi2


def light_of(visit: Visit) -> Light:
    """Samples in groups, with the 1-sigma of their means and that of the model."""
    t, v = visit.t, visit.v
    groups = min(_POINTS, len(t))
    edges = np.linspace(0, len(t), groups + 1).astype(int)
    sizes = np.diff(edges)
    time = np.add.reduceat(t, edges[:-1]) / sizes
    mean = np.add.reduceat(v, edges[:-1]) / sizes
    span = max(float(t[-1] - t[0]), 1e-300)
    at = edges[:-1] + sizes // 2
    phase = folded_phase(mean, visit.g)
    local = np.where(visit.kind[at], np.pi - phase, phase)
    distance = np.pi * visit.halves[at] + np.where(visit.beyond[at], local, -local)
    sigma = np.sqrt(visit.noise.sigma**2 / sizes + visit.noise.stuck**2 + _FLOOR**2)
    u = 2.0 * (time - t[0]) / span - 1.0
    return Light(u, mean, sigma, distance, visit.high, visit.g, visit.slack, visit.edges)
