"""Figures of an examination, each with its uncertainty and, where one is set, its target."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from challenge.calibration import wilson
from challenge.score import Score

Array = NDArray[np.float64]
Test = Callable[[Score], bool]
Item = TypeVar("Item")
DRAWS = 2000


@dataclass(frozen=True)
class Target:
    """What is to be reached: at least ``low`` and at most ``high``."""

    low: float = -math.inf
    high: float = math.inf

    def met(self, value: float) -> bool:
        """Whether a value reaches it."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Figure:
    """A share with its Wilson interval (``share``), or a number with its bootstrap interval; of n cases, rows or names."""

    name: str
    n: int
    hits: int
    value: float | None
    interval: tuple[float, float] | None
    target: Target | None
    share: bool = True

    @property
    def met(self) -> bool | None:
        """Whether the target is reached; None without one, or without a case."""
        return None if self.target is None or self.value is None else self.target.met(self.value)


def share(
    name: str, items: Iterable[Item], test: Callable[[Item], bool], target: Target | None = None
) -> Figure:
    """How often something holds."""
    answers = [bool(test(item)) for item in items]
    return counted(name, sum(answers), len(answers), target)


def counted(name: str, hits: int, n: int, target: Target | None = None) -> Figure:
    """So many of so many."""
    return Figure(name, n, hits, hits / n if n else None, wilson(hits, n) if n else None, target)


def median(name: str, values: Iterable[float | None], target: Target | None = None) -> Figure:
    """The middle value of those that there are; 95 % by bootstrap over cases."""
    return quantile(name, [v for v in values if v is not None and np.isfinite(v)], 0.5, target)


def quantile(name: str, values: Sequence[float], q: float, target: Target | None = None) -> Figure:
    """A quantile of values, of which some may be infinite (there is no prediction); 95 % by bootstrap over cases."""

    def of(some: Sequence[float]) -> float:
        return float(np.median(some) if q == 0.5 else np.quantile(some, q, method="inverted_cdf"))

    return bootstrapped(name, values, of, target)


def bootstrapped(
    name: str,
    items: Sequence[Item],
    statistic: Callable[[Sequence[Item]], float],
    target: Target | None = None,
    *,
    as_share: bool = False,
    hits: int = 0,
    n: int | None = None,
) -> Figure:
    """A statistic of all cases with what it would be of other draws of as many cases."""
    if not len(items):
        return Figure(name, 0, 0, None, None, target, as_share)
    rng = np.random.default_rng(1)
    picks = rng.integers(0, len(items), (DRAWS, len(items)))
    drawn = np.sort([statistic([items[k] for k in pick]) for pick in picks])
    ends = drawn[int(0.025 * DRAWS)], drawn[int(0.975 * DRAWS)]
    value = statistic(items)
    return Figure(
        name,
        len(items) if n is None else n,
        hits,
        value,
        (float(ends[0]), float(ends[1])),
        target,
        as_share,
    )


def at_least(value: float) -> Target:
    """A lower end."""
    return Target(low=value)


def at_most(value: float) -> Target:
    """An upper end."""
    return Target(high=value)


def between(low: float, high: float) -> Target:
    """Both ends."""
    return Target(low, high)


__all__ = [
    "Figure", "Target", "at_least", "at_most", "between", "bootstrapped", "counted", "median", "quantile", "share",
]  # fmt: skip
