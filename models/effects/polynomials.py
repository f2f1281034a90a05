"""Curves and products of curves that forms without a name are made of, and how their settings say of what, and how far."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array

FROM, TO, DEGREE, SPATIAL, WIDTH = "from.", "to.", "degree", "spatial", "reach"
DECAY = 2.0
"""Coefficients of a curve fall as the degree to this power."""


def scaled(values: Array, low: float, high: float) -> Array:
    """(n,) values moved and stretched so that ``low`` is -1 and ``high``, which is above it, is 1."""
    return 2 * (values - low) / (high - low) - 1


def chebyshev(t: Any, degree: int) -> list[Any]:
    """T_0(t) to T_degree(t) of numbers (n,) in -1 ... 1, or of a CasADi expression; T_0 is the number 1."""
    found = [1, t]
    for _ in range(2, degree + 1):
        found.append(2 * t * found[-1] - found[-2])
    return found[: degree + 1]


def powers(t: Array, degree: int) -> list[Array]:
    """(n,) each: t, t^2 to t^degree."""
    return [t**k for k in range(1, degree + 1)]


def waves(t: Array, cycles: int) -> list[Array]:
    """(n,) each: sine and cosine of so many cycles over -1 ... 1."""
    phase = np.pi * cycles * t
    return [np.sin(phase), np.cos(phase)]


def orthonormal(functions: Sequence[Array]) -> Array:
    """(n, k) orthonormal columns that span the k functions (n,) less their means, in their order."""
    basis, _ = np.linalg.qr(np.column_stack([np.ones(len(functions[0])), *functions]))
    return np.asarray(basis[:, 1:])


def total(terms: Iterable[ca.SX]) -> ca.SX:
    return sum(terms, ca.SX(0))


def outside(scaled: Array) -> Array:
    """How far values that should lie in -1 ... 1 lie outside."""
    return np.maximum(np.abs(scaled) - 1.0, 0.0)


@dataclass(frozen=True)
class Source:
    """A reading, a driver or the place's load that a form is a function of, and the range in which it was seen."""

    name: str
    low: float
    high: float

    def within(self, value: ca.SX) -> ca.SX:
        """The value scaled to -1 ... 1 over the range (an operation less than ``scaled``, for the controller), and held at its
        ends outside of it."""
        return ca.fmax(-1.0, ca.fmin(1.0, (2 * value - (self.low + self.high)) / (self.high - self.low)))

    def overshoot(self, values: Array) -> Array:
        """(n,) how far values lie outside of the range, in halves of it."""
        return outside((2 * values - (self.low + self.high)) / (self.high - self.low))


def series(coefficients: Mapping[int, ca.SX], t: ca.SX) -> ca.SX:
    """Sum of c_k T_k(t), T_k the Chebyshev polynomials."""
    polynomials = chebyshev(t, max(coefficients))
    return total(c * polynomials[k] for k, c in coefficients.items())


Exponents = tuple[int, ...]
"""Degree of each source's polynomial in a product of them."""


def exponents(count: int, degree: int) -> list[Exponents]:
    """Return the products of polynomials of ``count`` sources up to a total ``degree``; those of fewer sources first."""
    drawn = (
        c for d in range(1, degree + 1) for c in itertools.combinations_with_replacement(range(count), d)
    )
    every = (tuple(c.count(k) for k in range(count)) for c in drawn)
    return sorted(every, key=lambda e: (sum(k > 0 for k in e), sum(e), [-k for k in e]))


def products(columns: Sequence[Any], wanted: Sequence[Exponents]) -> list[Any]:
    """Return the product of Chebyshev polynomials of each exponents, of numbers (n,) or expressions in -1 ... 1."""
    most = max((k for e in wanted for k in e), default=0)
    polynomials = [chebyshev(t, most) for t in columns]
    return [math.prod(p[k] for p, k in zip(polynomials, e, strict=True) if k) for e in wanted]


def seen_over(
    ranges: Mapping[str, tuple[float, float]], degree: int | None = None, *, spatial: bool = False
) -> dict[str, float]:
    """Settings of a form in the sources of ``ranges``, lowest and highest value seen (mm, rad, or the driver's unit)."""
    own = {} if degree is None else {DEGREE: float(degree)}
    own |= {SPATIAL: 1.0} if spatial else {}
    lows = {f"{FROM}{name}": float(low) for name, (low, _) in ranges.items()}
    return own | lows | {f"{TO}{name}": float(high) for name, (_, high) in ranges.items()}
