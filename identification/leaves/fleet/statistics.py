"""What a summary says of a fleet: frequencies and sizes of effects, and which tolerances are met, with their intervals.

Use ``statistics(summary)`` for tables and pages.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import t as student

from truepose.arrays import Array
from truepose.identification.leaves.fleet.hierarchy import Hierarchy, Posterior, joined, quantiles, single
from truepose.identification.leaves.fleet.likelihood import LOG_ODDS, RATIOS, SLAB
from truepose.identification.leaves.fleet.summary import Summary
from truepose.identification.prior import TOLERANCE_DOUBT

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


def most_frequent(effects: Iterable[EffectInFleet], least: float) -> list[EffectInFleet]:
    """Those that so many machines are expected to have at least."""
    return [one for one in effects if one.frequency.value * one.machines >= least]


__all__ = [
    "ConstantInFleet",
    "EffectInFleet",
    "FleetStatistics",
    "Interval",
    "ToleranceInFleet",
    "log_normal",
    "most_frequent",
    "statistics",
    "trees",
]
