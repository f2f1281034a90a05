"""Expressions printed in lanes, compiled with every warning an error and called through ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from support.generated_c import compile_library
from truepose.arrays import Array
from truepose.codegen.expressions import Graph
from truepose.codegen.lanes import LanePrinter, lane_runtime
from truepose.codegen.printer import Real

Evaluate = Callable[[Array, Array], Array]
TARGETS: dict[str, tuple[str, ...]] = {
    "this processor": ("-march=native", "-fno-math-errno"),
    "any processor": (),
    "without vectors": ("-DTRUEPOSE_SCALAR",),
}
DRIVER = """
void evaluate(const real *q, const real *p, int n, real *out);

void evaluate(const real *q, const real *p, int n, real *out)
{{
    int row;
    for (row = 0; row < n; row += LANES) {{
        lanes x[{nq}], y[{ny}];
        const int count = n - row < LANES ? n - row : LANES;
        lanes_load(q + row * {nq}, {nq}, count, {nq}, x);
        function(x, p, y);
        lanes_store(y, {ny}, {ny}, count, out + row * {ny});
    }}
}}
"""


def c_text(q: ca.SX, p: ca.SX, outputs: Sequence[ca.SX], real: Real) -> str:
    """A function of each row's q and of p, which all rows share."""
    graph = Graph()
    ends = [node for nodes in graph.add({"x": q, "p": p}, outputs) for node in nodes]
    printer = LanePrinter(graph, real, ("p",))
    body = "".join(
        f"    {line}\n" for line in printer.statements([(f"y[{k}]", e) for k, e in enumerate(ends)])
    )
    text = f"#include <math.h>\n\ntypedef {real} real;\n\n"
    text += lane_runtime(real, {*printer.helpers, "load", "store"})
    text += f"\nstatic void function(const lanes *x, const real *p, lanes *y)\n{{\n{body}}}\n"
    return text + DRIVER.format(nq=q.numel(), ny=len(ends))


def compiled(
    where: Path, q: ca.SX, p: ca.SX, outputs: Sequence[ca.SX], real: Real, flags: Sequence[str]
) -> Evaluate:
    """The function over rows (n, nq) and p, computed in ``real``."""
    where.mkdir(parents=True, exist_ok=True)
    (where / "lanes.c").write_text(c_text(q, p, outputs, real))
    function = compile_library(where, ["lanes.c"], "-O2", *flags).evaluate
    size, kind = sum(output.numel() for output in outputs), np.float64 if real == "double" else np.float32

    def evaluate(rows: Array, shared: Array) -> Array:
        given = np.ascontiguousarray(rows, dtype=kind), np.ascontiguousarray(shared, dtype=kind)
        out = np.empty((len(rows), size), dtype=kind)
        pointers = [ctypes.c_void_p(a.ctypes.data) for a in (*given, out)]
        function(pointers[0], pointers[1], len(rows), pointers[2])
        return out.astype(np.float64)

    return evaluate
