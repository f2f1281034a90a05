"""What machines say together: frequencies and sizes of effects, and which tolerances are met, with their intervals.

Use ``statistics(pooled)`` for tables and pages.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.stats import t as student

from truepose.arrays import Array
from truepose.identification.leaves.fleet.hierarchy import (
    RATIOS,
    SLAB,
    Hierarchy,
    Posterior,
    Told,
    of_frequency,
    of_presence,
    of_spread,
    quantiles,
    single,
)
from truepose.identification.leaves.fleet.pooled import (
    Pooled,
    constant_moments,
    effect_moments,
    grouped,
    size_moments,
    summed,
)
from truepose.identification.prior import TOLERANCE_DOUBT

LEVEL = 0.9
"""Of all intervals."""
MET = 1.1
"""Times the stated tolerance up to which it counts as met."""
STEPS: Array = np.linspace(np.log(RATIOS[0]), np.log(RATIOS[-1]), 2001)
"""(k,) grid of the log of a ratio, on which a posterior is summed."""
UNKNOWN = np.full(len(SLAB), np.nan)
"""Shares of sizes of which nothing is kept."""
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


def statistics(pooled: Pooled) -> FleetStatistics:
    """Return everything that a table of the fleet says."""
    far = {one: max(one.mean.low, -one.mean.high, 0.0) for one in _constants(pooled)}  # from 0
    constants = sorted(far, key=lambda one: (-far[one], one.mechanism, one.name))
    return FleetStatistics(
        pooled.machines,
        tuple(sorted(_anywhere(pooled), key=_rank)),
        tuple(sorted(_places(pooled), key=_rank)),
        tuple(tolerances(pooled)),
        tuple(constants),
    )


def _rank(one: EffectInFleet) -> tuple[float, str, str, tuple[str, ...]]:
    return -one.frequency.value, one.mechanism, one.effect, one.place


@dataclass(frozen=True)
class Tree:
    """An effect with its places: type of mechanism and place, machines and sum of probabilities of each."""

    places: tuple[tuple[str, str], ...]
    machines: tuple[int, ...]
    found: tuple[float, ...]
    hierarchy: Hierarchy


def trees(pooled: Pooled) -> dict[str, Tree]:
    """Return each effect with all of its places, of machines of whatever type."""
    by_effect: dict[str, list[tuple[tuple[str, str], Array, Array]]] = {}
    for (mechanism, effect, place), rows in grouped(pooled.places, "mechanism", "effect", "place"):
        sizes = np.array([UNKNOWN if one is None else one for one in rows["sizes"]], dtype=float)
        likely = summed(of_frequency(Told.of(rows), sizes))
        by_effect.setdefault(effect, []).append(((mechanism, place), summed(effect_moments(rows)), likely))
    out = {}
    for effect, own in by_effect.items():
        places, moments, likelihoods = zip(*own, strict=True)
        n, odds, found = np.array(moments).T
        hierarchy = Hierarchy(odds / n, np.array(likelihoods))
        out[effect] = Tree(places, tuple(n.astype(int).tolist()), tuple(found.tolist()), hierarchy)
    return out


def _places(pooled: Pooled) -> Iterator[EffectInFleet]:
    """Yield each effect at each of its places."""
    sized = dict(grouped(pooled.sizes, "mechanism", "effect", "place"))
    for effect, tree in trees(pooled).items():
        for k, (mechanism, place) in enumerate(tree.places):
            key, parts = (mechanism, effect, place), tuple(place.split("+"))
            sizes = _sizes(sized[key]) if key in sized else {}
            counts = tree.machines[k], tree.found[k]
            yield _in_fleet(mechanism, effect, parts, counts, tree.hierarchy.place(k), sizes)


def _anywhere(pooled: Pooled) -> Iterator[EffectInFleet]:
    """Yield each effect at any of its places."""
    sized = dict(grouped(pooled.sizes, "mechanism", "effect"))
    for (mechanism, effect), rows in grouped(pooled.anywhere, "mechanism", "effect"):
        n, odds, found = summed(effect_moments(rows)).tolist()
        posterior = single(odds / n, summed(of_presence(Told.of(rows))))
        key = mechanism, effect
        sizes = _sizes(sized[key]) if key in sized else {}
        yield _in_fleet(mechanism, effect, (), (round(n), found), posterior, sizes)


def _in_fleet(
    mechanism: str, effect: str, place: tuple[str, ...], counts: tuple[int, float], of: Posterior,
    sizes: dict[str, Any],
) -> EffectInFleet:  # fmt: skip
    """Return what a posterior says; ``counts``: machines, and the sum of their probabilities."""
    machines, found = counts
    frequency, odds = Interval(of.mean, *of.interval), float(np.exp(of.log_factor))
    return EffectInFleet(
        mechanism, effect, place, machines, frequency, of.usual_frequency, found, odds, **sizes
    )


def _sizes(rows: pd.DataFrame) -> dict[str, Any]:
    """Return the size of machines that have it: log-normal, noise of each measurement taken off the spread between machines."""
    sums = summed(size_moments(rows))
    if sums[0] < FEW:
        return {}
    mean, spread, error = log_normal(sums)
    unit, *more = rows["unit"].unique()
    amount = _exp(float(sums[4] / sums[0]), error) if unit and not more else None
    size, factor = _exp(mean, error), float(np.exp(spread))
    return {"size": size, "spread": factor, "amount": amount, "unit": unit if amount else ""}


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


def tolerances(pooled: Pooled) -> list[ToleranceInFleet]:
    """Return the spread of each class of parts, the widest first."""
    out = []
    for (mechanism, parts), rows in grouped(pooled.constants, "mechanism", "parts"):
        likely = of_spread(rows["deviation"].to_numpy(), rows["std"].to_numpy())
        by_machine = pd.DataFrame(likely).groupby(rows["machine"].to_numpy()).sum().to_numpy()
        log = CubicSpline(np.log(RATIOS), summed(by_machine))(STEPS) - 0.5 * (STEPS / TOLERANCE_DOUBT) ** 2
        shares = np.exp(log - log.max())
        shares /= shares.sum()
        low, high = np.exp(quantiles(STEPS, shares, [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0])).tolist()
        met = float(shares[np.log(MET) >= STEPS].sum())
        ratio = Interval(float(np.exp(shares @ STEPS)), low, high)
        out.append(ToleranceInFleet(mechanism, parts, len(rows), ratio, met))
    return sorted(out, key=lambda one: (-one.ratio.value, one.mechanism, one.parts))


def _constants(pooled: Pooled) -> Iterator[ConstantInFleet]:
    """Yield each constant that two machines tell at least."""
    for (mechanism, name), rows in grouped(pooled.constants, "mechanism", "name"):
        n, x, square, noise = summed(constant_moments(rows))
        count, mean = round(n), float(x / n)
        if count < 2:
            continue
        total = max(float(square / n) - mean**2, 0.0) * count / (count - 1)
        half = float(student.ppf(0.5 + LEVEL / 2.0, count - 1) * np.sqrt(total / count))
        spread = float(np.sqrt(max(total - noise / n, 0.0)))
        yield ConstantInFleet(mechanism, name, count, Interval(mean, mean - half, mean + half), spread)
