"""Curves of one source: over the range in which it was seen, and what is left of them beyond it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.machine.smooth import chebyshev

LINE_END = 2.0
"""Where a line ends, in halves of the range seen: most that is linear goes on, but not for ever."""
NOTHING = 1e-9
"""Of the largest moment: what is added to its size, whose derivative at zero does not exist."""


@dataclass(frozen=True)
class Source:
    """A reading, a driver or the place's load that a form is a function of, and the range in which it was seen."""

    name: str
    low: float
    high: float

    def within(self, value: ca.SX, end: float = 1.0) -> ca.SX:
        """The value scaled to -1 ... 1 over the range (an operation less than ``scaled``, for the controller), and held at
        -``end`` and ``end`` outside of it.
        """
        return ca.fmax(-end, ca.fmin(end, (2 * value - (self.low + self.high)) / (self.high - self.low)))

    def overshoot(self, values: Array) -> Array:
        """(n,) how far values lie outside of the range, in halves of it."""
        return outside((2 * values - (self.low + self.high)) / (self.high - self.low))


def series(coefficients: Mapping[int, ca.SX], t: ca.SX) -> ca.SX:
    """Sum of c_k T_k(t), T_k the Chebyshev polynomials."""
    polynomials = chebyshev(t, max(coefficients))
    return total(c * polynomials[k] for k, c in coefficients.items())


def yielding(
    source: Source, moment: Mapping[str, ca.SX], coefficients: Mapping[str, Mapping[int, ca.SX]], end: float
) -> dict[str, ca.SX]:
    """What turns about axes with a moment M (N m) by a characteristic of its size: M_a / M_max (c1 + c2 T1(m) + c3 T2(m)).

    ``source``: the sizes that were seen, up to M_max; m runs from -1 to 1 over them. Past ``end`` M_max it turns no further.
    """
    size = ca.sqrt(sum((m**2 for m in moment.values()), ca.SX((NOTHING * source.high) ** 2)))
    held = ca.fmin(1.0, end * source.high / size) / source.high
    t = source.within(size)
    return {
        axis: held * m * series({k - 1: c for k, c in coefficients[axis].items()}, t)
        for axis, m in moment.items()
    }


def total(terms: Iterable[ca.SX]) -> ca.SX:
    return sum(terms, ca.SX(0))


def outside(scaled: Array) -> Array:
    """How far values that should lie in -1 ... 1 lie outside."""
    return np.maximum(np.abs(scaled) - 1.0, 0.0)


__all__ = ["LINE_END", "Source", "outside", "series", "total", "yielding"]
