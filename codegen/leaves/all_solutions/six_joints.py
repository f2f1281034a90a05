"""What the templates read of an open chain of six readings: its elimination, and what all solutions start from."""

from __future__ import annotations

from typing import Any

import numpy as np

from truepose.codegen.chain import ChainExpressions, pivot_order
from truepose.codegen.features import Features
from truepose.codegen.layout import Layout
from truepose.codegen.leaves.all_solutions.branches import branches_of
from truepose.codegen.leaves.all_solutions.resultant import DEGREE, elimination_of
from truepose.codegen.printer import Real
from truepose.models.machine.kinematics import SymbolicModel

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
    branches = branches_of(model, chain, layout.reach, layout.turns)
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
    """What finds all solutions of a six-joint arm that is not similar to one with a closed form."""
    found = elimination_of(model, chain, layout.reach, layout.turns, layout.vectors) if wanted else None
    angles = 2.0 * np.pi * np.arange(2 * DEGREE + 1) / (2 * DEGREE + 1)
    return {
        "resultant": found,
        **({"all_iter": SEARCH_ITER} if wanted and not found else {}),
        "nudged": found is not None and bool(np.any(found.tilts)),
        "loop_turns": [int(turn) for turn in np.roll(found.turns, -found.first)] if found else [],
        "sample_cosines": np.cos(angles),
        "sample_sines": np.sin(angles),
    }


__all__ = ["six_joints"]
