"""C functions of closed chains: ``LoopExpressions`` and ``Legs`` handed to the writer of ``truepose.codegen.blocks``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np

from truepose.codegen.expressions import Graph
from truepose.codegen.layout import Layout
from truepose.codegen.legs import Legs, legs_of
from truepose.codegen.loops import Equations, LoopExpressions
from truepose.codegen.printer import Real
from truepose.codegen.reference import strain_of
from truepose.models import lie
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.task import CALM, FARTHEST, NOTHING, Task

Targets = list[tuple[str, int]]
Arrays = tuple[tuple[str, ...], tuple[str, ...]]
"""Names of the arrays that a function reads, and of those that it fills."""
ROOTS = "roots_of"
"""The function that has a form for several rows at once."""


class Writer(Protocol):
    """What functions are written to."""

    graph: Graph

    def function(self, title: str, name: str, arrays: Arrays, targets: Targets) -> None:
        """A static function of the model that fills the targets."""


@dataclass(frozen=True)
class Loops:
    """Expressions of a closed chain's functions, and what the templates read of them."""

    expressions: LoopExpressions
    legs: Legs | None

    @classmethod
    def of(cls, model: SymbolicModel, layout: Layout, real: Real) -> Loops:
        """Those of a model with passive coordinates."""
        return cls(LoopExpressions.of(model, layout, real), legs_of(model, layout, real))

    @property
    def context(self) -> dict[str, Any]:
        """Sizes and limits for the templates."""
        own, legs = self.expressions, self.legs
        return {
            "places": own.places,
            "inner": own.inner,
            "loops": own.loops,
            "whole": own.whole,
            "roots": bool(legs and legs.roots),
            "legs": legs if legs and legs.equations and not legs.roots else None,
        }


def write_loops(writer: Writer, model: SymbolicModel, loops: Loops) -> None:
    """The functions of pose and closure, of Newton's equations, and of legs."""
    own, known = loops.expressions, {"p": model.p, "z": model.z}
    inputs = {**known, "q": model.q, "x": model.x}
    T, c, J, gap = writer.graph.add(inputs, [own.pose, own.closure, own.entries, own.gap])
    to_pose: Targets = [(f"T[{k}]", node) for k, node in enumerate(T)]
    to_loops: Targets = [(f"r[{6 + k}]", writer.graph.negative(node)) for k, node in enumerate(c)]
    entries: Targets = [(f"J[{k}]", node) for k, node in enumerate(J)]
    state = ("q", "x")
    title = "Pose of the tool, and what the loops lack to close."
    writer.function(title, "rest_of", (state, ("T", "r")), to_pose + to_loops)
    title = "What the loops lack to close, and the entries of the derivative by x."
    writer.function(title, "loops_of", (state, ("r", "J")), to_loops + entries[: own.inner])
    if np.isfinite(strain_of(model)):
        to_gap: Targets = [(f"g[{k}]", node) for k, node in enumerate(gap)]
        title = "What loops with more equations than unknowns lack to close, at best as little as the parts are strained."
        writer.function(title, "strain_of", (state, ("g",)), to_gap)
    title = (
        "Pose, what the loops lack to close, and the entries of the derivative [twist; closure] by (q, x)."
    )
    writer.function(title, "all_of", (state, ("T", "r", "J")), to_pose + to_loops + entries)
    known = {**known, "J": own.symbols}
    if own.loops:
        _write_equations(writer, "loops", own.loops, known)
    if own.whole:
        _write_equations(writer, "whole", own.whole, known, own.rows)
    if loops.legs:
        _write_legs(writer, model, loops.legs)


def _write_equations(
    writer: Writer,
    name: str,
    equations: Equations,
    inputs: Mapping[str, ca.SX],
    rows: Sequence[int] | None = None,
) -> None:
    """Elimination, and the unknowns by a right side, of which ``rows`` are read."""
    factors = equations.factors
    read = range(factors.size) if rows is None else rows
    right = ca.SX.sym("r", max(read) + 1)
    solution = ca.substitute(factors.solution, factors.right, right[list(read)])
    values = writer.graph.add(inputs, [factors.values])[0]
    title = "Triangular factors by the entries of the derivative: inverse pivots come first."
    targets = [(f"F[{k}]", node) for k, node in enumerate(values)]
    writer.function(title, f"{name}_factors", (("J",), ("F",)), targets)
    inputs = {**inputs, "F": factors.symbols, "r": right}
    step = writer.graph.add(inputs, [solution])[0]
    targets = [(f"step[{k}]", node) for k, node in enumerate(step)]
    writer.function("The step for a right side r.", f"{name}_step", (("J", "F", "r"), ("step",)), targets)


def _write_legs(writer: Writer, model: SymbolicModel, legs: Legs) -> None:
    inputs = {"p": model.p, "z": model.z, "T": legs.pose}
    if legs.roots:
        roots = legs.roots
        q, under, lack = writer.graph.add(inputs, [roots.readings, roots.under, roots.lack])
        targets = [(f"q[{k}]", node) for k, node in enumerate(q)]
        targets += [(f"s[{k}]", node) for k, node in enumerate(under + lack)]
        title = "Readings that put the tool at T, the squares of the roots in them, and what the rods then lack, mm."
        writer.function(title, ROOTS, (("T",), ("q", "s")), targets)
    elif legs.equations:
        r, J = writer.graph.add({**inputs, "q": model.q}, [legs.lack, legs.entries])
        targets = [(f"r[{k}]", writer.graph.negative(node)) for k, node in enumerate(r)]
        targets += [(f"J[{k}]", node) for k, node in enumerate(J)]
        title = (
            "What the rods lack at the tool's pose T, mm, and the entries of its derivative by the readings."
        )
        writer.function(title, "legs_of", (("T", "q"), ("r", "J")), targets)
        known = {"p": model.p, "z": model.z}
        _write_equations(writer, "legs", legs.equations, {**known, "J": legs.symbols})


def write_turns(writer: Writer, task: Task) -> None:
    """Write the function of the turns that a task counts, and of their rates by the turn in the base frame."""
    target, pose, w = ca.SX.sym("target", 12), ca.SX.sym("T", 12), ca.SX.sym("w", 3)
    goal, rotation = (ca.reshape(lines, 4, 3).T[:, :3] for lines in (target, pose))
    left = task.turns(goal, rotation + lie.skew(w) @ rotation)
    at = [ca.substitute(v, w, ca.SX.zeros(3)) for v in (-left, ca.jacobian(left, w).T)]
    e, S = writer.graph.add({"target": target, "T": pose}, [ca.densify(v) for v in at])
    targets = [(f"e[{k}]", node) for k, node in enumerate(e)] + [
        (f"S[{k}]", node) for k, node in enumerate(S)
    ]
    title = "Turns that take T to the target about the tool's axes, about rad, and their rates by a turn in the base frame."
    writer.function(title, "turns_left", (("target", "T"), ("e", "S")), targets)


def easing_context(layout: Layout, *, single: bool) -> dict[str, Any] | None:
    """Return what commands next to singular poses read; None where no joint has to swing for a turn."""
    if not layout.free:
        return None
    return {
        "free": layout.free,
        "holders": [k for k in range(len(layout.near)) if k not in layout.free],
        "calm": CALM,
        "farthest": FARTHEST,
        "nothing": max(NOTHING, layout.share * layout.rotation),
        "steps": 12,
        "settled": 1e-6 if single else 1e-12,
    }


def task_context(task: Task) -> dict[str, Any]:
    """Return what the templates read: ``skip`` rows of six do not count, ``along`` and ``about`` are axes.

    ``swings``: a turn may ask a joint to move far where the position alone would not.
    """
    return {
        "partial": not task.is_whole,
        "skip": 6 - len(task.rows),
        "along": task.along,
        "about": task.about,
        "axis": task.axis,
        "swings": task.position is not None,
        "words": task.words,
    }
