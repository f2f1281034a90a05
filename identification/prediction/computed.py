"""Joints that formulas move: where a formula has no value (the root of a negative number), no machine can be assembled."""

from __future__ import annotations

import casadi as ca

from truepose.models.machine.assembly import displacement_of
from truepose.models.machine.kinematics import SymbolicModel


def computed_displacements(model: SymbolicModel) -> ca.SX:
    """(k,) mm or rad, of the joints that formulas move; no number where a formula has no value."""
    machine, values = model.machine, model.values
    laws = [follower.law for follower in machine.mechanism.followers if follower.law is not None]
    q = model.moved if laws else {}
    own = {name: displacement_of(machine, name, values, q) for name in q}
    return ca.vertcat(ca.SX(0, 1), *(law.value(own, values, bounded=False) for law in laws))
