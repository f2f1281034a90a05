"""The head of a small machine's file, and where its tool stands under effects."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.closure import closed_home, coordinate_scale
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

HEAD = "schema: truepose/machine/1\nname: {name}\ntolerances: {{length: 0.1, angle: 0.05}}\ngravity: [0, 0, -9.80665]\n"


def pose(machine: Machine, q: Sequence[float] | Array, *terms: PlacedEffect) -> Array:
    """(4, 4) base to tool, loops closed from home."""
    m = symbolic_model(machine, terms)
    x = m.home
    if len(x):
        outputs = [m.equations, ca.jacobian(m.equations, m.x), m.gap]
        at = ca.Function("g", [m.x, m.q, m.z, m.p], [ca.densify(o) for o in outputs])
        here = ca.Function("h", [m.x], list(at.call([m.x, ca.DM(q), ca.DM(m.z_home), ca.DM(m.p_home)])))
        found = closed_home(here, x, coordinate_scale(machine, len(x), m.gap.numel()))
        assert found is not None
        x = found
    return np.array(ca.Function("pose", [m.x, m.q, m.z, m.p], [m.pose])(x, q, m.z_home, m.p_home))
