"""Evaluate a CasADi function over many rows at once, compiled where that pays, without copying through DM.

Use ``BatchFunction`` where the same expressions are needed for every row of a recording: inputs are
(n, size) arrays (or one (size,) vector shared by all rows), outputs (n, rows, columns) arrays. Where only sums over
rows are wanted, ``truepose.codegen.evaluation.gram`` does without the arrays.

What evaluates a batch: compiled C where the work repays the compiler, else CasADi's virtual machine.

``Engine`` decides by the work alone, so that results depend neither on chunks nor on what is in a cache.

C that evaluates expressions for LANES rows at once, in functions short enough for a compiler.

What rows share is computed once, by ``before``; the rest by ``rows``, cut into parts of some hundred statements:
a compiler's time grows faster than a function's length. What one part leaves to a later one stands in ``w``.
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from threading import Lock
from typing import Any, Generic, TypeVar

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.evaluation.compiled import NotCompiledError, load
from truepose.codegen.expressions import Graph
from truepose.codegen.lanes import LanePrinter, Statement, lane_runtime
from truepose.threads import all_done

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


FEWEST_ROWS = 50_000
"""Compiling costs some 0.2 ms an operation, the virtual machine 4 ns an operation and row."""
LEAST_WORK = 2e7
"""Rows times operations that repay the start of a compiler, a tenth of a second."""


@cache
def log_once(why: str) -> None:
    """Tell that there is no C; once in a process for each reason."""
    logging.getLogger(__name__).warning(
        "%s: large recordings are evaluated by CasADi's virtual machine, more slowly", why
    )


WIDEST = 8
"""Most lanes of any processor: scratch is made for as many."""


@dataclass(frozen=True)
class RowInputs:
    """``sizes`` of the inputs; ``shared``: whether an input is one vector for all rows."""

    sizes: tuple[int, ...]
    shared: tuple[bool, ...]

    @classmethod
    def of(cls, sizes: Sequence[int], inputs: Sequence[Array]) -> RowInputs:
        """From the inputs of a call: an (n, size) array has a value for each row; a (size,) or empty one is shared."""
        pairs = zip(inputs, sizes, strict=True)
        return cls(tuple(sizes), tuple(np.ndim(a) < 2 or size == 0 for a, size in pairs))

    @property
    def widths(self) -> list[int]:
        """Sizes of the inputs that differ from row to row."""
        return [size for size, shared in zip(self.sizes, self.shared, strict=True) if not shared]

    def symbols(self, inputs: Sequence[ca.SX]) -> tuple[ca.SX, ca.SX]:
        """The inputs that differ from row to row in one column, and the shared ones in another."""
        x, p = ([a for a, s in zip(inputs, self.shared, strict=True) if s == kind] for kind in (False, True))
        return ca.vertcat(ca.SX(0, 1), *x), ca.vertcat(ca.SX(0, 1), *p)

    def own(self, inputs: Sequence[Array], rows: int) -> list[Array]:
        """The inputs that differ from row to row, each (rows, size), copied where C could not read them in place."""
        triples = zip(inputs, self.sizes, self.shared, strict=True)
        return [
            np.ascontiguousarray(
                a if np.shape(a) == (rows, size) else np.broadcast_to(a, (rows, size)), dtype=float
            )
            for a, size, shared in triples
            if not shared
        ]

    def common(self, inputs: Sequence[Array]) -> Array:
        """All shared inputs (size,) one behind the other in a vector (k,), then a zero: it is never empty."""
        triples = zip(inputs, self.sizes, self.shared, strict=True)
        parts = [
            np.broadcast_to(np.asarray(a, dtype=float), size)
            for a, size, shared in triples
            if shared and size
        ]
        return np.concatenate([*parts, np.zeros(1)])


Library = TypeVar("Library")


class Engine(Generic[Library]):
    """What evaluates: C, made at the first call where the work repays it, else CasADi's virtual machine.

    ``compiled``: whether C is asked for; ``missed``: why it cannot be had, where it would have been worth it.
    """

    def __init__(self, rows: int, instructions: int, make: Callable[[RowInputs], Library]) -> None:
        self.compiled = rows >= FEWEST_ROWS and rows * instructions >= LEAST_WORK
        self.missed = ""
        self._make, self._made = make, dict[RowInputs, Library]()
        self._making = Lock()

    def library(self, given: RowInputs) -> Library | None:
        """C for inputs that come so; None where there is none. Threads may ask at once."""
        with self._making:
            if self.compiled and given not in self._made:
                try:
                    self._made[given] = self._make(given)
                except (NotCompiledError, NotImplementedError, ValueError) as exc:
                    self.compiled, self.missed = False, str(exc)
                    log_once(self.missed)
            return self._made[given] if self.compiled else None


def rows_of(inputs: Sequence[Array]) -> int:
    """Number of rows of the first input (n, size); 1 where all inputs are shared (size,)."""
    return next((len(a) for a in inputs if np.ndim(a) == 2), 1)


def pointers(arrays: Sequence[Array]) -> ctypes.Array[ctypes.c_void_p]:
    """Addresses of the first entries of arrays of any shape, as C takes them."""
    return (ctypes.c_void_p * max(len(arrays), 1))(*(a.ctypes.data for a in arrays))


def scratch(lanes: int, reals: int = 0) -> Array:
    """(k,) uninitialised reals, aligned for the widest vectors: room for ``lanes`` of them and ``reals`` more."""
    raw = np.empty(WIDEST * (lanes + 1) + reals)
    first = (-raw.ctypes.data % (8 * WIDEST)) // 8
    return raw[first:]


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
        self.engine = Engine(
            rows, self.instructions, lambda given: _Compiled(given, self._inputs, self._outputs)
        )

    @property
    def instructions(self) -> int:
        """Scalar operations of one row."""
        return int(self._function.n_instructions())

    def __call__(self, *inputs: Array) -> tuple[Array, ...]:
        """Outputs (n, rows, columns) of inputs (n, size), or (size,) where all rows share one."""
        rows = rows_of(inputs)
        results = tuple(np.empty((rows, columns, height)) for height, columns in self._shapes)
        compiled = self.engine.library(RowInputs.of(self._sizes, inputs))
        if compiled is not None:
            compiled(inputs, results, rows)
        else:
            every = RowInputs(tuple(self._sizes), (False,) * len(self._sizes))
            self._machine(every.own(inputs, rows), results)
        return tuple(result.transpose(0, 2, 1) for result in results)


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
