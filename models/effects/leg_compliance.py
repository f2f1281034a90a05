"""Legs that stretch and shorten under the forces they carry."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import limb_at, singly_and_together
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS


@effects.add("leg-compliance")
class LegCompliance(Effect):
    """dl = c F, F the leg's force from the closed loops' statics, tension positive; one leg or all alike."""

    slug = "leg-compliance"
    setting_ranges = NO_SETTINGS
    title = "Compliant leg"
    counted = True
    formula = "dl = c F, F > 0 in tension"
    size = "0.01 to 1 um/N"
    look_alikes = ("platform-deformation", "actuator-scale", "gravity-sag", "wrong-constant")
    experiment = "repeat poses with and without a payload; targets beside the leg ends exclude the platform"
    source = "a bar of stiffness EA/l in series with its joints"
    needs_load = True

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly_and_together(limb.name for limb in machine.mechanism.limbs) if machine.loaded else []

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("c", "mm/N", scale=1e-2, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        ports = [limb_at(site.machine, name).length for name in site.place]
        return {port: site.c["c"] * site.load(port) for port in ports}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if len(place) > 1:
            return f"The legs {', '.join(place)} are equally compliant: they grow in tension."
        return f"The leg {place[0]} is compliant: it grows in tension, shortens in compression."
