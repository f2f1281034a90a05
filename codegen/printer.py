"""Expressions as C99: static functions whose bodies are scalar assignments, in double or single precision."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from truepose.codegen.expressions import Graph, Node

Real = Literal["double", "float"]
_LONGEST_INLINE = 56
_INFIX = {"ADD": "+", "SUB": "-", "MUL": "*", "DIV": "/"}
_TRUTH = {"LT": "<", "LE": "<=", "EQ": "==", "NE": "!=", "AND": "&&", "OR": "||"}
_CALLS = {
    **{op: op.lower() for op in ("EXP", "LOG", "POW", "SQRT", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2")},
    **{
        op: op.lower()
        for op in ("SINH", "COSH", "TANH", "ASINH", "ACOSH", "ATANH", "FLOOR", "CEIL", "FMOD", "FABS")
    },
    **{op: op.lower() for op in ("COPYSIGN", "ERF", "FMIN", "FMAX", "LOG1P", "EXPM1", "HYPOT", "REMAINDER")},
    "CONSTPOW": "pow",
}


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
        uses = Counter(ends)
        for node in order:
            if node not in self._given:
                entry = self._graph.nodes[node]
                uses.update(entry.args * (2 if entry.op in ("SQ", "SIGN") else 1))
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
                lines.append(f"const real {name} = {_bare(text[node])};")
                text[node] = name
        return lines + [f"{place} = {_bare(text[node])};" for place, node in targets]

    def _turns(self, node: int) -> bool:
        return node not in self._given and self._graph.nodes[node].op in ("SIN", "COS")

    def _turned(self, node: int, text: Mapping[int, str], turns: dict[int, int], lines: list[str]) -> str:
        """Name of a sine or cosine, computed with its fellow where the argument is met first."""
        entry = self._graph.nodes[node]
        (angle,) = entry.args
        if angle not in turns:
            turns[angle] = k = len(lines)
            lines.append(f"real s{k}, c{k};")
            lines.append(f"sin_cos({_bare(text[angle])}, &s{k}, &c{k});")
        return f"{entry.op[0].lower()}{turns[angle]}"

    def _needs_name(self, node: int, text: str, uses: int) -> bool:
        if node in self._given or not self._graph.nodes[node].args:
            return False
        return uses > 1 or len(text) > _LONGEST_INLINE

    def _text(self, node: int, text: Mapping[int, str]) -> str:
        if node in self._given:
            return self._given[node]
        entry = self._graph.nodes[node]
        if entry.op == "INPUT":
            return entry.leaf
        if entry.op == "CONST":
            value = literal(float(entry.leaf), self._real)
            return f"({value})" if value.startswith("-") else value
        return self._operation(entry, [text[a] for a in entry.args])

    def _operation(self, entry: Node, args: Sequence[str]) -> str:
        op, a = entry.op, args[0]
        b = args[1] if len(args) > 1 else ""
        one, two, zero = (literal(v, self._real) for v in (1.0, 2.0, 0.0))
        special = {
            "NEG": f"(-{a})",
            "SQ": f"({a} * {a})",
            "TWICE": f"({two} * {a})",
            "INV": f"({one} / {a})",
            "NOT": f"(({a} == {zero}) ? {one} : {zero})",
            "SIGN": f"((real)(({a} > {zero}) - ({a} < {zero})))",
            "IF_ELSE_ZERO": f"(({a} != {zero}) ? {b} : {zero})",
        }
        if op in _INFIX:
            return f"({a} {_INFIX[op]} {b})"
        if op in self._own:
            return f"{self._own[op]}({', '.join(_bare(arg) for arg in args)})"
        if op in _CALLS:
            return (
                f"{_CALLS[op]}{'f' if self._real == 'float' else ''}({', '.join(_bare(arg) for arg in args)})"
            )
        if op in ("AND", "OR"):
            return f"((({a} != {zero}) {_TRUTH[op]} ({b} != {zero})) ? {one} : {zero})"
        if op in _TRUTH:
            return f"(({a} {_TRUTH[op]} {b}) ? {one} : {zero})"
        if op in special:
            return special[op]
        raise NotImplementedError(f"found CasADi's operation {op}, which has no C99 counterpart here")


def _bare(text: str) -> str:
    """Without the outer pair of brackets, where it encloses everything."""
    if not text.startswith("("):
        return text
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return text[1:-1] if k == len(text) - 1 else text
    return text
