"""What a summary says of a fleet: frequencies and sizes of effects, and which tolerances are met, with their intervals.

Use ``statistics(summary)`` for tables and pages.

Frequencies of an effect at its places, which are alike but not the same: a tree of three levels, summed out on grids.

    t_e  ~ N(m, FLEET_ODDS^2)          how far the log odds of the effect are from today's prior l
    l_p + t_p,  t_p ~ N(t_e, FLEET_PLACES^2)     those of each place p;   usual size j ~ slab, one for the effect
    machines ~ ``likelihood.of_frequency`` given both

m is such that without any machine the expected frequency is today's prior. A place hears of the others through t_e alone, so
each is summed out once, and its own posterior is the others' message times what its own machines say.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import expit, logit, logsumexp
from scipy.stats import t as student

from truepose.arrays import Array
from truepose.identification.leaves.fleet.summary import KERNEL, LOG_ODDS, RATIOS, SLAB, Summary
from truepose.identification.prior import FLEET_ODDS, FLEET_PLACES, TOLERANCE_DOUBT

# -- Frequencies of an effect at its places, which are alike but not the same: a tree of three levels, summed out on grids

FINE: Array = np.linspace(LOG_ODDS[0], LOG_ODDS[-1], 641)
"""(f,) grid that posteriors are summed on, of log odds."""
GRID_STEPS: Array = np.linspace(-9.0, 9.0, 181)
"""(t,) grid of how far an effect is from today's prior."""
TAIL = 0.05
"""Of a posterior beyond each end of an interval."""


@dataclass(frozen=True)
class Posterior:
    """Of a frequency. usual: log odds expected before any machine; shares (f,): probability of each of ``FINE``, ``before``
    any machine, too."""

    usual: float
    shares: Array
    before: Array

    @property
    def mean(self) -> float:
        """Expected frequency: the probability that the next machine has it."""
        return float(self.shares @ expit(FINE))

    @property
    def interval(self) -> tuple[float, float]:
        """90 % credible."""
        low, high = quantiles(FINE, self.shares, [TAIL, 1.0 - TAIL])
        return float(expit(low)), float(expit(high))

    @property
    def log_factor(self) -> float:
        """Log of how many times the odds are what they were before any machine."""
        return float(logit(self.mean) - logit(self.before @ expit(FINE)))


@dataclass(frozen=True)
class Hierarchy:
    """usual (p,): today's log prior odds at each place; likely (p, j, g): log likelihood of what all machines said."""

    usual: Array
    likely: Array

    @cached_property
    def sizes(self) -> Array:
        """(s,) share of each size among machines that have the effect."""
        joint = self._effect + self._messages.sum(axis=0)
        shares = np.exp(joint - logsumexp(joint)).sum(axis=0)
        return np.asarray(shares @ KERNEL)

    def place(self, k: int) -> Posterior:
        """Of one place."""
        others = self._effect + np.delete(self._messages, k, axis=0).sum(axis=0)
        return self._at(float(self.usual[k]), others, self._fine[k])

    @cached_property
    def elsewhere(self) -> Posterior:
        """Of a place that no machine has, whose prior is the mean of the others'."""
        return self._at(
            float(np.mean(self.usual)),
            self._effect + self._messages.sum(axis=0),
            np.zeros((len(SLAB), len(FINE))),
        )

    def _at(self, usual: float, effect: Array, likely: Array) -> Posterior:
        """From log weights (t, j) of the effect and the log likelihood (j, f) of the place's own machines."""
        around = _around(usual)
        weight = np.exp(effect - logsumexp(effect))
        shares = np.sum((around.T @ weight).T * np.exp(likely - likely.max()), axis=0)
        start = np.exp(self._effect - logsumexp(self._effect)).sum(axis=1)
        before = around.T @ start
        return Posterior(usual, shares / shares.sum(), before / before.sum())

    @cached_property
    def _effect(self) -> Array:
        """(t, j) log prior of an effect."""
        return np.asarray(effect_steps(float(np.mean(self.usual)))[:, None] + np.log(SLAB))

    @cached_property
    def _fine(self) -> Array:
        """(p, j, f) log likelihoods on the fine grid."""
        return np.asarray(CubicSpline(LOG_ODDS, self.likely, axis=2)(FINE))

    @cached_property
    def _messages(self) -> Array:
        """(p, t, j) what the machines of each place say of the effect."""
        out = np.empty((len(self.usual), len(GRID_STEPS), len(SLAB)))
        for k, usual in enumerate(self.usual.tolist()):
            top = self._fine[k].max()
            told = _around(usual) @ np.exp(self._fine[k] - top).T
            out[k] = np.log(np.maximum(told, 1e-300)) + top
        return out


def single(usual: float, likely: Array) -> Posterior:
    """The same of one frequency that has no like, from log likelihoods (g,)."""
    around = _around(usual)
    before = around.T @ np.exp(effect_steps(usual))
    fine = CubicSpline(LOG_ODDS, likely)(FINE)
    shares = before * np.exp(fine - fine.max())
    return Posterior(usual, shares / shares.sum(), before / before.sum())


def _around(usual: float) -> Array:
    """(t, f) how places of log prior odds ``usual`` scatter about their effect."""
    log = -0.5 * ((FINE - usual - GRID_STEPS[:, None]) / FLEET_PLACES) ** 2
    weight = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def effect_steps(usual: float) -> Array:
    """(t,) log prior of an effect's step, about the m of which the expected frequency is the usual one."""
    frequency = _around(usual) @ expit(FINE)

    def weights(m: float) -> Array:
        log = -0.5 * ((GRID_STEPS - m) / FLEET_ODDS) ** 2
        return np.asarray(np.exp(log - logsumexp(log)))

    def excess(m: float) -> float:
        return float(weights(m) @ frequency - expit(usual))

    low, high = -6.0, 6.0
    m = brentq(excess, low, high) if excess(low) * excess(high) < 0.0 else low
    return np.log(np.maximum(weights(float(m)), 1e-300))


def quantiles(values: Array, shares: Array, at: Sequence[float]) -> list[float]:
    """Of a distribution on a grid, each share spread evenly around its value."""
    middle = np.cumsum(shares) - 0.5 * shares
    return [float(value) for value in np.interp(at, middle, values)]


def joined(parts: Sequence[tuple[float, Array]]) -> Hierarchy:
    """From log prior odds and log likelihoods (j, g), a place each."""
    return Hierarchy(np.array([usual for usual, _ in parts]), np.array([likely for _, likely in parts]))


# -- What a summary says of a fleet: frequencies and sizes of effects, and which tolerances are met, with their intervals

LEVEL = 0.9
"""Of all intervals."""
MET = 1.1
"""Times the stated tolerance up to which it counts as met."""
STEPS: Array = np.linspace(np.log(RATIOS[0]), np.log(RATIOS[-1]), 2001)
"""(k,) grid of the log of a ratio, on which a posterior is summed."""
FEW = 0.5
"""Expected machines with an effect below which nothing is said of its size."""


@dataclass(frozen=True)
class Interval:
    """A value with its 90 % credible interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class EffectInFleet:
    """An effect at a place, or at any of its places (``place`` empty), among machines of one type of mechanism.

    machines: in which it was weighed; frequency: share of machines that have it, usual: the share that was expected of it
    before; found: sum of its probabilities; odds: how many times likelier it is than without the fleet; size: the fleet's
    median, in expected largest sizes, spread: factor of one sigma between machines; amount: the median in ``unit``; None
    where it is hardly ever there.
    """

    mechanism: str
    effect: str
    place: tuple[str, ...]
    machines: int
    frequency: Interval
    usual: float
    found: float
    odds: float
    size: Interval | None = None
    spread: float | None = None
    amount: Interval | None = None
    unit: str = ""


@dataclass(frozen=True)
class ToleranceInFleet:
    """A class of parts: true spread over the stated tolerance; met: probability that it is no more than stated (to 10 %)."""

    mechanism: str
    parts: str
    deviations: int
    ratio: Interval
    met: float


@dataclass(frozen=True)
class ConstantInFleet:
    """A constant over machines that tell it: mean deviation from its drawing in tolerances, and 1-sigma between machines.

    A mean far from 0 is an error of the drawing, not of a machine.
    """

    mechanism: str
    name: str
    machines: int
    mean: Interval
    spread: float


@dataclass(frozen=True)
class FleetStatistics:
    """machines: how many; anywhere: effects at any place, most frequent first; places: at each; tolerances: widest first;
    constants: those whose drawing is farthest off first."""

    machines: int
    anywhere: tuple[EffectInFleet, ...]
    places: tuple[EffectInFleet, ...]
    tolerances: tuple[ToleranceInFleet, ...]
    constants: tuple[ConstantInFleet, ...]


def statistics(summary: Summary) -> FleetStatistics:
    """Everything that a table of the fleet says."""
    places = [one for tree in trees(summary).values() for one in _places(summary, tree)]
    return FleetStatistics(
        summary.machines,
        tuple(sorted(_anywhere(summary), key=_rank)),
        tuple(sorted(places, key=_rank)),
        tuple(sorted(_tolerances(summary), key=lambda one: (-one.ratio.value, one.mechanism, one.parts))),
        tuple(sorted(_constants(summary), key=lambda one: (-_away(one.mean), one.mechanism, one.name))),
    )


def _rank(one: EffectInFleet) -> tuple[float, str, str, tuple[str, ...]]:
    return -one.frequency.value, one.mechanism, one.effect, one.place


def _away(mean: Interval) -> float:
    """How far an interval is from 0."""
    return max(mean.low, -mean.high, 0.0)


@dataclass(frozen=True)
class Tree:
    """An effect with its places: type of mechanism and place, machines and sum of probabilities of each."""

    effect: str
    places: tuple[tuple[str, str], ...]
    machines: tuple[int, ...]
    found: tuple[float, ...]
    hierarchy: Hierarchy


def trees(summary: Summary) -> dict[str, Tree]:
    """Each effect with all of its places, of machines of whatever type."""
    by_effect: dict[str, list[tuple[tuple[str, str], Array]]] = {}
    for (mechanism, effect, place), sums in summary.among("place").items():
        by_effect.setdefault(effect, []).append(((mechanism, place), sums))
    out = {}
    for effect, own in by_effect.items():
        shape = len(SLAB), len(LOG_ODDS)
        parts = [(sums[1] / sums[0], sums[3:].reshape(shape)) for _, sums in own]
        machines, found = tuple(round(sums[0]) for _, sums in own), tuple(float(sums[2]) for _, sums in own)
        out[effect] = Tree(effect, tuple(name for name, _ in own), machines, found, joined(parts))
    return out


def _told(
    mechanism: str, effect: str, place: str, machines: int, found: float, of: Posterior
) -> EffectInFleet:
    frequency = Interval(of.mean, *of.interval)
    parts = tuple(place.split("+")) if place else ()
    usual = float(1.0 / (1.0 + np.exp(-of.usual)))
    return EffectInFleet(
        mechanism, effect, parts, machines, frequency, usual, found, float(np.exp(of.log_factor))
    )


def _places(summary: Summary, tree: Tree) -> Iterator[EffectInFleet]:
    sizes = summary.among("size")
    for k, (mechanism, place) in enumerate(tree.places):
        one = _told(mechanism, tree.effect, place, tree.machines[k], tree.found[k], tree.hierarchy.place(k))
        own = {key[-1]: sums for key, sums in sizes.items() if key[:3] == (mechanism, tree.effect, place)}
        yield _sized(one, own)


def _anywhere(summary: Summary) -> Iterator[EffectInFleet]:
    sizes = summary.among("size")
    for (mechanism, effect), sums in summary.among("anywhere").items():
        of = single(float(sums[1] / sums[0]), sums[3:])
        own = dict[str, Array]()
        for key, more in sizes.items():
            if key[:2] == (mechanism, effect):
                own[key[-1]] = own.get(key[-1], 0.0) + more
        yield _sized(_told(mechanism, effect, "", round(sums[0]), float(sums[2]), of), own)


def _sized(one: EffectInFleet, sums: Mapping[str, Array]) -> EffectInFleet:
    """With sizes of machines that have it: log-normal, noise of each measurement taken off the spread between machines."""
    if not sums:
        return one
    whole = np.sum(list(sums.values()), axis=0)
    if whole[0] < FEW:
        return one
    mean, spread, error = log_normal(whole)
    unit, own = max(sums.items(), key=lambda item: float(item[1][0]))
    amount = None
    if unit and len(sums) == 1:
        amount = _exp(float(own[4] / own[0]), error)
    size = _exp(mean, error)
    return replace(one, size=size, spread=float(np.exp(spread)), amount=amount, unit=unit if amount else "")


def log_normal(sums: Array) -> tuple[float, float, float]:
    """Mean, 1-sigma between machines and half the 90 % interval of the mean, from sums of P, P y, P y^2, P e^2."""
    weight, mean = float(sums[0]), float(sums[1] / sums[0])
    total = max(float(sums[2] / weight) - mean**2, 0.0) * weight / max(weight - 1.0, 0.5)
    noise = float(sums[3] / weight)
    spread = float(np.sqrt(max(total - noise, 0.0)))
    degrees = max(weight - 1.0, 1.0)
    error = float(student.ppf(0.5 + LEVEL / 2.0, degrees) * np.sqrt(max(total, noise) / max(weight, 1.0)))
    return mean, spread, error


def _exp(centre: float, half: float) -> Interval:
    return Interval(*(float(np.exp(np.clip(centre + k * half, -50.0, 50.0))) for k in (0, -1, 1)))


def _tolerances(summary: Summary) -> Iterator[ToleranceInFleet]:
    for (mechanism, parts), sums in summary.among("class").items():
        log = CubicSpline(np.log(RATIOS), sums[1:])(STEPS) - 0.5 * (STEPS / TOLERANCE_DOUBT) ** 2
        shares = np.exp(log - log.max())
        shares /= shares.sum()
        low, high = np.exp(quantiles(STEPS, shares, [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0])).tolist()
        met = float(shares[np.log(MET) >= STEPS].sum())
        ratio = Interval(float(np.exp(shares @ STEPS)), low, high)
        yield ToleranceInFleet(mechanism, parts, round(sums[0]), ratio, met)


def _constants(summary: Summary) -> Iterator[ConstantInFleet]:
    for (mechanism, name), (n, x, square, noise) in summary.among("constant").items():
        count, mean = round(n), float(x / n)
        if count < 2:
            continue
        total = max(float(square / n) - mean**2, 0.0) * count / (count - 1)
        half = float(student.ppf(0.5 + LEVEL / 2.0, count - 1) * np.sqrt(total / count))
        spread = float(np.sqrt(max(total - noise / n, 0.0)))
        yield ConstantInFleet(mechanism, name, count, Interval(mean, mean - half, mean + half), spread)
