"""Sine and cosine of the generated C: polynomials about the nearest multiple of pi/2.

Coefficients were found by Remez' exchange in 60 digits and rounded; the same serve one angle and a vector of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from truepose.codegen.printer import Real, literal

SINE: Mapping[Real, tuple[float, ...]] = {
    "double": (
        -0.16666666666666632,
        0.008333333333322424,
        -0.00019841269829816817,
        2.7557313695177738e-06,
        -2.5050758645319124e-08,
        1.5896827451067535e-10,
    ),
    "float": (-0.1666665494359729, 0.008332178139328739, -0.00019517298028861942),
}
"""S of sin(r) = r + r^3 S(r^2), least largest relative error (2^-58, 2^-28) for |r| < 0.7854."""
COSINE: Mapping[Real, tuple[float, ...]] = {
    "double": (
        0.0416666666666666,
        -0.0013888888888874138,
        2.480158728949169e-05,
        -2.755731435520116e-07,
        2.087572367866976e-09,
        -1.1359669557960587e-11,
    ),
    "float": (0.041666646866267296, -0.0013887367506762633, 2.4438450524594758e-05),
}
"""C of cos(r) = 1 - r^2/2 + r^4 C(r^2), least largest error (2^-64, 2^-33) for |r| < 0.7854."""
QUARTER_TURN: Mapping[Real, tuple[float, float, float]] = {
    "double": (1.5707963267923333, 2.5633441515839558e-12, 1.0562999066987428e-23),
    "float": (1.5706787109375, 0.00011761486530303955, 9.920935796805404e-10),
}
"""pi/2 in three parts; the first two are short enough that their products with a count of quarter turns are exact."""
FARTHEST: Mapping[Real, float] = {"double": 1e5, "float": 1e3}
"""Beyond this many radians sine and cosine come from the C library."""


def trigonometry(real: Real) -> dict[str, Any]:
    """What templates read: ``sine`` and ``cosine`` (of ``z``, the square of the angle), ``parts``, ``farthest`` and ``pi``."""

    def horner(coefficients: Sequence[float]) -> str:
        text = literal(coefficients[-1], real)
        for c in reversed(coefficients[:-1]):
            text = f"({literal(c, real)} + z * {text})"
        return text

    return {
        "sine": horner(SINE[real]),
        "cosine": horner(COSINE[real]),
        "parts": QUARTER_TURN[real],
        "farthest": FARTHEST[real],
        "pi": math.pi,
    }
