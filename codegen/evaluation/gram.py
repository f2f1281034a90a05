"""Sums over rows of w [J r]'[J r], without ever keeping the rows: normal equations of any number of rows.

Use ``GramFunction`` where residual r (m,) and Jacobian J (m, n) are explicit expressions and only their sums are
wanted. It squares the condition number: what decides about rank or null space needs ``leastsquares.triangular``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index
from truepose.codegen.evaluation.batch import BatchFunction, loads
from truepose.codegen.evaluation.compiled import load
from truepose.codegen.evaluation.compiler import NotCompiledError
from truepose.codegen.evaluation.engine import Engine, engine_for, without_compiler
from truepose.codegen.evaluation.rowinputs import RowInputs, pointers, rows_of, scratch
from truepose.codegen.evaluation.rowwise import RowWise, rowwise

CHUNK = 16384
"""Rows that are summed before they are added to the rest: rounding grows with the root of the chunks."""
SIDE = 4
"""Columns of a tile: 16 sums of products stay in registers."""
GROUP = 4
"""Vectors of rows between two visits to a tile's sums."""


@dataclass(frozen=True)
class Gram:
    """matrix (n + 1, n + 1): the sum over rows of w [J r]'[J r]."""

    matrix: Array

    @property
    def information(self) -> Array:
        """(n, n) sum of w J'J."""
        return self.matrix[:-1, :-1]

    @property
    def gradient(self) -> Array:
        """(n,) sum of w J'r."""
        return self.matrix[:-1, -1]

    @property
    def square(self) -> float:
        """Sum of w r'r."""
        return float(self.matrix[-1, -1])


class GramFunction:
    """The Gram matrix of [J r] over rows; ``rows`` and ``engine`` as of a BatchFunction."""

    def __init__(
        self, name: str, inputs: Sequence[ca.SX], residual: ca.SX, jacobian: ca.SX, *, rows: int = 0
    ) -> None:
        self._inputs, self._columns = list(inputs), ca.horzcat(jacobian, residual)
        self._sizes = [int(item.numel()) for item in inputs]
        self._rows = BatchFunction(name, inputs, [self._columns])
        self._engine = engine_for(rows, self._rows.instructions)
        self._compiled: dict[RowInputs, _Compiled] = {}

    @property
    def engine(self) -> Engine:
        """What evaluates; whether C can be compiled shows at the first call."""
        return self._engine

    def __call__(self, *inputs: Array, weight: Array | None = None) -> Gram:
        """Sums over n rows of inputs (n, size), or (size,) where all rows share one; ``weight`` (n,) is not negative.

        A row of weight 0 counts nothing, whatever is in it.
        """
        rows, size = rows_of(inputs), self._columns.shape[1]
        given = RowInputs.of(self._sizes, inputs)
        compiled = self._library(given) if self._engine.compiled else None
        evaluate = compiled or self._by_rows
        total = np.zeros((size, size))
        for start in range(0, rows, CHUNK):
            part = slice(start, start + CHUNK)
            some = [a if s or len(a) != rows else a[part] for a, s in zip(inputs, given.shared, strict=True)]
            total += evaluate(some, None if weight is None else weight[part], min(CHUNK, rows - start))
        return Gram(total)

    def _library(self, given: RowInputs) -> _Compiled | None:
        if given not in self._compiled:
            try:
                self._compiled[given] = _Compiled(given, self._inputs, self._columns)
            except (NotCompiledError, NotImplementedError, ValueError) as exc:
                self._engine = without_compiler(str(exc))
                return None
        return self._compiled[given]

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
        self._given, self._tiles = given, _Tiles.of(columns)
        ordered = ca.densify(columns[:, self._tiles.order])
        code = rowwise(*given.symbols(inputs), [ordered], ("load",))
        self._length = self._tiles.blocks * SIDE * max(columns.shape[0], 1)
        self._lanes = code.x + code.w + GROUP * self._length + len(self._tiles.places) * SIDE**2
        self._reals = code.u
        source = code.text + _driver(code, given.widths, self._tiles, columns.shape[0], self._length)
        self._sum = load(source, ["sum_up"], fused=True).sum_up
        self._sum.argtypes = [ctypes.c_longlong, *[ctypes.c_void_p] * 5]
        self._sum.restype = None

    def __call__(self, inputs: Sequence[Array], weight: Array | None, rows: int) -> Array:
        own, p = self._given.own(inputs, rows), self._given.common(inputs)
        work, sums = scratch(self._lanes, self._reals), np.zeros((len(self._tiles.places), SIDE, SIDE))
        root = None if weight is None else np.sqrt(weight)
        at = None if root is None else root.ctypes.data
        self._sum(rows, pointers(own), p.ctypes.data, at, work.ctypes.data, sums.ctypes.data)
        return self._tiles.matrix(sums)


@dataclass(frozen=True)
class _Tiles:
    """How [J r] is cut: columns in ``order``, in ``blocks`` of SIDE, and pairs of blocks that meet.

    places: two blocks, the first of the residuals in which both can differ from zero, and the last plus one.
    """

    order: list[int]
    blocks: int
    places: list[tuple[int, int, int, int]]

    @classmethod
    def of(cls, columns: ca.SX) -> _Tiles:
        """Columns that act on the same residuals stand together: many act on positions alone."""
        pattern = np.array(ca.DM(columns.sparsity(), 1.0).full()) != 0
        spans = [
            (int(np.argmax(c)), len(c) - int(np.argmax(c[::-1]))) if c.any() else (0, 0) for c in pattern.T
        ]
        order = sorted(range(len(spans)), key=lambda k: (spans[k], k))
        blocks = -(-len(order) // SIDE)
        groups = [[spans[k] for k in order[SIDE * b : SIDE * (b + 1)]] for b in range(blocks)]
        hulls = [(min(s[0] for s in group), max(s[1] for s in group)) for group in groups]
        places = [
            (i, j, max(hulls[i][0], hulls[j][0]), min(hulls[i][1], hulls[j][1]))
            for i in range(blocks)
            for j in range(i, blocks)
        ]
        return cls(order, blocks, [place for place in places if place[2] < place[3]])

    @cached_property
    def _entries(self) -> tuple[Index, Index, Index]:
        """Of the upper triangle's sums (flat): which they are, and the two columns."""
        entries = [
            ((SIDE * k + a) * SIDE + b, SIDE * i + a, SIDE * j + b)
            for k, (i, j, _, _) in enumerate(self.places)
            for a, b in product(range(SIDE), repeat=2)
            if SIDE * i + a <= SIDE * j + b < len(self.order)
        ]
        at, first, second = np.array(entries, dtype=np.intp).reshape(-1, 3).T
        order = np.array(self.order, dtype=np.intp)
        return at, order[first], order[second]

    def matrix(self, sums: Array) -> Array:
        """The symmetric matrix of the sums (tiles, SIDE, SIDE), columns as they were."""
        at, first, second = self._entries
        out = np.zeros((len(self.order), len(self.order)))
        out[first, second] = out[second, first] = sums.ravel()[at]
        return out


def _driver(code: RowWise, inputs: Sequence[int], tiles: _Tiles, m: int, length: int) -> str:
    """Columns of GROUP vectors of rows stand in ``y``; each tile then visits them all."""
    kinds = sorted({(i == j, first, last) for i, j, first, last in tiles.places})
    calls = "".join(
        f"    {_name(i == j, first, last)}(y + {SIDE * m * i}, y + {SIDE * m * j}, groups, sums + {SIDE**2 * t});\n"
        for t, (i, j, first, last) in enumerate(tiles.places)
    )
    text = "".join(_tile(kind, m, length) for kind in kinds)
    text += f"\nstatic void add(const lanes *y, int groups, lanes *sums)\n{{\n{calls}}}\n"
    return text + _sum_up(code, loads(inputs), length, SIDE**2 * len(tiles.places))


def _sum_up(code: RowWise, reading: str, length: int, size: int) -> str:
    """The loop over rows: evaluate, weigh, add; the lanes of each of ``size`` sums are added up in the end, in order."""
    return f"""{_weigh(code.y)}
void sum_up(long long n, const real *const *in, const real *p, const real *weight, real *work, real *out);

void sum_up(long long n, const real *const *in, const real *p, const real *weight, real *work, real *out)
{{
    lanes *x = (lanes *)work, *w = x + {code.x}, *y = w + {code.w}, *sums = y + {GROUP * length};
    real *u = (real *)(sums + {size});
    long long row;
    int g, k, t;
    before(p, u);
    for (k = 0; k < {GROUP * length + size}; k++)
        y[k] = LANES_OF(0.0);
    for (row = 0, g = 0; row < n; row += LANES) {{
        const int count = n - row < LANES ? (int)(n - row) : LANES;
{reading}        rows(x, p, u, w, y + g * {length});
        if (weight || count < LANES) {{
            lanes root = LANES_OF(0.0);
            for (k = 0; k < count; k++)
                ((real *)&root)[k] = weight ? weight[row + k] : 1.0;
            weigh(y + g * {length}, &root);
        }}
        if (++g == {GROUP} || row + LANES >= n) {{
            add(y, g, sums);
            g = 0;
        }}
    }}
    for (t = 0; t < {size}; t++) {{
        out[t] = 0.0;
        for (k = 0; k < LANES; k++)
            out[t] += ((const real *)(sums + t))[k];
    }}
}}
"""


def _weigh(size: int) -> str:
    """Rows of ``size`` numbers, weighted."""
    return f"""
/* Rows scaled by the root of their weight; what counts nothing is zero whatever it was. */
static void weigh(lanes *y, const lanes *root)
{{
    int k;
    for (k = 0; k < {size}; k++)
        y[k] = LANES_KEEP(*root != LANES_OF(0.0), y[k] * *root);
}}
"""


def _name(corner: bool, first: int, last: int) -> str:
    return f"{'corner' if corner else 'tile'}_{first}_{last}"


def _tile(kind: tuple[bool, int, int], m: int, length: int) -> str:
    """Products of the columns of two blocks (of one at a corner) are added to sums that stay in registers meanwhile."""
    corner, first, last = kind
    pairs = [(i, j) for i in range(SIDE) for j in range(i if corner else 0, SIDE)]
    begin = "".join(f"    lanes s{i}{j} = s[{SIDE * i + j}];\n" for i, j in pairs)
    add = ""
    for k in range(first, last):
        read = [f"a{i} = a[{i * m + k}]" for i in range(SIDE)]
        read += [] if corner else [f"b{i} = b[{i * m + k}]" for i in range(SIDE)]
        sums = "".join(f"            s{i}{j} += a{i} * {'a' if corner else 'b'}{j};\n" for i, j in pairs)
        add += f"        {{\n            const lanes {', '.join(read)};\n{sums}        }}\n"
    end = "".join(f"    s[{SIDE * i + j}] = s{i}{j};\n" for i, j in pairs)
    return f"""
static __attribute__((noinline)) void {_name(*kind)}(const lanes *a, const lanes *b, int groups, lanes *s)
{{
    int g;
{begin}    for (g = 0; g < groups; g++, a += {length}, b += {length}) {{
{add}    }}
{end}}}
"""
