"""Evaluate a CasADi function over many rows at once, compiled where that pays, without copying through DM.

Use ``BatchFunction`` where the same expressions are needed for every row of a recording: inputs are
(n, size) arrays (or one (size,) vector shared by all rows), outputs (n, rows, columns) arrays. Where only sums over
rows are wanted, ``truepose.codegen.evaluation.gram`` does without the arrays.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.evaluation.compiled import load
from truepose.codegen.evaluation.compiler import NotCompiledError
from truepose.codegen.evaluation.engine import Engine, engine_for, without_compiler
from truepose.codegen.evaluation.rowinputs import RowInputs, pointers, rows_of, scratch
from truepose.codegen.evaluation.rowwise import RowWise, rowwise
from truepose.threads import all_done

CHUNK = 64
ALONE = 2048
"""Rows up to which one thread evaluates them: who has many calls of fewer shares these out among threads."""


class BatchFunction:
    """Dense SX outputs of SX vector inputs, mapped over rows.

    ``rows``: how many rows will be evaluated in all calls together. If they are few or their number is unknown (0), or
    if there is no C compiler, CasADi's virtual machine evaluates; ``engine`` says which. Threads may call it at once.
    """

    def __init__(
        self, name: str, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX], *, rows: int = 0
    ) -> None:
        self._inputs, self._outputs = list(inputs), [ca.densify(output) for output in outputs]
        self._function = ca.Function(name, self._inputs, self._outputs, {"allow_free": False})
        self._shapes = [output.shape for output in self._outputs]
        self._sizes = [int(item.numel()) for item in inputs]
        self._machine = _VirtualMachine(self._function)
        self._compiled: dict[RowInputs, _Compiled] = {}
        self._compiling = Lock()
        self._engine = engine_for(rows, self.instructions)

    @property
    def instructions(self) -> int:
        """Scalar operations of one row."""
        return int(self._function.n_instructions())

    @property
    def engine(self) -> Engine:
        """What evaluates; whether C can be compiled shows at the first call."""
        return self._engine

    def __call__(self, *inputs: Array) -> tuple[Array, ...]:
        """Outputs (n, rows, columns) of inputs (n, size), or (size,) where all rows share one."""
        rows = rows_of(inputs)
        results = tuple(np.empty((rows, columns, height)) for height, columns in self._shapes)
        compiled = self._library(RowInputs.of(self._sizes, inputs)) if self._engine.compiled else None
        if compiled is not None:
            compiled(inputs, results, rows)
        else:
            every = RowInputs(tuple(self._sizes), (False,) * len(self._sizes))
            self._machine(every.own(inputs, rows), results)
        return tuple(result.transpose(0, 2, 1) for result in results)

    def _library(self, given: RowInputs) -> _Compiled | None:
        """C for inputs that come so, compiled at the first call; None where there is none."""
        with self._compiling:
            if given not in self._compiled:
                try:
                    self._compiled[given] = _Compiled(given, self._inputs, self._outputs)
                except (NotCompiledError, NotImplementedError, ValueError) as exc:
                    self._engine = without_compiler(str(exc))
                    return None
            return self._compiled[given]


class _VirtualMachine:
    """CasADi's own evaluation, some rows at a time."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._mapped: dict[int, ca.Function] = {}

    def __call__(self, inputs: Sequence[Array], outputs: Sequence[Array]) -> None:
        rows = len(outputs[0]) if outputs else 0

        def chunk(start: int) -> None:
            part = slice(start, min(start + CHUNK, rows))
            self._evaluate([a[part] for a in inputs], [result[part] for result in outputs])

        if rows > ALONE:
            all_done(chunk, range(0, rows, CHUNK))
            return
        for start in range(0, rows, CHUNK):
            chunk(start)

    def _evaluate(self, inputs: Sequence[Array], outputs: Sequence[Array]) -> None:
        rows = len(outputs[0])
        if rows not in self._mapped:
            self._mapped[rows] = self._function if rows == 1 else self._function.map(rows)
        buffer: Any  # casadi's stubs misstate what it takes
        buffer, evaluate = self._mapped[rows].buffer()
        for k, item in enumerate(inputs):
            if item.size:
                buffer.set_arg(k, _memory(item))
        for k, item in enumerate(outputs):
            if item.size:
                buffer.set_res(k, _memory(item))
        evaluate()


class _Compiled:
    """The same as C, for inputs of which some are shared. Raises NotCompiledError, NotImplementedError, ValueError."""

    def __init__(self, given: RowInputs, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        self._given = given
        code = rowwise(*given.symbols(inputs), outputs, ("load", "store"))
        self._lanes, self._reals = code.x + code.w + code.y, code.u
        self._evaluate = load(
            code.text + _driver(code, given.widths, [int(a.numel()) for a in outputs]), ["evaluate"]
        ).evaluate
        self._evaluate.argtypes = [ctypes.c_longlong, *[ctypes.c_void_p] * 4]
        self._evaluate.restype = None

    def __call__(self, inputs: Sequence[Array], outputs: Sequence[Array], rows: int) -> None:
        own, p = self._given.own(inputs, rows), self._given.common(inputs)
        work = scratch(self._lanes, self._reals)
        self._evaluate(rows, pointers(own), p.ctypes.data, work.ctypes.data, pointers(outputs))


def _driver(code: RowWise, inputs: Sequence[int], outputs: Sequence[int]) -> str:
    """The loop over rows: ``in`` and ``out`` name arrays (rows, size), one behind the other."""
    return f"""
void evaluate(long long n, const real *const *in, const real *p, real *work, real *const *out);

void evaluate(long long n, const real *const *in, const real *p, real *work, real *const *out)
{{
    lanes *x = (lanes *)work, *w = x + {code.x}, *y = w + {code.w};
    real *u = (real *)(y + {code.y});
    long long row;
    before(p, u);
    for (row = 0; row < n; row += LANES) {{
        const int count = n - row < LANES ? (int)(n - row) : LANES;
{loads(inputs)}        rows(x, p, u, w, y);
{_stores(outputs)}    }}
}}
"""


def loads(sizes: Sequence[int]) -> str:
    """Lines that fill ``x`` with ``count`` rows from ``row`` on."""
    ends = np.cumsum([0, *sizes])
    return "".join(
        f"        lanes_load(in[{k}] + row * {size}, {size}, count, {size}, x + {at});\n"
        for k, (size, at) in enumerate(zip(sizes, ends, strict=False))
    )


def _stores(sizes: Sequence[int]) -> str:
    ends = np.cumsum([0, *sizes])
    return "".join(
        f"        lanes_store(y + {at}, {size}, {size}, count, out[{k}] + row * {size});\n"
        for k, (size, at) in enumerate(zip(sizes, ends, strict=False))
    )


def _memory(item: Array) -> memoryview[float]:
    return memoryview(item.data).cast("B").cast("d")
