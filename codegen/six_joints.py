"""What the templates read of an open chain of six readings: its elimination, and what all solutions start from."""

from __future__ import annotations

from typing import Any

import numpy as np

from truepose.codegen.chain import ChainExpressions, pivot_order
from truepose.codegen.features import Features
from truepose.codegen.layout import Layout
from truepose.codegen.printer import Real
from truepose.leaves import modules_named
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
