"""Constants of the machine, scales of its readings and couplings of its joints that are wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations
from math import isfinite

from truepose.errors import InputError
from truepose.models.effects.base import (
    NO_SETTINGS,
    Coefficient,
    Effect,
    Place,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.effects.common import actuator_at, joint_unit, rails, singly, singly_and_together
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Parameter, element_of


@effects.add("actuator-scale")
class ActuatorScale(Effect):
    """A scale factor that is off: every reading means a little more or less than it says.

    The reading q becomes (1 + s) q before the offset is added; one joint, or all of a kind alike.
    """

    slug = "actuator-scale"
    setting_ranges = NO_SETTINGS
    title = "Scale error of an actuator or its encoder"
    counted = True
    formula = "q -> (1 + s) q, before the offset is added"
    size = "10 to 100 ppm for a good scale or screw; a wrong gain reaches percents"
    look_alikes = ("wrong-constant", "platform-deformation", "axis-coupling", "thermal-expansion")
    experiment = "step this joint alone through its travel against an interferometer or a length gauge"
    source = "positioning tests of linear and rotary axes, ISO 230-2"

    def places(self, machine: Machine) -> Sequence[Place]:
        places = singly(machine.mechanism.readings)
        for unit in ("mm", "rad"):
            alike = [a.reading for a in machine.mechanism.actuators if a.unit == unit]
            places += singly_and_together(alike)[len(alike) :]
        return places

    def screened(self, machine: Machine, place: Place) -> bool:
        # where the drawing leaves the gain open it is a constant of the machine: see wrong-constant
        open_gain = {p.name for p in machine.mechanism.parameters if p.part == "gain" and p.free}
        return not any(actuator_at(machine, name).gain in open_gain for name in place)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("s", "1", scale=0.1, lower=-0.1, upper=0.1),)

    def shifts(self, site: Site) -> Shifts:
        actuators = [actuator_at(site.machine, name) for name in site.place]
        return {a.displacement: site.c["s"] * site.moved(a.reading) for a in actuators}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if len(place) > 1:
            return f"The readings of {', '.join(place)} share one scale error: all err in proportion."
        what = "turns" if joint_unit(machine, place) == "rad" else "travels"
        return f"Joint {place[0]} {what} in proportion more (s > 0) or less (s < 0) than its reading says."


LARGEST = {"1": 0.02, "mm/rad": 5.0, "rad/mm": 1e-3}
BETWEEN_LEGS = 0.1
"""How likely a leg is dragged along by another, in terms of joints whose gear trains or guides may meet."""


@effects.add("axis-coupling")
class AxisCoupling(Effect):
    """One joint that is dragged along by another.

    Place (driven, driving): the driven joint moves by k times what the other's reading moves it.
    """

    slug = "axis-coupling"
    setting_ranges = NO_SETTINGS
    driven_by = "coupling"
    title = "Coupling between two axes"
    sentence = "Joint {0} is dragged along in proportion when joint {1} moves."
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


LARGEST_ANGLE = 0.2
LARGEST_FRACTION = 0.1


@effects.add("wrong-constant")
class WrongConstant(Effect):
    """A constant that is grossly wrong: a misread drawing, a unit, a sign, an axis mounted askew.

    One parameter far outside its tolerance; or the rails of all legs tilted alike along their own legs.
    """

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
