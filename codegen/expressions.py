"""Scalar expressions of several CasADi functions in one shared graph, ready to be printed as C.

A node is created once for every operation and arguments, so what two functions have in common is shared.
Nodes that depend on constants and on *fixed* inputs alone (a calibration, say) are known as such: the
ones that others read can be computed once and kept (``Graph.kept``).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca

_COMMUTATIVE = ("ADD", "MUL", "EQ", "NE", "AND", "OR", "FMIN", "FMAX", "HYPOT")
_LEAVES = ("INPUT", "CONST")


@dataclass(frozen=True)
class Node:
    """One operation: CasADi's name of it (``ADD``, ``SIN`` ...), arguments, and what a leaf stands for."""

    op: str
    args: tuple[int, ...] = ()
    leaf: str = ""


class Graph:
    """Nodes in an order in which arguments come first. ``fixed`` names the inputs that change rarely."""

    def __init__(self, fixed: Iterable[str] = ()) -> None:
        self.nodes: list[Node] = []
        self._places: dict[Node, int] = {}
        self._fixed = frozenset(fixed)
        self._is_fixed: list[bool] = []

    def add(self, inputs: Mapping[str, ca.SX], outputs: Sequence[ca.SX]) -> list[list[int]]:
        """Nodes of every output's entries, column by column; input ``a`` is read as ``a[0], a[1] ...``."""
        function = ca.Function("f", list(inputs.values()), [ca.densify(output) for output in outputs])
        names, work = list(inputs), dict[int, int]()
        results = [[0] * output.numel() for output in outputs]
        for k in range(function.n_instructions()):
            op, into = _operations()[function.instruction_id(k)], function.instruction_output(k)
            arguments = function.instruction_input(k)
            if op == "OUTPUT":
                results[into[0]][into[1]] = work[arguments[0]]
            elif op == "ASSIGN":
                work[into[0]] = work[arguments[0]]
            elif op == "INPUT":
                work[into[0]] = self._leaf(
                    op, f"{names[arguments[0]]}[{arguments[1]}]", names[arguments[0]] in self._fixed
                )
            elif op == "CONST":
                work[into[0]] = self._leaf(op, repr(float(function.instruction_constant(k))), True)
            else:
                work[into[0]] = self._operation(op, tuple(work[a] for a in arguments))
        return results

    def negative(self, node: int) -> int:
        """Minus a node."""
        return self._operation("NEG", (node,))

    def reachable(self, ends: Iterable[int], stop: Iterable[int] = ()) -> list[int]:
        """What ``ends`` are computed from, arguments first; nodes in ``stop`` are not looked into."""
        given, seen, pending = frozenset(stop), set[int](), list(ends)
        while pending:
            node = pending.pop()
            if node not in seen:
                seen.add(node)
                pending += [] if node in given else self.nodes[node].args
        return sorted(seen)

    def kept(self, ends: Iterable[int]) -> list[int]:
        """Operations that fixed inputs determine and that ``ends``, or what is no longer fixed, read directly."""
        return self.settled(ends, {k for k, fixed in enumerate(self._is_fixed) if not fixed})

    def reading(self, name: str) -> set[int]:
        """Nodes that entries of one input go into, these included."""
        found = set[int]()
        for k, node in enumerate(self.nodes):
            if node.leaf.startswith(f"{name}[") or not found.isdisjoint(node.args):
                found.add(k)
        return found

    def settled(self, ends: Iterable[int], moving: Container[int]) -> list[int]:
        """Operations outside of ``moving`` that ``ends``, or what is in it, read directly."""
        still = {k for k, node in enumerate(self.nodes) if k not in moving and node.op not in _LEAVES}
        return [k for k in self.reachable(ends, still) if k in still]

    def evaluate(self, ends: Sequence[int], known: Mapping[str, Sequence[float]]) -> list[float]:
        """Values of nodes that the inputs in ``known`` determine."""
        values: dict[int, ca.DM] = {}
        for node in self.reachable(ends):
            entry = self.nodes[node]
            arguments = [values[a] for a in entry.args]
            if entry.op == "CONST":
                values[node] = ca.DM(float(entry.leaf))
            elif entry.op == "INPUT":
                name, place = entry.leaf.removesuffix("]").split("[")
                values[node] = ca.DM(float(known[name][int(place)]))
            else:
                apply = ca.DM.unary if len(arguments) == 1 else ca.DM.binary
                values[node] = apply(_codes()[entry.op], *arguments)
        return [float(values[node]) for node in ends]

    def _leaf(self, op: str, leaf: str, fixed: bool) -> int:
        return self._place(Node(op, (), leaf), fixed)

    def _operation(self, op: str, args: tuple[int, ...]) -> int:
        ordered = tuple(sorted(args)) if op in _COMMUTATIVE else args
        return self._place(Node(op, ordered), all(self._is_fixed[a] for a in args))

    def _place(self, node: Node, fixed: bool) -> int:
        if node not in self._places:
            self._places[node] = len(self.nodes)
            self.nodes.append(node)
            self._is_fixed.append(fixed)
        return self._places[node]


@cache
def _codes() -> Mapping[str, int]:
    return {name: code for code, name in _operations().items()}


@cache
def _operations() -> Mapping[int, str]:
    return {getattr(ca, name): name.removeprefix("OP_") for name in dir(ca) if name.startswith("OP_")}
