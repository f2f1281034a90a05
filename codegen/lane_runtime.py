"""The C that expressions over several rows need before them: vector types, and functions that work lane by lane.

Sine and cosine are polynomials of this project about the nearest multiple of pi/2, found by Remez' exchange in 60
digits and rounded; all other functions are those of the C library, a lane at a time. The sine of -0 is 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from truepose.codegen.printer import Real, literal
from truepose.codegen.texts import environment

UNARY: tuple[str, ...] = ("SQRT", "EXP", "LOG", "TAN", "ASIN", "ACOS", "ATAN", "SINH", "COSH", "TANH")
UNARY += ("ASINH", "ACOSH", "ATANH", "ERF", "LOG1P", "EXPM1")
BINARY = ("POW", "ATAN2", "FMOD", "HYPOT", "REMAINDER")
"""Functions of the C library that are called for each lane."""

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


def lane_runtime(real: Real, helpers: Iterable[str]) -> str:
    """C before what a LanePrinter prints, for what it names in ``helpers``, and for loading and storing of rows.

    ``load`` and ``store`` among the helpers ask for these two. It wants ``real`` and math.h before it.
    """
    wanted = frozenset(helpers)
    single = real == "float"

    def lit(value: float) -> str:
        return literal(value, real)

    def horner(coefficients: Sequence[float]) -> str:
        text = lit(coefficients[-1])
        for c in reversed(coefficients[:-1]):
            text = f"({lit(c)} + z * {text})"
        return text

    context: dict[str, Any] = {
        "real": real,
        "f": "f" if single else "",
        "integer": "int" if single else "long long",
        "helpers": wanted,
        "unary": [op.lower() for op in UNARY if op.lower() in wanted],
        "binary": [op.lower() for op in BINARY if op.lower() in wanted],
        "lit": lit,
        "horner": horner,
        "pi": math.pi,
        "whole": 2.0**23 if single else 2.0**52,
        "magic": 1.5 * (2.0**23 if single else 2.0**52),
        "parts": QUARTER_TURN[real],
        "limit": FARTHEST[real],
        "sine": SINE[real],
        "cosine": COSINE[real],
    }
    return environment().get_template("lanes.c.j2").render(context)


__all__ = ["BINARY", "COSINE", "FARTHEST", "QUARTER_TURN", "SINE", "UNARY", "lane_runtime"]
