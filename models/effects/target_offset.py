"""A target that does not sit where it is said to sit."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import singly
from truepose.models.effects.sights import XYZ, point_names
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS

LARGEST = 0.1


@effects.add("target-offset")
class TargetOffset(Effect):
    """A constant in the tool's frame added to one target's point; of a single target, the tool frame's own error."""

    slug = "target-offset"
    setting_ranges = NO_SETTINGS
    driven_by = "constant"
    title = "A target off its place"
    formula = "point + (x, y, z), constant in the tool's frame"
    size = (
        "2 to 15 um for the centre of a reflector in its ball, tenths of a mm for a nest that is not seated"
    )
    look_alikes = ("platform-deformation", "lens-distortion", "sensor-scale", "frame-shift")
    experiment = "turn the reflector in its nest, or swap two reflectors: the offset goes with the reflector"
    source = "sizes recalled from data sheets of reflectors; not checked against one"

    def places(self, machine: Machine) -> Sequence[Place]:
        """Points that are constants of the machine; the reflector of a ``position`` sensor is the tool frame."""
        known = machine.geometry
        points = [name for sensor in machine.sensors for name in point_names(sensor)]
        return singly(name[:-1] for name in points if all(f"{name}{axis}" in known for axis in XYZ))

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(axis, "mm", LARGEST) for axis in XYZ)

    def shifts(self, site: Site) -> Shifts:
        return {f"{site.place[0]}.{axis}": site.c[axis] for axis in XYZ}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return f"The target {place[0]} sits off its stated point, by the same vector of the tool's frame in every row."
