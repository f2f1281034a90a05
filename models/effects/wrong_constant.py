"""A constant that is grossly wrong: a misread drawing, a unit, a sign, an axis mounted askew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import rails, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Parameter, element_of
from truepose.models.machine.placed import NO_SETTINGS

LARGEST_ANGLE = 0.2
LARGEST_FRACTION = 0.1


@effects.add("wrong-constant")
class WrongConstant(Effect):
    """One parameter far outside its tolerance; or the rails of all legs tilted alike along their own legs."""

    slug = "wrong-constant"
    setting_ranges = NO_SETTINGS
    driven_by = "constant"
    title = "A grossly wrong constant"
    formula = "parameter + value; all rails: u + tilt e, e from the rail to its leg's upper end"
    size = "anything: many times the drawing tolerance"
    look_alikes = ("actuator-scale", "platform-deformation", "thermal-expansion", "leg-compliance")
    experiment = "measure this dimension on the part, or read it off the drawing again with its unit and sign"
    source = "errors of drawings, units and assembly; no physics"

    def places(self, machine: Machine) -> Sequence[Place]:
        known = [p.name for p in machine.mechanism.parameters if p.free and isfinite(p.tolerance)]
        tilted = tuple(_tilts(machine))
        together = len(rails(machine)) > 1 and set(tilted) <= set(known)
        return [*singly(known), tilted] if together else singly(known)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if len(place) > 1:
            return (Coefficient("tilt", "1", LARGEST_ANGLE, -2 * LARGEST_ANGLE, 2 * LARGEST_ANGLE),)
        parameter = machine.geometry.get(place[0])
        if parameter is None:
            return (Coefficient("value", "1", LARGEST_ANGLE),)  # symbolic_model names the missing port
        scale = _largest(parameter, machine.nominal_values[parameter.name])
        bound = 2 * scale if parameter.unit == "1" else float("inf")
        return (Coefficient("value", parameter.unit, scale, -bound, bound),)

    def shifts(self, site: Site) -> Shifts:
        if len(site.place) == 1:
            return {site.place[0]: site.c["value"]}
        across = _tilts(site.machine)
        return {name: site.c["tilt"] * across.get(name, 0.0) for name in site.place}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if len(place) > 1:
            return "The actuator axes are tilted alike, towards (tilt > 0) or away from their own legs."
        element = element_of(place[0])
        if place[0] in _tilts(machine):
            return f"The actuator axis of {element} is tilted along {place[0][-1]}."
        return f"The constant {place[0]} of {element} is off its drawing by far more than its tolerance."


def _largest(parameter: Parameter, nominal: float) -> float:
    """A gross error of a parameter, in its own unit."""
    if parameter.part == "gain":
        return 2 * LARGEST_FRACTION * (abs(nominal) or 1.0)
    if parameter.unit != "mm":
        return LARGEST_ANGLE
    return max(LARGEST_FRACTION * abs(nominal), 100 * parameter.tolerance, 1.0)


def _tilts(machine: Machine) -> Mapping[str, float]:
    """Change of each rail component per unit of tilt: the leg's nominal direction, across its rail."""
    named = [pair for rail in rails(machine) for pair in zip(rail.components, rail.across, strict=True)]
    return {name: float(value) for name, value in named if name is not None}
