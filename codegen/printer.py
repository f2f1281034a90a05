"""Expressions as C99: static functions whose bodies are scalar assignments, in double or single precision."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from truepose.codegen.expressions import Graph, Node

Real = Literal["double", "float"]
LONGEST_INLINE = 56
INFIX = {"ADD": "+", "SUB": "-", "MUL": "*", "DIV": "/"}
TESTS = {"LT": "<", "LE": "<=", "EQ": "==", "NE": "!="}
_CALLED = (
    "EXP LOG POW SQRT TAN ASIN ACOS ATAN ATAN2 SINH COSH TANH ASINH ACOSH ATANH FLOOR CEIL FMOD FABS COPYSIGN ERF FMIN FMAX"
    " LOG1P EXPM1 HYPOT REMAINDER"
)
_CALLS = {op: op.lower() for op in _CALLED.split()} | {"CONSTPOW": "pow"}
"""Functions of the C library by CasADi's operations."""


def literal(value: float, real: Real) -> str:
    """The shortest C constant that reads back as ``value``, rounded to single precision for float."""
    if not math.isfinite(value):
        raise ValueError(f"found {value}, expected a finite number: C99 has no portable literal for others")
    if real == "double":
        return repr(float(value))
    text = str(np.float32(value))
    return f"{text if '.' in text or 'e' in text else text + '.0'}f"


class Printer:
    """Prints entries of a graph as C statements; ``given`` nodes are read from the places it names.

    ``own`` names functions of the C runtime that stand in for those of the C library, by operation.
    """

    def __init__(
        self,
        graph: Graph,
        real: Real,
        given: Mapping[int, str] | None = None,
        own: Mapping[str, str] | None = None,
    ) -> None:
        self._graph, self._real, self._given, self._own = graph, real, dict(given or {}), dict(own or {})

    def statements(self, targets: Sequence[tuple[str, int]]) -> list[str]:
        """``place = expression;`` for every pair of a C place and a node; what is shared is computed once.

        Sine and cosine of one argument are one call of ``sin_cos`` of the C runtime.
        """
        ends = [node for _, node in targets]
        order = self._graph.reachable(ends, self._given)
        uses = self._uses(order, ends)
        text: dict[int, str] = {}
        lines: list[str] = []
        turns: dict[int, int] = {}
        for node in order:
            if self._turns(node):
                text[node] = self._turned(node, text, turns, lines)
                continue
            text[node] = self._text(node, text)
            if self._needs_name(node, text[node], uses[node]):
                name = f"a{len(lines)}"
                lines.append(f"const real {name} = {bare(text[node])};")
                text[node] = name
        return lines + [f"{place} = {bare(text[node])};" for place, node in targets]

    def _uses(self, order: Iterable[int], ends: Iterable[int]) -> Counter[int]:
        """How often each node is written."""
        uses = Counter(ends)
        for node in order:
            if node not in self._given:
                entry = self._graph.nodes[node]
                uses.update(entry.args * (2 if entry.op in ("SQ", "SIGN") else 1))
        return uses

    def _turns(self, node: int) -> bool:
        return node not in self._given and self._graph.nodes[node].op in ("SIN", "COS")

    def _turned(self, node: int, text: Mapping[int, str], turns: dict[int, int], lines: list[str]) -> str:
        """Name of a sine or cosine, computed with its fellow where the argument is met first."""
        entry = self._graph.nodes[node]
        (angle,) = entry.args
        if angle not in turns:
            turns[angle] = k = len(lines)
            lines.append(f"real s{k}, c{k};")
            lines.append(f"sin_cos({bare(text[angle])}, &s{k}, &c{k});")
        return f"{entry.op[0].lower()}{turns[angle]}"

    def _needs_name(self, node: int, text: str, uses: int) -> bool:
        if node in self._given or not self._graph.nodes[node].args:
            return False
        return uses > 1 or len(text) > LONGEST_INLINE

    def _text(self, node: int, text: Mapping[int, str]) -> str:
        entry = self._graph.nodes[node]
        if node in self._given or not entry.args:
            return self._leaf(node)
        return self._operation(entry, [text[a] for a in entry.args])

    def _leaf(self, node: int) -> str:
        """A given node, an input or a constant."""
        if node in self._given:
            return self._given[node]
        entry = self._graph.nodes[node]
        if entry.op == "INPUT":
            return entry.leaf
        value = literal(float(entry.leaf), self._real)
        return f"({value})" if value.startswith("-") else value

    def _operation(self, entry: Node, args: Sequence[str]) -> str:
        op, a = entry.op, args[0]
        b = args[1] if len(args) > 1 else ""
        one, two, zero = (literal(v, self._real) for v in (1.0, 2.0, 0.0))
        special = {
            **plain_forms(a, one, two),
            "NOT": f"(({a} == {zero}) ? {one} : {zero})",
            "SIGN": f"((real)(({a} > {zero}) - ({a} < {zero})))",
            "IF_ELSE_ZERO": f"(({a} != {zero}) ? {b} : {zero})",
        }
        if op in INFIX:
            return f"({a} {INFIX[op]} {b})"
        if op in self._own:
            return f"{self._own[op]}({', '.join(bare(arg) for arg in args)})"
        if op in _CALLS:
            return (
                f"{_CALLS[op]}{'f' if self._real == 'float' else ''}({', '.join(bare(arg) for arg in args)})"
            )
        if op in ("AND", "OR"):
            return f"((({a} != {zero}) {'&&' if op == 'AND' else '||'} ({b} != {zero})) ? {one} : {zero})"
        if op in TESTS:
            return f"(({a} {TESTS[op]} {b}) ? {one} : {zero})"
        if op in special:
            return special[op]
        raise NotImplementedError(f"found CasADi's operation {op}, which has no C99 counterpart here")


def plain_forms(a: str, one: str, two: str) -> dict[str, str]:
    """Return what C needs no function for, of a scalar as of lanes, by CasADi's operations; constants as C writes them."""
    return {"NEG": f"(-{a})", "SQ": f"({a} * {a})", "TWICE": f"({two} * {a})", "INV": f"({one} / {a})"}


def bare(text: str) -> str:
    """Without the outer pair of brackets, where it encloses everything."""
    if not text.startswith("("):
        return text
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return text[1:-1] if k == len(text) - 1 else text
    return text


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
