"""C functions of an open chain: what its moves are, the tool's pose, the axes of the moves.

A pose is computed line by line: each line of [R|p] takes the same steps from the base to the tool, so that three
lines fill the lanes of a vector, or one piece of code runs three times where memory is short.

What the templates read of an open chain of six readings: its elimination, and what all solutions start from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.features import Features
from truepose.codegen.layout import Layout
from truepose.codegen.printer import Real
from truepose.leaves import modules_named
from truepose.models import lie
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.velocities import Chain, Move
from truepose.models.task import WHOLE, Task

FIRST = 16
"""Kept numbers of the first frame: lines of [R|p], filled up to four."""
STEP = 6
"""Kept numbers of a move."""


@dataclass(frozen=True)
class ChainExpressions:
    """Inputs and outputs of the functions.

    moves (nv,)      values of the moves at readings q
    first (3, 4)     where the chain starts: lines of the first move's frame in the nominal base frame, [R|p]
    line (4,), axes  one line [x y z p] of the tool's pose from that of the first frame, ``start`` (4,), with sine ``s``
                     and cosine ``c`` of turns (``s`` of a slide is its length); and for each move the line of its
                     axis, then of its origin (2 nv,)
    mixed (6 nq,)    columns by readings from columns by moves (6 nv,); None where they are the same
    steps (n,)       what is constant in a chain of turns by the readings: for every move [offset, cosine and sine of the
                     tilt about x before it, x, y, z before it], of the first behind the first frame; then R column
                     after column and p of the tool's placement. Empty for other chains
    frames           of such a chain, for every move but the first: its own frame (3, 4), before it became a tilt
    own (nv,)        and the offset of every move before that
    task             which components of the pose the inverse meets
    reaching         how many of the readings move the tool: those of another arm do not
    kept             (16 + n,) stands for the steps in the other expressions, in its places behind the first 16
    """

    chain: Chain
    start: ca.SX
    s: ca.SX
    c: ca.SX
    columns: ca.SX
    moves: ca.SX
    first: ca.SX
    line: ca.SX
    axes: ca.SX
    mixed: ca.SX | None
    steps: ca.SX
    frames: tuple[ca.SX, ...]
    own: ca.SX
    kept: ca.SX
    readings: int
    reaching: int
    task: Task

    @property
    def six(self) -> bool:
        """Whether six readings make a square Jacobian of the whole pose, which has a solver of its own."""
        return self.readings == self.reaching == 6 and self.task.is_whole

    def written_out(self, expression: ca.SX) -> ca.SX:
        """An expression with the steps in the places of what is kept."""
        return ca.substitute(expression, self.kept, ca.vertcat(ca.SX.zeros(FIRST), self.steps))

    @classmethod
    def of(cls, model: SymbolicModel, chain: Chain, task: Task = WHOLE) -> ChainExpressions:
        """The expressions of a model's chain."""
        count = len(chain.moves)
        columns, start = ca.SX.sym("A", 6 * count), ca.SX.sym("start", 4)
        s, c = ca.SX.sym("s", count), ca.SX.sym("c", count)
        slopes = ca.jacobian(chain.values, model.q)
        same = _is_identity(slopes)
        steps = _steps(chain, model.q) if same and all(move.turn for move in chain.moves) else ca.SX(0, 1)
        kept = ca.SX.sym("k", FIRST + steps.numel())
        plain = chain.plain if steps.numel() else ()
        if steps.numel():
            places = zip(ca.vertsplit(steps), ca.vertsplit(kept[FIRST:]), strict=True)
            held = ca.vertcat(*(step if step.is_constant() else place for step, place in places))
            chain = _of_steps(chain, held, model.q)
        line, axes = _line(chain, start, s, c)
        mixed = ca.vec(ca.reshape(columns, 6, count) @ slopes)
        return cls(
            chain=chain,
            start=start,
            s=s,
            c=c,
            columns=columns,
            moves=chain.values,
            first=chain.moves[0].before[:3, :],
            line=line,
            axes=axes,
            mixed=None if same else mixed,
            steps=steps,
            frames=tuple(move.before[:3, :] for move in plain[1:]),
            own=ca.substitute(ca.vertcat(*(move.value for move in plain)), model.q, 0 * model.q),
            kept=kept,
            readings=len(model.readings),
            reaching=len(set(slopes.sparsity().get_triplet()[1])),
            task=task,
        )


def pivot_order(model: SymbolicModel, chain: ChainExpressions, samples: Array, reach: float) -> list[int]:
    """Rows of [v; reach w] in the order in which elimination without exchanges takes its pivots.

    Each is the one that is typically largest over the ``samples`` (n, nq) of readings.
    """
    jacobians, _ = jacobians_and_tools(model, chain, samples, reach)
    order: list[int] = []
    for k in range(jacobians.shape[2]):
        with np.errstate(divide="ignore"):
            size = np.log(np.abs(jacobians[:, :, k])).clip(-30.0).mean(axis=0)
        row = max((i for i in range(6) if i not in order), key=lambda i: float(size[i].round(6)))
        order.append(row)
        pivot = jacobians[:, row, k]
        safe = np.where(np.abs(pivot) > 1e-9, pivot, 1.0)
        factor = jacobians[:, :, k] / safe[:, None]
        factor[:, row] = 0.0
        jacobians -= factor[:, :, None] * jacobians[:, row, None, :]
    return order


def jacobians_and_tools(
    model: SymbolicModel, chain: ChainExpressions, samples: Array, reach: float
) -> tuple[Array, Array]:
    """(n, 6, nq) columns [v; reach w] at the tool, and its poses (n, 3, 4), in the nominal frame of the base."""
    turns = ca.DM([float(move.turn) for move in chain.chain.moves])
    values = chain.written_out(chain.moves)
    inputs = ca.vertcat(chain.start, chain.s, chain.c)
    state = ca.vertcat(turns * ca.sin(values) + (1 - turns) * values, ca.cos(values))
    outputs = chain.written_out(ca.vertcat(chain.line, chain.axes))
    at = [ca.substitute(outputs, inputs, ca.vertcat(chain.first[i, :].T, state)) for i in range(3)]
    lines = ca.horzcat(*at).T  # (3, 4 + 2 nv)
    columns = []
    for k, move in enumerate(chain.chain.moves):
        axis, origin = lines[:, 4 + 2 * k], lines[:, 5 + 2 * k]
        v, w = ca.cross(axis, lines[:, 3] - origin), reach * axis
        columns.append(ca.vertcat(v, w) if move.turn else ca.vertcat(axis, ca.SX.zeros(3, 1)))
    jacobian = ca.horzcat(*columns) @ ca.jacobian(values, model.q)
    results = [ca.densify(jacobian), ca.densify(lines[:, :4])]
    function = ca.Function("columns", [model.q, model.p, model.z], results)
    found = [[np.array(part) for part in function(q, model.p_home, model.z_home)] for q in samples]
    return np.array([jacobian for jacobian, _ in found]), np.array([tool for _, tool in found])


def _line(chain: Chain, start: ca.SX, s: ca.SX, c: ca.SX) -> tuple[ca.SX, ca.SX]:
    """One line of the tool's pose, and of every move's axis and origin; all lines have one form."""
    line, origin = start[:3].T, start[3]
    axes = []
    for k, move in enumerate(chain.moves):
        if k:
            line, origin = _carried(line, origin, move.before)
        axes += [line[2], origin]
        if move.turn:
            x, y = line[0], line[1]
            line = ca.horzcat(c[k] * x + s[k] * y, c[k] * y - s[k] * x, line[2])
        else:
            origin = origin + line[2] * s[k]
    line, origin = _carried(line, origin, chain.after)
    return ca.vertcat(line.T, origin), ca.vertcat(*axes)


def _steps(chain: Chain, q: ca.SX) -> ca.SX:
    """Numbers of a chain of turns by q and constants, whose placements but the first are tilts about x."""
    offsets = ca.substitute(chain.values, q, ca.SX.zeros(q.shape))
    rows = []
    for k, move in enumerate(chain.moves):
        before = move.before if k else ca.SX.eye(4)
        rows.append(ca.vertcat(offsets[k], before[1, 1], before[2, 1], before[:3, 3]))
    return ca.densify(ca.vertcat(*rows, ca.vec(chain.after[:3, :])))


def _of_steps(chain: Chain, steps: ca.SX, q: ca.SX) -> Chain:
    """The chain again from its numbers."""
    moves = []
    for k, move in enumerate(chain.moves):
        offset, c, s, *p = ca.vertsplit(steps[STEP * k : STEP * (k + 1)])
        tilt = ca.vertcat(ca.horzcat(1, 0, 0), ca.horzcat(0, c, -s), ca.horzcat(0, s, c))
        before = lie.transform(tilt, ca.vertcat(*p)) if k else move.before
        moves.append(Move(True, q[k] + offset, before))
    tool = ca.reshape(steps[STEP * len(moves) :], 3, 4)
    return Chain(tuple(moves), lie.transform(tool[:, :3], tool[:, 3]))


def _carried(line: ca.SX, origin: ca.SX, pose: ca.SX) -> tuple[ca.SX, ca.SX]:
    return line @ pose[:3, :3], origin + line @ pose[:3, 3]


def _is_identity(slopes: ca.SX) -> bool:
    if slopes.shape[0] != slopes.shape[1] or not slopes.is_constant():
        return False
    return bool(np.array_equal(np.array(ca.DM(slopes)), np.eye(slopes.shape[0])))


SEARCH_ITER = 20000
"""Evaluations that all solutions may take where no equation tells of them."""
_NONE: dict[str, Any] = {
    "six": False,
    "branches": None,
    "resultant": None,
    "lists_all": False,
    "collects": False,
    "order": [],
    "pivots": [],
    "per_mm": [],
}


def six_joints(
    model: SymbolicModel, chain: ChainExpressions | None, layout: Layout, real: Real, features: Features
) -> dict[str, Any]:
    """Order of the pivots of six columns, and the smallest to go on with: rounding grows by their inverse.

    Without ``cold``, other ways to go on, single precision takes a smaller one: the check of the pose judges the result.
    ``lists_all``: whether there is ``NAME_ik_all``; ``collects``: whether all solutions are looked for, which the
    inverse of an arm like one with a closed form does as well.
    """
    if chain is None or not chain.six:
        return _NONE
    share = 1e-9 if real == "double" else 1e-3 if features.cold else 1e-6
    samples = np.array([q for q, _ in layout.vectors])
    per_mm = 1.0 / layout.unknown
    closed = (leaf.closed_form(model, chain, layout) for leaf in modules_named("solutions"))
    branches = next(closed, None)
    return {
        "six": True,
        "branches": branches,
        "lists_all": features.branches,
        "collects": features.branches or (features.cold and branches is not None),
        **_general(model, chain, layout, wanted=features.branches and branches is None),
        "order": pivot_order(model, chain, samples, layout.reach),
        "pivots": [float(f"{share * size:.3g}") for size in per_mm],
        "per_mm": per_mm,
    }


def _general(
    model: SymbolicModel, chain: ChainExpressions, layout: Layout, *, wanted: bool
) -> dict[str, Any]:
    """What finds all solutions of an arm that is not similar to one with a closed form: its equation, else a search."""
    out: dict[str, Any] = {"resultant": None}
    for leaf in modules_named("solutions"):
        out |= leaf.general_equation(model, chain, layout, wanted=wanted)
    return out | ({"all_iter": SEARCH_ITER} if wanted and not out["resultant"] else {})
