"""One joint that is dragged along by another."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

from truepose.errors import InputError
from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS

LARGEST = {"1": 0.02, "mm/rad": 5.0, "rad/mm": 1e-3}
BETWEEN_LEGS = 0.1
"""How likely a leg is dragged along by another, in terms of joints whose gear trains or guides may meet."""


@effects.add("axis-coupling")
class AxisCoupling(Effect):
    """Place (driven, driving): the driven joint moves by k times what the other's reading moves it."""

    slug = "axis-coupling"
    setting_ranges = NO_SETTINGS
    driven_by = "coupling"
    title = "Coupling between two axes"
    formula = "dq_driven = k q_driving"
    size = "k of 1e-4 to 1e-2 in wrists whose gear trains run through each other"
    look_alikes = ("actuator-scale", "wrong-constant", "axis-straightness", "platform-deformation")
    experiment = "move only the driving joint and watch the driven body with a level or a mirror"
    source = "gear trains of wrists; a compensation term of robot controllers"

    def places(self, machine: Machine) -> Sequence[Place]:
        return list(permutations(machine.mechanism.readings, 2))

    def likely(self, machine: Machine, place: Place) -> float:
        """Every leg of a parallel machine has a drive of its own."""
        legs = {limb.reading for limb in machine.mechanism.limbs}
        return BETWEEN_LEGS if legs.issuperset(place) else 1.0

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if len(place) != 2:
            raise InputError(f"{self.slug}: found place {list(place)}, expected two joints: driven, driving")
        driven, driving = (actuator_at(machine, name).unit for name in place)
        unit = "1" if driven == driving else f"{driven}/{driving}"
        return (Coefficient("k", unit, LARGEST[unit]),)

    def shifts(self, site: Site) -> Shifts:
        driven, driving = (actuator_at(site.machine, name) for name in site.place)
        return {driven.displacement: site.c["k"] * site.moved(driving.reading)}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return f"Joint {place[0]} is dragged along in proportion when joint {place[1]} moves."
