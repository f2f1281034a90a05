"""Expressions as C99 that evaluates several rows at once, in vector types of GCC and Clang.

``LanePrinter`` prints statements over ``lanes`` (a number of each of LANES rows) and ``real`` (what all rows share);
``lane_runtime`` is the C they need before them: the types, and helpers that work lane by lane.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from truepose.codegen.expressions import Graph, Node
from truepose.codegen.printer import (
    INFIX,
    LONGEST_INLINE,
    TESTS,
    Printer,
    Real,
    bare,
    literal,
    plain_forms,
    trigonometry,
)
from truepose.codegen.texts import environment

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


_CALLS = {op: op.lower() for op in (*UNARY, *BINARY, "FLOOR")} | {"CONSTPOW": "pow"}
_TURNS = {"SIN": "s", "COS": "c"}


@dataclass(frozen=True)
class Statement:
    """One or two C statements: the name they give a value, if any, and the names that they read."""

    text: str
    name: str = ""
    reads: frozenset[str] = frozenset()
    shared: bool = False


@dataclass(frozen=True)
class _Text:
    """How a node's value is written, and which names that reads; ``named`` texts can be pointed at."""

    text: str
    reads: frozenset[str]
    shared: bool
    named: bool


class LanePrinter(Printer):
    """Prints entries of a graph for LANES rows at once.

    Inputs named in ``shared`` are arrays of ``real``, all others arrays of ``lanes``; what depends on shared ones
    alone stays ``real``. ``given`` nodes are read from the places it names, of the type that their inputs tell.
    ``helpers`` (in ``lane_runtime``'s words) grows with what was printed.
    """

    def __init__(
        self, graph: Graph, real: Real, shared: Iterable[str], given: Mapping[int, str] | None = None
    ) -> None:
        super().__init__(graph, real, given)
        names = frozenset(shared)
        self._shared = [False] * len(graph.nodes)
        for k, node in enumerate(graph.nodes):
            leaf = node.op == "CONST" or (node.op == "INPUT" and node.leaf.split("[")[0] in names)
            self._shared[k] = leaf or (bool(node.args) and all(self._shared[a] for a in node.args))
        self.helpers: set[str] = set()
        self._lines: list[Statement] = []
        self._texts: dict[int, _Text] = {}
        self._turns_of: dict[int, str] = {}
        self._count = 0

    def statements(self, targets: Sequence[tuple[str, int]]) -> list[str]:
        """``place = expression;`` for every pair of a C place (of ``lanes``) and a node."""
        return [statement.text for statement in self.parts(targets)]

    def parts(self, targets: Sequence[tuple[str, int]], *, shared: bool = False) -> list[Statement]:
        """The statements one by one; with ``shared`` the places are of ``real``, as are their nodes."""
        ends = [node for _, node in targets]
        order = self._graph.reachable(ends, self._given)
        self._lines, self._texts, self._turns_of, self._count = [], {}, {}, 0
        uses = self._uses(order, ends)
        for node in order:
            self._texts[node] = self._stated(node, uses[node])
        for place, node in targets:
            end = self._texts[node]
            text = end.text if shared or not end.shared else f"LANES_OF({end.text})"
            self._lines.append(Statement(f"{place} = {text};", reads=end.reads))
        return self._lines

    def _stated(self, node: int, uses: int) -> _Text:
        """Return how a node is written, after the statements that it needs; its arguments are written already."""
        entry, shared = self._graph.nodes[node], self._shared[node]
        if node in self._given or not entry.args:
            named = node in self._given or entry.op == "INPUT"
            return _Text(self._leaf(node), frozenset(), shared, named)
        if entry.op in _TURNS and not shared:
            return self._turned_lanes(entry)
        if entry.op in (*_CALLS, "CEIL") and not shared:
            return self._called(entry)
        plain = entry.op in INFIX or entry.op in ("NEG", "TWICE", "INV") or shared
        args = [self._texts[a] if plain or self._texts[a].shared else self._pointed(a) for a in entry.args]
        text = self._written(entry, args)
        reads = frozenset[str]().union(*(a.reads for a in args))
        if plain and uses <= 1 and len(text) <= LONGEST_INLINE:
            return _Text(text, reads, shared, False)
        return self._named(f"const {'real' if shared else 'lanes'} {{}} = {bare(text)};", reads, shared)

    def _written(self, entry: Node, args: Sequence[_Text]) -> str:
        """An operation as an expression of its arguments' texts."""
        if all(a.shared for a in args):
            if entry.op in _TURNS:
                return f"{entry.op.lower()}{'f' if self._real == 'float' else ''}({args[0].text})"
            return self._operation(entry, [a.text for a in args])
        op, texts = entry.op, [a.text for a in args]
        if op in INFIX:
            return f"({texts[0]} {INFIX[op]} {texts[1]})"
        wide = [f"LANES_OF({a.text})" if a.shared else a.text for a in args]
        return self._by_macro(op, wide)

    def _by_macro(self, op: str, args: Sequence[str]) -> str:
        a, b = args[0], args[-1]
        one, two, zero = (literal(v, self._real) for v in (1.0, 2.0, 0.0))
        of_zero, of_one = f"LANES_OF({zero})", f"LANES_OF({one})"
        forms = {
            **plain_forms(a, one, two),
            "FABS": f"LANES_ABS({a})",
            "COPYSIGN": f"LANES_SIGNED({a}, {b})",
            "NOT": f"LANES_TEST({a} == {of_zero})",
            "AND": f"LANES_TEST(({a} != {of_zero}) & ({b} != {of_zero}))",
            "OR": f"LANES_TEST(({a} != {of_zero}) | ({b} != {of_zero}))",
            "IF_ELSE_ZERO": f"LANES_KEEP({a} != {of_zero}, {b})",
            "FMIN": f"LANES_SELECT(({a} < {b}) | ({b} != {b}), {a}, {b})",
            "FMAX": f"LANES_SELECT(({a} > {b}) | ({b} != {b}), {a}, {b})",
            "SIGN": f"LANES_SELECT({a} > {of_zero}, {of_one}, LANES_SELECT({a} < {of_zero}, LANES_OF(-{one}), {a}))",
        }
        if op in TESTS:
            return f"LANES_TEST({a} {TESTS[op]} {b})"
        if op in forms:
            return forms[op]
        raise NotImplementedError(f"found CasADi's operation {op}, which has no counterpart in lanes here")

    def _named(self, form: str, reads: frozenset[str], shared: bool = False) -> _Text:
        name = f"a{self._count}"
        self._count += 1
        self._lines.append(Statement(form.format(name), name, reads, shared))
        return _Text(name, frozenset({name}), shared, True)

    def _pointed(self, node: int) -> _Text:
        """A node of lanes that has a name: it can be pointed at, and be read twice."""
        here = self._texts[node]
        if here.shared:
            here = self._named(f"const lanes {{}} = LANES_OF({here.text});", here.reads)
        elif not here.named:
            here = self._texts[node] = self._named(f"const lanes {{}} = {bare(here.text)};", here.reads)
        return here

    def _called(self, entry: Node) -> _Text:
        """A function of the lane runtime: lanes go by address, so that no call depends on the vector ABI."""
        if entry.op == "CEIL":
            (a,) = (self._pointed(k) for k in entry.args)
            minus = self._named(f"const lanes {{}} = -{a.text};", a.reads)
            down = self._call("floor", [minus])
            return self._named(f"const lanes {{}} = -{down.text};", down.reads)
        return self._call(_CALLS[entry.op], [self._pointed(k) for k in entry.args])

    def _call(self, name: str, args: Sequence[_Text]) -> _Text:
        self.helpers.add(name)
        pointers = ", ".join(f"&{a.text}" for a in args)
        reads = frozenset[str]().union(*(a.reads for a in args))
        return self._named(f"lanes {{0}}; lanes_{name}({pointers}, &{{0}});", reads)

    def _turned_lanes(self, entry: Node) -> _Text:
        """A sine or cosine, computed with its fellow where their argument is met first."""
        (angle,) = entry.args
        if angle not in self._turns_of:
            a = self._pointed(angle)
            self.helpers.add("sincos")
            k = self._turns_of[angle] = str(self._count)
            self._count += 1
            text = f"lanes s{k}, c{k}; lanes_sincos(&{a.text}, &s{k}, &c{k});"
            self._lines.append(Statement(text, f"s{k} c{k}", a.reads))
        name = _TURNS[entry.op] + self._turns_of[angle]
        return _Text(name, frozenset({name}), False, True)
