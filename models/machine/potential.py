"""Energy of what pulls at a machine: the weight of masses, springs and balancers between its bodies, measured forces.

A measured force has no energy, but work: force times small motion, moment times small turn. That is the energy of a force
and moment which stand still in the base while the machine is varied. `Still` holds them: symbols while derivatives are taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from truepose.models import lie
from truepose.models.file.driver import PAYLOAD
from truepose.models.file.force_section import FORCE
from truepose.models.machine.machine import WEIGHT, Machine, Mass, MeasuredForce, Spring

Number = ca.SX | float
MM_PER_M = 1000.0


@dataclass(frozen=True)
class Still:
    """What does not vary with the machine: symbols (k,), and what they are at present (k,)."""

    symbols: ca.SX
    present: ca.SX

    def slope(self, energy: ca.SX, by: ca.SX) -> ca.SX:
        """Gradient of an energy by ``by``, a column, with the present in place."""
        gradient = ca.gradient(energy, by)
        if not self.symbols.numel():
            return gradient
        placed: ca.SX = ca.substitute(gradient, self.symbols, self.present)
        return placed


def energies(
    machine: Machine, frames: Mapping[str, ca.SX], z: Mapping[str, ca.SX], values: Mapping[str, ca.SX]
) -> tuple[dict[str, ca.SX], Still]:
    """Of each load case, and of all stated masses and springs, N mm (only differences matter); with what stands still in it.

    ``frames`` (4, 4) are bodies and carried frames in the base; ``z`` drivers, ``values`` parameters by name.
    """
    down = ca.DM(machine.gravity or (0.0, 0.0, 0.0))
    if not machine.stated_loads:  # 1 kg at the origin of a body
        probes = {case: frames[case.removesuffix("|")][:3, 3] for case in machine.load_cases}
        return {case: -ca.dot(down, at) for case, at in probes.items()}, _still([])
    weight = ca.SX(0)
    carried = [own for own in machine.equipment if own.mass is not None]
    others = 1 - sum((z.get(own.driver, ca.SX(0)) for own in carried), ca.SX(0)) if carried else 1
    for mass in machine.masses if machine.weighs else ():
        kg, com = _mass(mass, z, values)
        kg *= others if mass.name == PAYLOAD else 1
        weight -= kg * ca.dot(down, in_base(frames[mass.body], com))
    for own in carried if machine.weighs else ():
        assert own.mass is not None
        kg, com = of_mass(own.mass, values)
        here = z.get(own.driver, ca.SX(0)) * kg
        weight -= here * ca.dot(down, in_base(frames[own.mass.body], com))
    pulling = [_spring(spring, frames, values) for spring in machine.springs]
    pushing = [_work(force, frames, z) for force in machine.forces]
    whole = sum((*pulling, *(-work for work, _ in pushing)), weight)
    alone = {WEIGHT: weight} if machine.weight_case else {}
    return {"": whole, **alone}, _still([still for _, still in pushing])


def _work(force: MeasuredForce, frames: Mapping[str, ca.SX], z: Mapping[str, ca.SX]) -> tuple[ca.SX, Still]:
    """Work (N mm) of the present force F and moment M, which stand still: F . p + M . turn, in the base.

    The turn from the present R0 is ``vee(R R0')``; M . vee(R R0') is the sum of products of R with ``skew(M) R0 / 2``.
    """
    frame, axes = frames[force.body], frames[force.axes][:3, :3]
    read = [force.sign * z.get(column, ca.SX(0)) for column in force.columns]
    present = axes @ ca.vertcat(*read[:FORCE])
    still = ca.SX.sym(f"force.{force.name}", 3)
    work = ca.dot(still, in_base(frame, force.at))
    if len(read) == FORCE:
        return work, Still(still, present)
    turned = lie.skew(MM_PER_M * (axes @ ca.vertcat(*read[FORCE:]))) @ frame[:3, :3] / 2
    turning = ca.SX.sym(f"moment.{force.name}", 3, 3)
    work += ca.dot(turning, frame[:3, :3])
    return work, Still(ca.vertcat(still, ca.vec(turning)), ca.vertcat(present, ca.vec(turned)))


def _still(parts: Sequence[Still]) -> Still:
    none = ca.SX(0, 1)
    return Still(
        ca.vertcat(none, *(part.symbols for part in parts)),
        ca.vertcat(none, *(part.present for part in parts)),
    )


def _mass(mass: Mass, z: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> tuple[Number, Sequence[Number]]:
    """kg and centre (3,), mm: a payload's kg is the recorded one and what an unknown one differs from its nominal by."""
    kg, com = of_mass(mass, values)
    if mass.name == PAYLOAD and PAYLOAD in z:
        kg = z[PAYLOAD] + (kg - mass.kg) if mass.parameters else z[PAYLOAD]
    return kg, com


def of_mass(mass: Mass, values: Mapping[str, ca.SX]) -> tuple[Number, Sequence[Number]]:
    """kg and centre (3,), mm, as the parameters have them where they are not exactly known."""
    if not mass.parameters:
        return mass.kg, mass.com
    kg, *com = (values[parameter.name] for parameter in mass.parameters)
    return kg, com


def _spring(spring: Spring, frames: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> ca.SX:
    """force l + stiffness (l - free length)^2 / 2, l the distance of its ends."""
    (a, at_a), (b, at_b) = spring.ends
    length = ca.norm_2(in_base(frames[b], at_b) - in_base(frames[a], at_a))
    own = [values.get(f"{spring.name}.{name}", ca.SX(value)) for name, value in spring.constants.items()]
    force, stiffness, free = own
    return force * length + stiffness * (length - free) ** 2 / 2


def in_base(frame: ca.SX, at: Sequence[Number]) -> ca.SX:
    """(3,) a point of a frame (4, 4) where the frame stands."""
    return frame[:3, :3] @ ca.vertcat(*(ca.SX(v) for v in at)) + frame[:3, 3]


__all__ = ["Number", "Still", "energies", "in_base", "of_mass"]
