"""What generated C offers of an arm of six joints beyond Newton's method: closed forms, and the equation of all solutions."""

from __future__ import annotations

from typing import Any

import numpy as np

from truepose.codegen.chain import ChainExpressions
from truepose.codegen.layout import Layout
from truepose.codegen.leaves.all_solutions.branches import Branches, branches_of
from truepose.codegen.leaves.all_solutions.resultant import DEGREE, elimination_of
from truepose.models.machine.kinematics import SymbolicModel


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
