"""The machine's C functions, printed from its symbolic model: static functions over ``model *m``.

An open chain gets the functions of ``chain``; a closed one the pose, what its loops lack to close, and the
derivative of both. What depends on parameters and drivers alone is computed once and kept in ``m->k``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from typing import Any

import casadi as ca

from truepose.codegen.chain import FIRST, STEP, ChainExpressions
from truepose.codegen.expressions import Graph
from truepose.codegen.features import ALL, Features
from truepose.codegen.lanes import LanePrinter, lane_runtime
from truepose.codegen.layout import Layout
from truepose.codegen.loop_blocks import ROOTS, Arrays, Loops, write_loops, write_turns
from truepose.codegen.memory import SLOWEST, memory_of
from truepose.codegen.printer import Printer, Real
from truepose.codegen.texts import identifiers
from truepose.models.file.driver import TREMBLING
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.velocities import chain_of

_LOCALS = {"p": "const real *p = m->p;", "z": "const real *z = m->z;", "k": "const real *k = m->k;"}


def function_text(
    title: str, name: str, arguments: str, statements: Sequence[str], *, lines: bool = False
) -> str:
    """A static C function; arguments that the statements do not read are marked so."""
    body = "\n".join(statements)
    used = set(re.findall(r"(?<!>)\b([a-zA-Z]\w*)(?=\[|->)", body)) | set(re.findall(r"\bj\b", body))
    named = [re.split(r"\W", argument)[-1] for argument in arguments.split(",")]
    head = [text for local, text in _LOCALS.items() if local in used and local not in named]
    head += [
        f"(void){argument};" for argument in named if argument not in used and not (argument == "m" and head)
    ]
    if lines:
        statements = ["EACH_LINE(j) {", *(f"    {statement}" for statement in statements), "}"]
    indented = "\n".join(f"    {line}" for line in [*head, *statements])
    keyword = "LINE_FUNCTION" if lines else "static"
    return f"/* {title} */\n{keyword} void {name}({arguments})\n{{\n{indented}\n}}\n"


_PLACE = re.compile(r"\bp\[(\d+)\]")
_STEP = re.compile(r"\bk \+ (\d+)")


def rolled(blocks: Sequence[Sequence[str]]) -> list[str]:
    """Lines of the blocks, one after the other; neighbours that are alike become a loop.

    Alike are blocks that read other entries of p, each as far from its first one, and fill k + N, N being evenly spaced.
    """
    out: list[str] = []
    for group in (list(alike) for _, alike in groupby(blocks, key=_form)):
        out += _loop(group) if len(group) > 1 else group[0]
    return out


def _first(block: Sequence[str]) -> int:
    return min((int(place) for line in block for place in _PLACE.findall(line)), default=0)


def _filled(block: Sequence[str]) -> int:
    return next(int(place) for line in block for place in _STEP.findall(line))


def _form(block: Sequence[str]) -> tuple[str, ...]:
    """The block by places beside its first one."""
    first = _first(block)
    beside = [_PLACE.sub(lambda found: f"a[{int(found.group(1)) - first}]", line) for line in block]
    return tuple(_STEP.sub("k + N", line) for line in beside)


def _loop(group: Sequence[Sequence[str]]) -> list[str]:
    firsts = [_first(block) for block in group]
    start, step = _filled(group[0]), _filled(group[1]) - _filled(group[0])
    inside = [line.replace("k + N", f"k + {start} + {step} * i") for line in _form(group[0])[1:-1]]
    count, reads = len(group), any("a[" in line for line in inside)
    table = f"    static const unsigned short first[{count}] = {{ {', '.join(map(str, firsts))} }};"
    return [
        "{",
        *([table] if reads else []),
        "    int i;",
        f"    for (i = 0; i < {count}; ++i) {{",
        *(["        const real *a = p + first[i];"] if reads else []),
        *(f"    {line}" for line in inside),
        "    }",
        "}",
    ]


_Targets = list[tuple[str, int]]
_EVALUATION = ("moves_of", "chain_line", "mix", "all_of")
_OWN = {"ATAN2": "arctan"}
_NO_TILT = (8, 9)
"""Entries of a frame that a tilt is not computed from."""
_PADDED = 4
"""Places of a line's entry in what is kept: of three lines, and a fourth one of zeros that may fill a vector."""


@dataclass(frozen=True)
class Blocks:
    """Texts of the functions, and what of them is kept.

    ``chain`` is None where loops have to be closed; ``moves`` are the kinds of its moves, True for a turn.
    ``loops`` is None for an open chain. ``lane_texts`` are the functions of a chain of six readings, or of legs in
    closed form, for several rows at once, after what they need. ``operations`` are those of one evaluation with its
    derivative.
    """

    texts: tuple[str, ...]
    lane_texts: tuple[str, ...]
    chain: ChainExpressions | None
    loops: Loops | None
    operations: int
    _graph: Graph
    _kept: tuple[int, ...]
    _settled: tuple[int, ...] = ()

    def settled(self, p: Sequence[float]) -> list[float]:
        """Where p is built in, values of it alone that those are computed from which depend on z; rounded likewise."""
        values = self._graph.evaluate(self._settled, {"p": p})
        return [float(f"{value:.15g}") for value in values] or [0.0]

    def kept(self, p: Sequence[float], z: Sequence[float]) -> list[float]:
        """Values of what is kept; rounded, so that the last digit of a mathematical library is not seen."""
        values = self._graph.evaluate(self._kept, {"p": p, "z": z})
        return [float(f"{value:.15g}") for value in values] or [0.0]

    @property
    def moves(self) -> tuple[bool, ...]:
        """Whether each move of the chain is a turn."""
        return tuple(move.turn for move in self.chain.chain.moves) if self.chain else ()


@dataclass(frozen=True)
class _Planned:
    """A function to print: ``lines``, once for every line of a pose, ``given`` being read where it says.

    ``reads`` and ``fills`` are the names of its arrays.
    """

    title: str
    name: str
    reads: tuple[str, ...]
    fills: tuple[str, ...]
    targets: _Targets
    given: Mapping[int, str]
    lines: bool

    def arguments(self, number: str = "real") -> str:
        """Its arguments in C, the arrays being of the type ``number``."""
        star = "*restrict " if self.lines else "*"
        arrays = [f"const {number} {star}{name}" for name in self.reads]
        arrays += [f"{number} {star}{name}" for name in self.fills]
        return ", ".join(["const model *m", *(["int j"] if self.lines else []), *arrays])


@dataclass
class _Writer:
    """Collects functions over one graph; they are printed together, when it is known what is kept."""

    real: Real
    features: Features = ALL
    graph: Graph = field(default_factory=lambda: Graph(fixed=("p", "z")))
    planned: list[_Planned] = field(default_factory=list)
    first: list[int] = field(default_factory=list)
    """Nodes that are kept in the first places, in this order."""
    own: list[int] = field(default_factory=list)
    """Of a chain in steps, its moves' own offsets."""
    frames: list[list[int]] = field(default_factory=list)
    """And the frames that become tilts, line after line."""

    def nodes(self, inputs: Mapping[str, ca.SX], expression: ca.SX) -> list[int]:
        """Nodes of an expression's entries."""
        return self.graph.add(inputs, [expression])[0]

    def function(
        self,
        title: str,
        name: str,
        arrays: Arrays,
        targets: _Targets,
        *,
        given: Mapping[int, str] | None = None,
        lines: bool = False,
    ) -> None:
        """A static function of the model that fills the targets; ``arrays`` are those it reads and those it fills."""
        self.planned.append(_Planned(title, name, *arrays, targets, given or {}, lines))

    @cached_property
    def kept(self) -> list[int]:
        """Nodes that are kept, in order; nothing may be planned after it is known."""
        read = self.graph.kept(node for plan in self.planned for _, node in plan.targets)
        return [*self.first, *read]

    @property
    def _places(self) -> dict[int, str]:
        return {node: f"k[{k}]" for k, node in enumerate(self.kept) if k >= len(self.first)}

    def texts(self) -> list[str]:
        """The functions, that of kept values first."""
        fill = self._fill() if self.features.p else self._fill_by_drivers()
        return [fill, *(self._text(plan) for plan in self.planned)]

    def _fill(self) -> str:
        title = "Values that depend on p and z alone."
        lines, apart = self._tilts()
        rest = [(f"k[{k}]", node) for k, node in enumerate(self.kept) if k not in apart]
        lines += Printer(self.graph, self.real, own=_OWN).statements(rest)
        return function_text(title, "fixed_of", "const real *p, const real *z, real *k", lines)

    @cached_property
    def _by_drivers(self) -> list[tuple[str, int]]:
        """Kept values that depend on z, with their places."""
        moving = self.graph.reading("z")
        return [(f"k[{k}]", node) for k, node in enumerate(self.kept) if node in moving]

    @cached_property
    def settled(self) -> list[int]:
        """Nodes of p alone that these are computed from."""
        return self.graph.settled((node for _, node in self._by_drivers), self.graph.reading("z"))

    def _fill_by_drivers(self) -> str:
        title = "Those of the kept values that depend on z; c: what depends on p alone in them."
        given = {node: f"c[{k}]" for k, node in enumerate(self.settled)}
        lines = Printer(self.graph, self.real, given, _OWN).statements(self._by_drivers)
        return function_text(title, "fixed_of", "const real *p, const real *z, const real *c, real *k", lines)

    def _tilts(self) -> tuple[list[str], set[int]]:
        """Statements that compute the steps of a chain frame by frame, and the places that they fill."""
        if not self.frames:
            return [], set()
        offsets = [(f"k[{FIRST + STEP * i}]", node) for i, node in enumerate(self.own)]
        lines = self._block(offsets)
        blocks = []
        for i, frame in enumerate(self.frames, start=1):
            entries = [(f"F[{k}]", node) for k, node in enumerate(frame) if k not in _NO_TILT]
            blocks.append(self._block(entries, "real F[12];", f"tilt_of(F, k + {FIRST + STEP * i});"))
        lines += rolled(blocks) if self.features.listed else [line for block in blocks for line in block]
        behind = range(FIRST + STEP, FIRST + STEP * len(self.own))
        return lines, {FIRST, *behind}

    def _block(self, targets: _Targets, before: str = "", behind: str = "") -> list[str]:
        """Statements in a scope of their own."""
        inside = Printer(self.graph, self.real, own=_OWN).statements(targets)
        return ["{", *(f"    {line}" for line in (before, *inside, behind) if line), "}"]

    def operations(self) -> int:
        """Operations of one evaluation with its derivative; three lines of a pose count three times."""
        count = 0
        for plan in self.planned:
            if plan.name in _EVALUATION:
                given = {**self._places, **plan.given}
                nodes = self.graph.reachable((node for _, node in plan.targets), given)
                own = sum(1 for node in nodes if node not in given and self.graph.nodes[node].args)
                count += own * (3 if plan.lines else 1)
        return count

    def _text(self, plan: _Planned) -> str:
        statements = Printer(self.graph, self.real, {**self._places, **plan.given}, _OWN).statements(
            plan.targets
        )
        return function_text(plan.title, plan.name, plan.arguments(), statements, lines=plan.lines)

    def lane_texts(self, planned: Iterable[_Planned], needed: Iterable[str]) -> list[str]:
        """What they need, ``needed`` included, and the functions for several rows at once: all but the model is a row's own."""
        texts, helpers = [], set(needed)
        for plan in planned:
            printer = LanePrinter(
                self.graph, self.real, ("p", "z", "k", "start"), {**self._places, **plan.given}
            )
            statements = printer.statements(plan.targets)
            name = plan.name if plan.name == ROOTS else f"lanes_{plan.name}"  # a file may hold both
            texts.append(function_text(plan.title, name, plan.arguments("lanes"), statements))
            helpers |= printer.helpers
        return [lane_runtime(self.real, helpers), *texts]


def blocks_of(model: SymbolicModel, layout: Layout, real: Real, features: Features = ALL) -> Blocks:
    """C functions of the model."""
    chain = chain_of(model)
    writer = _Writer(real, features)
    expressions = ChainExpressions.of(model, chain, layout.task) if chain else None
    loops = None if expressions else Loops.of(model, layout, real)
    if expressions:
        _write_chain(writer, model, expressions)
    if loops:
        write_loops(writer, model, loops)
    if not layout.task.is_whole and layout.task.about:
        write_turns(writer, layout.task)
    by_lanes = [plan for plan in writer.planned if plan.name == ROOTS or (expressions and expressions.six)]
    lanes = writer.lane_texts(by_lanes, () if loops else ("load", "store", "sincos")) if by_lanes else []
    texts, operations = tuple(writer.texts()), writer.operations()
    settled = () if features.p else tuple(writer.settled)
    return Blocks(
        texts, tuple(lanes), expressions, loops, operations, writer.graph, tuple(writer.kept), settled
    )


_Nodes = Callable[[ca.SX, Mapping[str, ca.SX]], list[int]]


def _write_lines(writer: _Writer, nodes: _Nodes, chain: ChainExpressions) -> None:
    """The functions that are run once for every line of a pose."""
    inputs = {"k": chain.kept, "start": chain.start, "s": chain.s, "c": chain.c}
    first = {node: f"k[{_PADDED * k} + j]" for k, node in enumerate(nodes(chain.start, inputs))}
    writer.first = nodes(ca.vec(ca.vertcat(chain.first, ca.SX.zeros(1, 4))), {}) + nodes(chain.steps, {})
    if chain.six and writer.features.p:
        writer.own = nodes(chain.own, {})
        writer.frames = [nodes(ca.vec(frame.T), {}) for frame in chain.frames]

    def lines(name: str, expression: ca.SX) -> _Targets:
        return [(f"{name}[{k} * LINES + j]", node) for k, node in enumerate(nodes(expression, inputs))]

    title = "Line j of the chain's pose, by sines (or lengths) and cosines of the moves"
    if chain.six:
        writer.function(
            f"{title}.", "end_line", (("s", "c"), ("C",)), lines("C", chain.line), given=first, lines=True
        )
    every = lines("C", chain.line) + lines("A", chain.axes)
    title = f"{title}; and of the axis and origin of every move."
    writer.function(title, "chain_line", (("s", "c"), ("C", "A")), every, given=first, lines=True)


def _of_column(k: int) -> str:
    """Place of number k of a column after column, 6 numbers each."""
    column, line = divmod(k, 6)
    return f"{column} * SIDE6 + {line // 3} * LINES + {line % 3}"


def _write_chain(writer: _Writer, model: SymbolicModel, chain: ChainExpressions) -> None:
    fixed = {"p": model.p, "z": model.z}

    def nodes(expression: ca.SX, inputs: Mapping[str, ca.SX]) -> list[int]:
        return writer.nodes({**fixed, **inputs}, expression)

    q = {"q": model.q, "k": chain.kept}
    moves = [(f"v[{k}]", node) for k, node in enumerate(nodes(chain.moves, q))]
    writer.function("Angles and lengths of the moves.", "moves_of", (("q",), ("v",)), moves)
    _write_lines(writer, nodes, chain)
    if chain.mixed is not None:
        mixed = nodes(chain.mixed, {**q, "A": chain.columns})
        leaves = nodes(chain.columns, {"A": chain.columns})
        writer.function(
            "Columns by the readings from columns by the moves.",
            "mix",
            (("q", "A"), ("J",)),
            [(f"J[{_of_column(k)}]", node) for k, node in enumerate(mixed)],
            given={node: f"A[{_of_column(k)}]" for k, node in enumerate(leaves)},
        )


def offered(
    features: Features, model: SymbolicModel, layout: Layout, blocks: Blocks, ideal: list[float]
) -> dict[str, Any]:
    """What the templates read of features, of what is remembered, and the tables of built-in parameters."""
    return {
        "has": features,
        "rare": "RARE" if features.listed else "APART",
        "reads_p": any(re.search(r"\bp\b", text) for text in blocks.texts[1:]) or "p[" in blocks.texts[0],
        "settled": [] if features.p else blocks.settled(model.p_home.tolist()),
        "drawn_settled": [] if features.p else blocks.settled(ideal),
        **_memory(model, layout, features),
    }


def _memory(model: SymbolicModel, layout: Layout, features: Features) -> dict[str, Any]:
    """What the templates of ``NAME_state`` read: where drivers remember, or where it was asked for."""
    memory = memory_of(model, layout)
    if not features.state or not (memory.remembers or features.listed):
        return {"memory": None}
    rows = zip(model.drivers, driver_units(model), memory.places, strict=True)
    followed = [(name, unit) for name, unit, place in rows if place >= len(memory.sensed)]
    return {
        "memory": memory,
        "trembling": TREMBLING,
        "slowest": SLOWEST,
        "followed": entries([n for n, _ in followed], [unit for _, unit in followed]),
        "sensed": entries([n for n, _, _ in memory.sensed], [unit for _, unit, _ in memory.sensed]),
        "fields": [field for field in memory.fields if field.size],
    }


def entries(names: Sequence[str], units: Sequence[str]) -> list[dict[str, str]]:
    """Names with identifiers and units, for lists of places."""
    rows = zip(names, identifiers(names), units, strict=True)
    return [{"name": name, "identifier": identifier, "unit": unit} for name, identifier, unit in rows]


def driver_units(model: SymbolicModel) -> list[str]:
    """Units of a model's drivers, "1" where nobody knows."""
    return [model.machine.driver_unit(name) or "1" for name in model.drivers]
