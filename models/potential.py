"""Potential energy of what pulls at a machine: the weight of masses, and springs and balancers between its bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from truepose.models.driver import PAYLOAD
from truepose.models.machine import Machine, Mass, Spring

Number = ca.SX | float


def energies(
    machine: Machine, frames: Mapping[str, ca.SX], z: Mapping[str, ca.SX], values: Mapping[str, ca.SX]
) -> dict[str, ca.SX]:
    """Of each load case, and of all stated masses and springs, N mm (only differences matter).

    ``frames`` (4, 4) are bodies and carried frames in the base; ``z`` drivers, ``values`` parameters by name.
    """
    out = {}
    down = ca.DM(machine.gravity or (0.0, 0.0, 0.0))
    for case in ("",) if machine.stated_loads else machine.load_cases:
        if case:  # 1 kg at the origin of a body
            out[case] = -ca.dot(down, frames[case.removesuffix("|")][:3, 3])
            continue
        out[case] = ca.SX(0)
        for mass in machine.masses if machine.weighs else ():
            kg, com = _mass(mass, z, values)
            out[case] -= kg * ca.dot(down, in_base(frames[mass.body], com))
        for spring in machine.springs:
            out[case] += _spring(spring, frames, values)
    return out


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


__all__ = ["Number", "energies", "in_base", "of_mass"]
