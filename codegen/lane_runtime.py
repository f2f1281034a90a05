"""The C that expressions over several rows need before them: vector types, and functions that work lane by lane.

Sine and cosine are this project's (``trigonometry``); all other functions are those of the C library, a lane at a time.
The sine of -0 is 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from truepose.codegen.printer import Real, literal
from truepose.codegen.texts import environment
from truepose.codegen.trigonometry import trigonometry

UNARY: tuple[str, ...] = ("SQRT", "EXP", "LOG", "TAN", "ASIN", "ACOS", "ATAN", "SINH", "COSH", "TANH")
UNARY += ("ASINH", "ACOSH", "ATANH", "ERF", "LOG1P", "EXPM1")
BINARY = ("POW", "ATAN2", "FMOD", "HYPOT", "REMAINDER")
"""Functions of the C library that are called for each lane."""


def lane_runtime(real: Real, helpers: Iterable[str]) -> str:
    """C before what a LanePrinter prints, for what it names in ``helpers``, and for loading and storing of rows.

    ``load`` and ``store`` among the helpers ask for these two. It wants ``real`` and math.h before it.
    """
    wanted = frozenset(helpers)
    single = real == "float"

    context: dict[str, Any] = {
        "real": real,
        "f": "f" if single else "",
        "integer": "int" if single else "long long",
        "helpers": wanted,
        "unary": [op.lower() for op in UNARY if op.lower() in wanted],
        "binary": [op.lower() for op in BINARY if op.lower() in wanted],
        "lit": lambda value: literal(value, real),
        "whole": 2.0**23 if single else 2.0**52,
        "magic": 1.5 * (2.0**23 if single else 2.0**52),
        **trigonometry(real),
    }
    return environment().get_template("lanes.c.j2").render(context)
