"""Smooth functions of one variable over the range in which it was seen: what an unknown dependence is made of.

How many of which kind is for whoever asks: powers and waves where structure is looked for, Chebyshev polynomials, which
are alike in size, where coefficients are to be judged by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from truepose.arrays import Array


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
