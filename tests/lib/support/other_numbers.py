"""CasADi's instructions run with other numbers than doubles: a derivative obtained another way, or forty digits.

By complex steps: the instructions of the value, not of its derivative, are run with complex numbers,
f'(x) = Im f(x + ih)/h, which loses nothing to cancellation (h = 1e-30).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import mpmath  # type: ignore[import-untyped]
import numpy as np

from truepose.arrays import Array


def _complex_atan2(y: Any, x: Any) -> Any:
    """The angle and its derivative along the imaginary direction."""
    return np.arctan2(y.real, x.real) + 1j * (y.imag * x.real - x.imag * y.real) / (x.real**2 + y.real**2)


PLAIN_FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "sinh", "cosh")
COMPLEX = SimpleNamespace(
    **{name: getattr(np, name) for name in PLAIN_FUNCTIONS},
    **{f"a{name}": getattr(np, f"arc{name}") for name in ("tan", "sin", "cos")},
    atan2=_complex_atan2,
    fabs=lambda a: a * np.sign(a.real),
    sign=lambda a: np.sign(a.real) + 0j,
    below=lambda a, b: a.real < b.real,
    where=np.where,
)
FUNCTIONS = (*PLAIN_FUNCTIONS, "atan", "asin", "acos", "fabs", "sign")
DIGITS = SimpleNamespace(
    **{name: getattr(mpmath, name) for name in (*FUNCTIONS, "atan2")},
    below=lambda a, b: a < b,
    where=lambda c, a, b: a if c else b,
)
UNARY = {getattr(ca, f"OP_{name.upper()}"): name for name in FUNCTIONS}
BINARY: Mapping[int, Callable[[Any, Any, Any], Any]] = {
    ca.OP_ADD: lambda _, a, b: a + b,
    ca.OP_SUB: lambda _, a, b: a - b,
    ca.OP_MUL: lambda _, a, b: a * b,
    ca.OP_DIV: lambda _, a, b: a / b,
    ca.OP_POW: lambda _, a, b: a**b,
    ca.OP_CONSTPOW: lambda _, a, b: a**b,
    ca.OP_ATAN2: lambda m, a, b: m.atan2(a, b),
    ca.OP_FMIN: lambda m, a, b: m.where(m.below(a, b), a, b),
    ca.OP_FMAX: lambda m, a, b: m.where(m.below(a, b), b, a),
    ca.OP_LT: lambda m, a, b: m.where(m.below(a, b), 1, 0),
    ca.OP_LE: lambda m, a, b: m.where(m.below(b, a), 0, 1),
    ca.OP_IF_ELSE_ZERO: lambda m, a, b: m.where(m.below(a * a, 0.25 + 0 * a), 0 * b, b),
}
PLAIN: Mapping[int, Callable[[Any], Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_INV: lambda a: 1 / a,
}


def run(function: ca.Function, inputs: Sequence[Any], numbers: SimpleNamespace) -> list[list[Any]]:
    """The function's instructions with other numbers than doubles: outputs by index, columns first."""
    work: list[Any] = [None] * function.sz_w()
    nothing = 0 * next(part[0] for part in inputs if len(part))  # of the right kind and shape
    outputs: list[list[Any]] = [[None] * function.nnz_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        code, into = function.instruction_id(k), function.instruction_input(k)
        out = function.instruction_output(k)
        if code == ca.OP_CONST:
            work[out[0]] = function.instruction_constant(k) + nothing
        elif code == ca.OP_INPUT:
            work[out[0]] = inputs[into[0]][into[1]]
        elif code == ca.OP_OUTPUT:
            outputs[out[0]][out[1]] = work[into[0]]
        elif code in PLAIN:
            work[out[0]] = PLAIN[code](work[into[0]])
        elif code in UNARY:
            work[out[0]] = getattr(numbers, UNARY[code])(work[into[0]])
        else:
            work[out[0]] = BINARY[code](numbers, work[into[0]], work[into[1]])
    return outputs


def complex_step(inputs: Sequence[ca.SX], at: Sequence[Array], value: ca.SX, by: int) -> Array:
    """(n, m) derivative of ``value`` by input number ``by``, all columns at once."""
    function = ca.Function("f", list(inputs), [ca.densify(ca.vec(value))])
    m = len(at[by])
    numbers = [np.asarray(a, dtype=complex)[:, None] + np.zeros(m) for a in at]
    numbers[by] = numbers[by] + 1e-30j * np.eye(m)
    (out,) = run(function, numbers, COMPLEX)
    return np.array([np.imag(row) for row in out]) / 1e-30
