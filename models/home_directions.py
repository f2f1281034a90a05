"""Where universal and spherical joints and rods point in the assembly at home, as drawn."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from truepose.models.assembly import assemble
from truepose.models.kinematics import symbolic_model
from truepose.models.machine import FRAMES, Machine
from truepose.models.machine_file import MachineFile
from truepose.models.mechanism import AXES, Mechanism
from truepose.models.parameters import Parameter
from truepose.models.states import AXIS, directions, joint_ends


def home_directions(
    mechanism: Mechanism, file: MachineFile | None = None
) -> Mapping[str, tuple[float, float, float]]:
    """Unit vector of each end of ``joint_ends`` (frames: ``truepose.models.states``), nominal parameters, home readings.

    Raises InputError, which names ``file``, where the mechanism cannot be assembled at home.
    """
    frames = tuple(Parameter(f"{frame}.{axis}", "mm", 0.0) for frame in FRAMES for axis in AXES)
    machine = Machine(file.name if file else "mechanism", mechanism, frames, (), file=file)
    model = symbolic_model(machine)
    values = {p.name: ca.SX(p.nominal) for p in machine.parameters} | dict.fromkeys(machine.ports, ca.SX(0))
    q = dict(zip(model.readings, ca.vertsplit(ca.SX(ca.DM(model.q_home))), strict=True))
    bodies = assemble(machine, values, q, {}, ca.SX(ca.DM(model.home))).bodies
    found = directions(machine, bodies, values)
    out = {}
    for end in joint_ends(machine):
        x, y, z = (float(np.asarray(ca.evalf(found[f"{AXIS}{end}.{axis}"]))[0, 0]) for axis in "xyz")
        out[end] = (x, y, z)
    return out


__all__ = ["home_directions"]
