"""Where universal and spherical joints and rods point in the assembly at home, as drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np

from truepose.models.file.machine_file import MachineFile
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.mechanism import AXES, Mechanism
from truepose.models.machine.parameters import Parameter
from truepose.models.machine.states import AXIS, joint_ends


def home_directions(
    mechanism: Mechanism, file: MachineFile | None = None
) -> Mapping[str, tuple[float, float, float]]:
    """Unit vector of each end of ``joint_ends`` (frames: ``states``), nominal parameters, home readings.

    A calibrated file has the drawing's parameters in ``nominal``: a fit, and the file of it, then have the same directions.

    Raises InputError, which names ``file``, where the mechanism cannot be assembled at home.
    """
    frames = tuple(Parameter(f"{frame}.{axis}", "mm", 0.0) for frame in FRAMES for axis in AXES)
    drawn = {} if file is None else file.nominal
    own = tuple(replace(p, nominal=drawn.get(p.name, p.nominal)) for p in mechanism.parameters)
    closing = replace(mechanism, parameters=own, loops="exact")  # at home every way to close is the exact one
    machine = Machine(file.name if file else "mechanism", closing, frames, (), file=file)
    ends = joint_ends(machine)
    if not ends:
        return {}
    model = symbolic_model(machine, ports=True)
    found = ca.vertcat(*(model.states[f"{AXIS}{end}.{axis}"] for end in ends for axis in "xyz"))
    at = ca.Function("at", [model.q, model.z, model.p, model.x], [found])
    values = np.asarray(at(model.q_home, model.z_home, model.p_home, model.home), dtype=float).reshape(-1, 3)
    return {end: (float(x), float(y), float(z)) for end, (x, y, z) in zip(ends, values, strict=True)}
