"""The machine's C functions, printed from its symbolic model: static functions over ``model *m``.

An open chain gets the functions of ``chain``; a closed one the pose, what its loops lack to close, and the
derivative of both. What depends on parameters and drivers alone is computed once and kept in ``m->k``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from truepose.codegen.chain import ChainExpressions
from truepose.codegen.expressions import Graph
from truepose.codegen.printer import Printer, Real
from truepose.codegen.reference import strain_of
from truepose.models import lie
from truepose.models.chain import chain_of
from truepose.models.kinematics import SymbolicModel

_LOCALS = {"p": "const real *p = m->p;", "z": "const real *z = m->z;", "k": "const real *k = m->k;"}
_Targets = list[tuple[str, int]]
_PADDED = 4
"""Places of a line's entry in what is kept: of three lines, and a fourth one of zeros that may fill a vector."""


@dataclass(frozen=True)
class Blocks:
    """Texts of the functions, and what of them is kept.

    ``chain`` is None where loops have to be closed; ``moves`` are the kinds of its moves, True for a turn.
    """

    texts: tuple[str, ...]
    chain: ChainExpressions | None
    _graph: Graph
    _kept: tuple[int, ...]

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
    """A function to print: ``lines``, once for every line of a pose, ``given`` being read where it says."""

    title: str
    name: str
    arguments: str
    targets: _Targets
    given: Mapping[int, str]
    lines: bool


@dataclass
class _Writer:
    """Collects functions over one graph; they are printed together, when it is known what is kept."""

    real: Real
    graph: Graph = field(default_factory=lambda: Graph(fixed=("p", "z")))
    planned: list[_Planned] = field(default_factory=list)
    first: list[int] = field(default_factory=list)
    """Nodes that are kept in the first places, in this order."""

    def nodes(self, inputs: Mapping[str, ca.SX], expression: ca.SX) -> list[int]:
        """Nodes of an expression's entries."""
        return self.graph.add(inputs, [expression])[0]

    def function(
        self,
        title: str,
        name: str,
        arguments: str,
        targets: _Targets,
        *,
        given: Mapping[int, str] | None = None,
        lines: bool = False,
    ) -> None:
        """A static function of the model that fills the targets."""
        self.planned.append(
            _Planned(title, name, f"const model *m, {arguments}", targets, given or {}, lines)
        )

    def texts(self) -> tuple[list[str], list[int]]:
        """The functions, that of kept values first, and the nodes that are kept."""
        kept = self.graph.kept(node for plan in self.planned for _, node in plan.targets)
        places = {node: f"k[{k}]" for k, node in enumerate(kept, len(self.first))}
        kept = [*self.first, *kept]
        own = Printer(self.graph, self.real).statements([(f"k[{k}]", node) for k, node in enumerate(kept)])
        title = "Values that depend on p and z alone."
        fill = _function(title, "fixed_of", "const real *p, const real *z, real *k", own)
        return [fill, *(self._text(plan, places) for plan in self.planned)], kept

    def _text(self, plan: _Planned, places: Mapping[int, str]) -> str:
        statements = Printer(self.graph, self.real, {**places, **plan.given}).statements(plan.targets)
        return _function(plan.title, plan.name, plan.arguments, statements, lines=plan.lines)


def blocks_of(model: SymbolicModel, real: Real) -> Blocks:
    """C functions of the model."""
    chain = chain_of(model)
    writer = _Writer(real)
    expressions = ChainExpressions.of(model, chain) if chain else None
    if expressions:
        _write_chain(writer, model, expressions)
    else:
        _write_loops(writer, model)
    texts, kept = writer.texts()
    return Blocks(tuple(texts), expressions, writer.graph, tuple(kept))


_Entries = Callable[[str, Mapping[str, ca.SX], ca.SX], _Targets]


def _write_lines(writer: _Writer, entries: _Entries, chain: ChainExpressions) -> None:
    """The functions that are run once for every line of a pose."""
    inputs = {"": chain.start, "s": chain.s, "c": chain.c}
    first = {node: f"k[{_PADDED * k} + j]" for k, (_, node) in enumerate(entries("", inputs, chain.start))}
    writer.first = [node for _, node in entries("", {}, ca.vec(ca.vertcat(chain.first, ca.SX.zeros(1, 4))))]

    def lines(name: str, expression: ca.SX) -> _Targets:
        return [
            (place.replace("]", " * LINES + j]"), node) for place, node in entries(name, inputs, expression)
        ]

    state = "int j, const real *restrict s, const real *restrict c, real *restrict C"
    title = "Line j of the chain's pose, by sines (or lengths) and cosines of the moves"
    if chain.six:
        writer.function(f"{title}.", "end_line", state, lines("C", chain.line), given=first, lines=True)
    every = lines("C", chain.line) + lines("A", chain.axes)
    title = f"{title}; and of the axis and origin of every move."
    writer.function(title, "chain_line", f"{state}, real *restrict A", every, given=first, lines=True)


def _of_column(k: int) -> str:
    """Place of number k of a column after column, 6 numbers each."""
    column, line = divmod(k, 6)
    return f"{column} * SIDE6 + {line // 3} * LINES + {line % 3}"


def _write_chain(writer: _Writer, model: SymbolicModel, chain: ChainExpressions) -> None:
    fixed = {"p": model.p, "z": model.z}

    def entries(name: str, inputs: Mapping[str, ca.SX], expression: ca.SX) -> _Targets:
        nodes = writer.nodes({**fixed, **inputs}, expression)
        return [(f"{name}[{k}]", node) for k, node in enumerate(nodes)]

    q = {"q": model.q}
    moves = entries("v", q, chain.moves)
    writer.function("Angles and lengths of the moves.", "moves_of", "const real *q, real *v", moves)
    _write_lines(writer, entries, chain)
    if chain.mixed is not None:
        mixed = entries("", {**q, "A": chain.columns}, chain.mixed)
        leaves = entries("", {"A": chain.columns}, chain.columns)
        writer.function(
            "Columns by the readings from columns by the moves.",
            "mix",
            "const real *q, const real *A, real *J",
            [(f"J[{_of_column(k)}]", node) for k, (_, node) in enumerate(mixed)],
            given={node: f"A[{_of_column(k)}]" for k, (_, node) in enumerate(leaves)},
        )


def _write_loops(writer: _Writer, model: SymbolicModel) -> None:
    nq, nx, nc = len(model.readings), len(model.home), model.closure.numel()
    y = ca.vertcat(model.q, model.x)
    pose = ca.vec(model.pose[:3, :].T)  # row by row
    derivative = ca.vertcat(_twists(model.pose, y), ca.jacobian(model.closure, y))
    inputs = {"p": model.p, "z": model.z, "q": model.q, "x": model.x}
    T, c, J, gap = writer.graph.add(inputs, [pose, model.closure, ca.vec(derivative.T), model.gap])
    to_pose: _Targets = [(f"T[{k}]", node) for k, node in enumerate(T)]
    to_loops: _Targets = [(f"r[{6 + k}]", writer.graph.negative(node)) for k, node in enumerate(c)]
    places: _Targets = [(f"J[{k}]", node) for k, node in enumerate(J)]
    of_loops = [places[(6 + i) * (nq + nx) + nq + j] for i in range(nc) for j in range(nx)]
    state = "const real *q, const real *x"
    writer.function("Pose of the tool.", "pose_of", f"{state}, real *T", to_pose)
    title = "What the loops lack to close, and its negative derivative by x."
    writer.function(title, "loops_of", f"{state}, real *r, real *J", to_loops + of_loops)
    if np.isfinite(strain_of(model)):
        to_gap: _Targets = [(f"g[{k}]", node) for k, node in enumerate(gap)]
        title = "What loops with more equations than unknowns lack to close, at best as little as the parts are strained."
        writer.function(title, "strain_of", f"{state}, real *g", to_gap)
    title = "Pose, what the loops lack to close, and the derivative [twist; closure] by (q, x)."
    writer.function(title, "all_of", f"{state}, real *T, real *r, real *J", to_pose + to_loops + places)


def _twists(pose: ca.SX, y: ca.SX) -> ca.SX:
    """Derivative (6, ny) of a pose as twists [v; w] at its origin, in the frame the pose is told in."""
    rotation = pose[:3, :3]
    by_y = ca.jacobian(ca.vec(rotation), y)
    turns = [lie.vee(ca.reshape(by_y[:, k], 3, 3) @ rotation.T) for k in range(y.numel())]
    return ca.vertcat(ca.jacobian(pose[:3, 3], y), ca.horzcat(*turns))


def _function(
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
