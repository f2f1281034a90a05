"""Further targets on the tool body: machines that have them, to see what measuring them would bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from truepose.errors import InputError
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Parameter
from truepose.models.machine.sensor import Sensor
from truepose.models.sensors.pose import Pose
from truepose.models.sensors.targets import Targets
from truepose.models.units import convert

_AXES = "xyz"


@dataclass(frozen=True)
class Target:
    """A point (x, y, z) of the tool frame, mm."""

    name: str
    point: tuple[float, float, float]

    @classmethod
    def of(cls, text: str, machine: Machine) -> Target:
        """``NAME=x,y,z`` in the length unit of the machine file. Raises InputError for anything else."""
        name, _, rest = (part.strip() for part in text.partition("="))
        units = machine.units
        try:
            x, y, z = (convert(float(part), units.length, "mm") for part in rest.split(","))
        except ValueError:
            raise InputError(f"--target {text}: expected NAME=x,y,z such as T1=150,0,20") from None
        if not name or f"{name}.x" in machine.geometry:
            raise InputError(f"--target {text}: found the name {name!r}, expected one that is not taken")
        return cls(name, (x, y, z))


def with_targets(machine: Machine, targets: Sequence[Target]) -> Machine:
    """The machine with these points read as well: as precisely as its points, or its position, and as well known.

    Raises InputError where the machine's sensors read neither points nor poses.
    """
    for k, sensor in enumerate(machine.sensors):
        if isinstance(sensor, Targets):
            tolerance = sensor.points[0].tolerance
            more = replace(sensor, points=(*sensor.points, *_parameters(targets, tolerance)))
            return replace(machine, sensors=(*machine.sensors[:k], more, *machine.sensors[k + 1 :]))
    for sensor in machine.sensors:
        if isinstance(sensor, Pose):
            sigma = next(c.sigma for c in sensor.channels if c.kind == "position")
            known = machine.file.tolerances.length if machine.file else 0.0
            points: Sensor = Targets(_parameters(targets, known), sigma)
            return replace(machine, sensors=(*machine.sensors, points))
    found = ", ".join(sensor.type for sensor in machine.sensors)
    raise InputError(f"--target: found the sensor {found}, expected `targets` or `pose`")


def _parameters(targets: Sequence[Target], tolerance: float) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{target.name}.{axis}", "mm", target.point[k], tolerance, "target")
        for target in targets
        for k, axis in enumerate(_AXES)
    )
