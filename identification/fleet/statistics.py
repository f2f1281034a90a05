"""What a summary says of a fleet: frequencies and sizes of effects, and which tolerances are met, with their intervals.

Use ``statistics(summary)`` for tables and pages.
"""

from __future__ import annotations

from dataclasses import dataclass

from truepose.identification.fleet.summary import Summary


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
    before; found: sum of its probabilities; size: the fleet's median, in expected largest sizes, spread: factor of one sigma
    between machines; amount: the median in ``unit``; None where it is hardly ever there.
    """

    mechanism: str
    effect: str
    place: tuple[str, ...]
    machines: int
    frequency: Interval
    usual: float
    found: float
    size: Interval | None
    spread: float | None
    amount: Interval | None
    unit: str


@dataclass(frozen=True)
class ToleranceInFleet:
    """A class of parts: true spread over the stated tolerance; met: probability that it is no more than stated (to 10 %)."""

    parts: str
    deviations: int
    ratio: Interval
    met: float


@dataclass(frozen=True)
class FleetStatistics:
    """machines: how many; anywhere: effects at any place, most frequent first; places: at each; tolerances: widest first."""

    machines: int
    anywhere: tuple[EffectInFleet, ...]
    places: tuple[EffectInFleet, ...]
    tolerances: tuple[ToleranceInFleet, ...]


def statistics(summary: Summary) -> FleetStatistics:
    """Everything that a table of the fleet says."""
    raise NotImplementedError
