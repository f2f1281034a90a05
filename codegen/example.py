"""Poses of ``example.c``: such as every set of features solves, so that only wrong code fails there."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.layout import Layout
from truepose.codegen.reference import Reference
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.velocities import twists

_EXAMPLES = 8


def example_context(model: SymbolicModel, layout: Layout, *, single: bool) -> dict[str, Any]:
    """Return the vectors of ``example.c``, how far its guesses stand aside, and what it allows.

    The vectors are the first of the samples in the better half by ``regularity``: from a guess next to a singular pose right
    code may find other joints, or none.
    """
    slack = 3.0 if single else 1.0  # rounding of p and q in single precision is not the solver's doing
    regular = regularity(model, layout)
    chosen = np.flatnonzero(regular >= np.median(regular))[:_EXAMPLES]
    return {
        "vectors": [(q, pose[:3].ravel()) for q, pose in (layout.vectors[k] for k in chosen)],
        "aside": np.minimum(50.0 * layout.unknown[: len(layout.near)], 0.02 * layout.width),
        "position": slack * layout.position,
        "rotation": slack * layout.rotation,
    }


def regularity(model: SymbolicModel, layout: Layout) -> Array:
    """Return the smallest singular value (n,) of what the solver inverts at each of the layout's vectors, mm a mm."""
    y = ca.vertcat(model.q, model.x)
    motion = twists(model.pose, y)
    motion[3:, :] = model.pose[:3, :3].T @ motion[3:, :]
    rows = [*layout.task.rows, *range(6, 6 + model.closure.numel())]
    scaled = (
        ca.diag(layout.weight) @ ca.vertcat(motion, ca.jacobian(model.closure, y)) @ ca.diag(layout.unknown)
    )
    at = ca.Function("solved", [model.q, model.z, model.p, model.x], [ca.densify(scaled[rows, :])])
    reference, out = Reference(model), []
    for q, _ in layout.vectors:
        x = reference.passive(q)
        matrix = np.array(at(q, model.z_home, model.p_home, model.home if x is None else x))
        out.append(np.linalg.svd(matrix, compute_uv=False)[-1])
    return np.round(out, 9)  # the last digits of another mathematical library choose no other poses
