"""C that evaluates expressions for LANES rows at once, in functions short enough for a compiler.

What rows share is computed once, by ``before``; the rest by ``rows``, cut into parts of some hundred statements:
a compiler's time grows faster than a function's length. What one part leaves to a later one stands in ``w``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from truepose.codegen.expressions import Graph
from truepose.codegen.lanes import LanePrinter, Statement, lane_runtime

LENGTH = 200
"""Statements of one C function."""


@dataclass(frozen=True)
class RowWise:
    """C text with ``before(p, u)`` and ``rows(x, p, u, w, y)``, and how long its arrays are.

    ``x``, ``w`` and ``y`` are of ``lanes`` (inputs of a row, scratch, outputs), ``p`` and ``u`` of ``real`` (inputs that all
    rows share, what follows from them alone). None of the sizes is zero: C has no empty arrays.
    """

    text: str
    x: int
    p: int
    u: int
    w: int
    y: int


def rowwise(x: ca.SX, p: ca.SX, outputs: Sequence[ca.SX], helpers: Sequence[str] = ()) -> RowWise:
    """C of dense ``outputs``, column by column one after the other, of each row's ``x`` and the shared ``p``.

    ``helpers`` of ``lane_runtime`` are added. Raises NotImplementedError for an operation that C has not, ValueError for
    a constant that is not finite.
    """
    graph = Graph(fixed=("p",))
    ends = [node for nodes in graph.add({"x": x, "p": p}, outputs) for node in nodes]
    places = {node: f"u[{k}]" for k, node in enumerate(graph.kept(ends))}
    once = LanePrinter(graph, "double", ("p",))
    before = once.parts([(place, node) for node, place in places.items()], shared=True)
    each = LanePrinter(graph, "double", ("p",), places)
    parts, slots = _parts(each.parts([(f"y[{k}]", node) for k, node in enumerate(ends)]), "w", "lanes")
    first, kept = _parts(before, "v", "real")
    text = "#include <math.h>\n\ntypedef double real;\n\n" + lane_runtime("double", {*each.helpers, *helpers})
    text += _functions("before", ["const real *p", "real *u"], first, ("real *v", kept))
    text += _functions(
        "rows", ["const lanes *x", "const real *p", "const real *u", "lanes *w", "lanes *y"], parts
    )
    return RowWise(text, *(max(k, 1) for k in (x.numel(), p.numel(), len(places), slots, len(ends))))


def _parts(statements: Sequence[Statement], scratch: str, kind: str) -> tuple[list[list[str]], int]:
    """Lines of each part; and how many places of ``scratch`` hold what one part leaves to another."""
    parts = [statements[k : k + LENGTH] for k in range(0, len(statements), LENGTH)]
    made = {name: k for k, part in enumerate(parts) for s in part for name in s.name.split()}
    last = {name: k for k, part in enumerate(parts) for s in part for name in s.reads}
    places, free, size = dict[str, str](), list[str](), 0
    out: list[list[str]] = []
    for k, part in enumerate(parts):
        read = sorted({name for s in part for name in s.reads if made[name] < k})
        lines = [f"const {kind} {name} = {places[name]};" for name in read]
        lines += [s.text for s in part]
        for name in (name for s in part for name in s.name.split() if last.get(name, k) > k):
            if not free:
                free.append(f"{scratch}[{size}]")
                size += 1
            places[name] = free.pop()
            lines.append(f"{places[name]} = {name};")
        free += [places[name] for name in read if last[name] == k]
        out.append(lines)
    return out, size


def _functions(
    name: str, arguments: Sequence[str], parts: Sequence[Sequence[str]], local: tuple[str, int] | None = None
) -> str:
    """Static functions of the parts, and one of this name that calls them in turn; ``local`` is scratch of its own."""
    given = [*arguments, local[0]] if local else list(arguments)
    text = ""
    for k, lines in enumerate(parts):
        body = "".join(f"    {line}\n" for line in lines)
        text += f"\nstatic __attribute__((noinline)) void {name}_{k}({', '.join(given)})\n{{\n{body}}}\n"
    call = ", ".join(argument.split()[-1].lstrip("*") for argument in given)
    calls = "".join(f"    {name}_{k}({call});\n" for k in range(len(parts)))
    if local:
        calls = f"    real {local[0].split('*')[-1]}[{max(local[1], 1)}];\n{calls}"
    return f"{text}\nstatic void {name}({', '.join(arguments)})\n{{\n{calls}}}\n"
