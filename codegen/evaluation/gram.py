"""Sums over rows of w [J r]'[J r], without ever keeping the rows: normal equations of any number of rows.

Use ``GramFunction`` where residual r (m,) and Jacobian J (m, n) are explicit expressions and only their sums are
wanted. It squares the condition number: what decides about rank or null space needs ``leastsquares.triangular``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.evaluation.batch import (
    BatchFunction,
    Engine,
    RowInputs,
    RowWise,
    loads,
    pointers,
    rows_of,
    rowwise,
    scratch,
)
from truepose.codegen.evaluation.compiled import load

CHUNK = 16384
"""Rows that are summed before they are added to the rest: rounding grows with the root of the chunks."""


class GramFunction:
    """The Gram matrix of [J r] over rows; ``rows`` and ``engine`` as of a BatchFunction."""

    def __init__(
        self, name: str, inputs: Sequence[ca.SX], residual: ca.SX, jacobian: ca.SX, *, rows: int = 0
    ) -> None:
        self._inputs, self._columns = list(inputs), ca.horzcat(jacobian, residual)
        self._sizes = [int(item.numel()) for item in inputs]
        self._rows = BatchFunction(name, inputs, [self._columns])
        self.engine = Engine(
            rows, self._rows.instructions, lambda given: _Compiled(given, self._inputs, self._columns)
        )

    def __call__(self, *inputs: Array, weight: Array | None = None) -> Array:
        """(n + 1, n + 1) sums over rows of inputs (rows, size), or (size,) where all share one; ``weight`` (rows,).

        A row of weight 0 counts nothing, whatever is in it.
        """
        rows, size = rows_of(inputs), self._columns.shape[1]
        given = RowInputs.of(self._sizes, inputs)
        compiled = self.engine.library(given)
        evaluate = compiled or self._by_rows
        total = np.zeros((size, size))
        for start in range(0, rows, CHUNK):
            part = slice(start, start + CHUNK)
            some = [a if s or len(a) != rows else a[part] for a, s in zip(inputs, given.shared, strict=True)]
            total += evaluate(some, None if weight is None else weight[part], min(CHUNK, rows - start))
        return total

    def _by_rows(self, inputs: Sequence[Array], weight: Array | None, rows: int) -> Array:
        """By the virtual machine, some hundred rows at a time."""
        total = np.zeros((self._columns.shape[1],) * 2)
        every = RowInputs(tuple(self._sizes), (False,) * len(self._sizes)).own(inputs, rows)
        for start in range(0, rows, 256):
            part = slice(start, start + 256)
            stacked = self._rows(*(a[part] for a in every))[0]
            if weight is not None:
                counts = weight[part] > 0
                stacked = stacked[counts] * np.sqrt(weight[part][counts])[:, None, None]
            flat = stacked.reshape(-1, stacked.shape[2])
            total += flat.T @ flat
        return total


class _Compiled:
    """The same as C. Raises NotCompiledError, NotImplementedError, ValueError."""

    def __init__(self, given: RowInputs, inputs: Sequence[ca.SX], columns: ca.SX) -> None:
        self._given, self._upper = given, np.triu_indices(columns.shape[1])
        code = rowwise(*given.symbols(inputs), [ca.densify(columns)], ("load",))
        self._lanes, self._reals = code.x + code.w + code.y + len(self._upper[0]), code.u
        source = code.text + _sum_up(code, loads(given.widths), *columns.shape)
        self._sum = load(source, ["sum_up"], fused=True).sum_up
        self._sum.argtypes = [ctypes.c_longlong, *[ctypes.c_void_p] * 5]
        self._sum.restype = None

    def __call__(self, inputs: Sequence[Array], weight: Array | None, rows: int) -> Array:
        own, p = self._given.own(inputs, rows), self._given.common(inputs)
        root = np.ones(rows) if weight is None else np.sqrt(weight)
        work, sums = scratch(self._lanes, self._reals), np.zeros(len(self._upper[0]))
        at = [array.ctypes.data for array in (p, root, work, sums)]
        self._sum(rows, pointers(own), *at)
        size = int(self._upper[0][-1]) + 1
        out = np.zeros((size, size))
        out[self._upper] = out.T[self._upper] = sums
        return out


def _sum_up(code: RowWise, reading: str, height: int, width: int) -> str:
    """The loop over rows: evaluate, weigh by a root, add products of columns; the lanes of each sum are added up in the end."""
    size = width * (width + 1) // 2
    return f"""
void sum_up(long long n, const real *const *in, const real *p, const real *weight, real *work, real *out);

void sum_up(long long n, const real *const *in, const real *p, const real *weight, real *work, real *out)
{{
    lanes *x = (lanes *)work, *w = x + {code.x}, *y = w + {code.w}, *sums = y + {code.y};
    real *u = (real *)(sums + {size});
    long long row;
    int i, j, k, t;
    before(p, u);
    for (t = 0; t < {size}; t++)
        sums[t] = LANES_OF(0.0);
    for (row = 0; row < n; row += LANES) {{
        const int count = n - row < LANES ? (int)(n - row) : LANES;
        lanes root = LANES_OF(0.0);
{reading}        rows(x, p, u, w, y);
        for (k = 0; k < count; k++)
            ((real *)&root)[k] = weight[row + k];
        for (k = 0; k < {code.y}; k++)
            y[k] = LANES_KEEP(root != LANES_OF(0.0), y[k] * root);
        for (i = 0, t = 0; i < {width}; i++)
            for (j = i; j < {width}; j++, t++)
                for (k = 0; k < {height}; k++)
                    sums[t] += y[i * {height} + k] * y[j * {height} + k];
    }}
    for (t = 0; t < {size}; t++) {{
        out[t] = 0.0;
        for (k = 0; k < LANES; k++)
            out[t] += ((const real *)(sums + t))[k];
    }}
}}
"""
