"""What generated C offers of an arm of six joints beyond Newton's method: closed forms, and the equation of all solutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from truepose.arrays import Array
from truepose.codegen.chain import ChainExpressions, jacobians_and_tools
from truepose.codegen.layout import Layout
from truepose.codegen.leaves.all_solutions.resultant import DEGREE, elimination_of
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.states import across

_PARALLEL = 0.05
"""Largest angle (rad) between axes that count as parallel."""
_MEETING = 0.02
"""Largest distance of axes that count as meeting, in parts of the reach."""


@dataclass(frozen=True)
class Branches:
    """The drawn arm: ``wrist``, whose axes 4, 5 and 6 meet, or ``parallel``, whose axes 2, 3 and 4 are parallel.

    At readings zero, in the nominal base frame, mm: axes as drawn and points on them (6, 3), the tool's pose (3, 4), the common
    direction of the parallel axes (3,), that of axis 2, and whether axes 2 to 4 point along it (1) or against it (-1); the
    point where the last axes meet (3,); and a unit vector (3,) across axis 6 of a wrist, else across the parallel axes.
    """

    kind: Literal["wrist", "parallel"]
    axes: Array
    points: Array
    tool: Array
    common: Array
    signs: Array
    meeting: Array
    side: Array


def branches_of(
    model: SymbolicModel, chain: ChainExpressions, reach: float, turns: tuple[bool, ...]
) -> Branches | None:
    """The closed form next to a chain of six readings; None where there is none."""
    if not (chain.six and all(turns)):
        return None
    (jacobian,), (tool,) = jacobians_and_tools(model, chain, np.zeros((1, 6)), 1.0)
    v, w = jacobian[:3].T, jacobian[3:].T
    turn = np.sum(w**2, axis=1, keepdims=True)
    if not np.allclose(turn, 1.0, atol=0.1):
        return None
    axes, points = w / np.sqrt(turn), tool[:, 3] - np.cross(v, w) / turn
    return drawn_branches("wrist", axes, points, tool, reach) or drawn_branches(
        "parallel", axes, points, tool, reach
    )


def drawn_branches(
    kind: Literal["wrist", "parallel"], axes: Array, points: Array, tool: Array, reach: float
) -> Branches | None:
    """The closed form of one kind for axes and points on them (6, 3) and the tool's pose (3, 4), mm; None if it is another."""
    alike, last = ((1, 2), (3, 4, 5)) if kind == "wrist" else ((1, 2, 3), (4, 5))
    signs = np.where(axes @ axes[1] < 0, -1.0, 1.0)
    common = np.sum((signs[:, None] * axes)[list(alike)], axis=0)
    common /= np.linalg.norm(common)
    meeting, distance = meeting_point(axes[list(last)], points[list(last)])
    spread = np.linalg.norm(np.cross(axes[list(alike)], common), axis=1)
    if spread.max() > _PARALLEL or distance > _MEETING * reach:
        return None
    axes, points = axes.copy(), points.copy()
    axes[list(alike)] = signs[list(alike), None] * common
    points[list(last)] = meeting
    side = across(axes[5] if kind == "wrist" else common)[0]
    # without the digits that another mathematical library would give
    axes, tool, common, side = (np.round(part, 13) + 0.0 for part in (axes, tool, common, side))
    points, meeting = np.round(points, 9) + 0.0, np.round(meeting, 9) + 0.0
    return Branches(kind, axes, points, tool, common, signs[1:4], meeting, side)


def meeting_point(axes: Array, points: Array) -> tuple[Array, float]:
    """The point (3,) next to lines along ``axes`` (k, 3) through ``points`` (k, 3), and how far the farthest passes by, mm."""
    off = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    solution = np.linalg.lstsq(off.reshape(-1, 3), (off @ points[:, :, None]).ravel(), rcond=1e-6)[0]
    meeting = np.asarray(solution, dtype=float)
    return meeting, float(np.max(np.linalg.norm((off @ (meeting - points)[:, :, None])[..., 0], axis=1)))


def closed_form(model: SymbolicModel, chain: ChainExpressions, layout: Layout) -> Branches | None:
    """Return the closed form of an arm similar to this one, None where there is none."""
    return branches_of(model, chain, layout.reach, layout.turns)


def general_equation(
    model: SymbolicModel, chain: ChainExpressions, layout: Layout, *, wanted: bool
) -> dict[str, Any]:
    """Return what the templates read of the equation that all solutions meet; ``resultant`` is None without one."""
    found = elimination_of(model, chain, layout.reach, layout.turns, layout.vectors) if wanted else None
    angles = 2.0 * np.pi * np.arange(2 * DEGREE + 1) / (2 * DEGREE + 1)
    return {
        "resultant": found,
        "nudged": found is not None and bool(np.any(found.tilts)),
        "loop_turns": [int(turn) for turn in np.roll(found.turns, -found.first)] if found else [],
        "sample_cosines": np.cos(angles),
        "sample_sines": np.sin(angles),
    }
