"""Set one solver to the machine as the controller believes it to be, or to the real one, with any tool."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.compensation.compensate import ideal_constants, twists_between
from truepose.identification.compensation.inverse import PoseSolver, base_frame
from truepose.models.file.driver import APPROACH, Driver
from truepose.models.leaves.export.links import MM_PER_M, xyz_rpy
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.task import WHOLE
from truepose.wording import close_matches


class Robot:
    """A solver that is set to the nominal or to the real constants. ``drivers`` are values of the effects' drivers by name.

    Six joints meet whole poses, as their controller does; fewer meet what they can hold. Raises InputError for a driver that
    no effect has.
    """

    def __init__(self, machine: Machine, drivers: Mapping[str, float]) -> None:
        whole = WHOLE if len(machine.mechanism.readings) == len(AXES) else None
        self.machine, self.solver = machine, PoseSolver(machine, task=whole)
        model = self.solver.model
        for name in drivers:
            if name not in model.drivers:
                told = close_matches(name, model.drivers) if model.drivers else "the machine has none"
                raise InputError(f"--at: found the driver {name!r}, expected one that effects have; {told}")
        z = [drivers.get(name, float(v)) for name, v in zip(model.drivers, model.z_home, strict=True)]
        self.solver.z = np.array(z)
        self._real, self._ideal = model.p_home, ideal_constants(machine, model)
        self.base = base_frame(machine)

    @property
    def drivers(self) -> Mapping[str, float]:
        """Values of drivers, but for the ways in which joints arrive."""
        names = self.solver.model.drivers
        known = zip(names, self.solver.z.tolist(), strict=True)
        return {name: value for name, value in known if Driver.of(name).kind != APPROACH}

    @property
    def home(self) -> Array:
        """(nq,) readings at home."""
        return self.solver.model.q_home

    @property
    def reach(self) -> Array:
        """(nq,) readings that move a joint by the machine's size (a gantry has no length but its ranges), or by 1 rad."""
        actuators = self.machine.mechanism.actuators
        sizes = [max([self.solver.size, *map(abs, a.reading_range or ())]) for a in actuators]
        return np.array([s if a.reading_unit == "mm" else 1.0 for a, s in zip(actuators, sizes, strict=True)])

    def missed(self, goals: Array, poses: Array) -> Array:
        """Return twists (n, 6) from goals to poses (n, 4, 4) in the sensor's frame, of which the robot can hold."""
        return self.solver.task.counted(twists_between(goals, poses), goals, self.base[:3, :3])

    def nominal(self, tool: Array | None) -> None:
        """The drawing's joints and links, no effect, and a tool (4, 4) mm on the flange; None is the machine file's."""
        self.solver.p = self._with(tool, self._ideal)

    def real(self, tool: Array | None) -> None:
        """The machine as calibrated, with its effects and a tool."""
        self.solver.p = self._with(tool, self._real)

    def _with(self, tool: Array | None, p: Array) -> Array:
        if tool is None:
            return p
        xyz, rpy = xyz_rpy(tool)
        told = dict(zip((f"tool.{axis}" for axis in AXES), (*(v * MM_PER_M for v in xyz), *rpy), strict=True))
        return np.array(
            [told.get(name, value) for name, value in zip(self.solver.model.names, p, strict=True)]
        )
