"""Flexures in place of ball joints: their centre moves as they bend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import limb_at, singly_and_together
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS


@effects.add("flexure-shift")
class FlexureShift(Effect):
    """A leg grows by k times the squared tilt of both its flexures against home; one leg or all alike.

    A flexure of constant section and length l in pure bending has k = l / 12. Where the machine's model has bent
    flexures already (``model: beam``), k is what they deviate by. A notch may have either sign.
    """

    slug = "flexure-shift"
    setting_ranges = NO_SETTINGS
    title = "Flexure whose centre moves"
    counted = True
    formula = (
        "dl = k (theta_a^2 + theta_b^2), theta^2 = |n - n_home|^2, n the leg's direction seen from either end"
    )
    size = "k = l / 12 for a flexure of length l: 2.5 mm for 30 mm, which makes 1 um at 0.02 rad"
    look_alikes = ("joint-runout", "wrong-constant", "platform-deformation")
    experiment = "large tilts of the platform to either side: the shift is even in the tilt"
    source = "beam theory as in Gayral and Daney 2012, INRIA RR-8096, section 4.3 (truepose.models.machine.assembly)"

    def places(self, machine: Machine) -> Sequence[Place]:
        if machine.mechanism.loops != "exact":
            return []
        rods = {rod.name for rod in machine.mechanism.rods}
        return singly_and_together(limb.name for limb in machine.mechanism.limbs if limb.name in rods)

    def screened(self, machine: Machine, place: Place) -> bool:
        return machine.mechanism.flexure_length is not None

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("k", "mm", scale=(machine.mechanism.flexure_length or 20.0) / 2),)

    def shifts(self, site: Site) -> Shifts:
        limbs = [limb_at(site.machine, name) for name in site.place]
        return {limb.length: site.c["k"] * _squared_tilts(site, limb.name) for limb in limbs}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        legs = ", ".join(place)
        return f"The flexures of {legs} shift their centres as they bend, with the square of the tilt."

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        length = 12 * values["k"]
        beyond = "Beyond what the model has, the shift is that of flexures of constant section"
        return f"{beyond}, {length:.0f} mm long." if length >= 1 else ""


def _squared_tilts(site: Site, rod: str) -> ca.SX:
    """Sum over both ends of a rod of the squared chord between its direction and that at home."""
    home = site.machine.mechanism.home_directions
    ends = [f"{rod}.{end}" for end in "ab"]
    return sum((ca.sumsqr(site.direction(end) - ca.DM(home[end])) for end in ends), ca.SX(0))
