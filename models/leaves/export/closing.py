"""Close the loops of a machine: the tool's pose at readings, for any constants."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.machine.closure import closed, coordinate_scale, one_row
from truepose.models.machine.kinematics import SymbolicModel

Pose = Callable[[Array, Array], Array]


def closed_pose_function(model: SymbolicModel) -> Pose:
    """Return a function of readings (nq,) and constants (np,) to the tool (4, 4) mm in the base; NaN where loops stay open.

    Loops are closed from home, and drivers have their defaults.
    """
    gap = [model.equations, ca.jacobian(model.equations, model.x), model.gap]
    closure = ca.Function("closure", [model.x, model.q, model.z, model.p], [ca.densify(g) for g in gap])
    pose = ca.Function("pose", [model.x, model.q, model.z, model.p], [model.pose])
    scale = coordinate_scale(model.machine, len(model.home), model.gap.numel())
    fixed = ca.DM(model.z_home)

    def at(q: Array, p: Array) -> Array:
        own = ca.Function("at", [model.x], list(closure.call([model.x, ca.DM(q), fixed, ca.DM(p)])))
        x, good = closed(one_row(own), model.home[None], scale)
        return np.array(pose(x[0], q, fixed, p)) if good[0] else np.full((4, 4), np.nan)

    return at
