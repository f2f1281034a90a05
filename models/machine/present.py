"""The present state of a machine without effects, for effects that ask for it: directions of its axes, and what is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from truepose.errors import InputError
from truepose.models.machine.assembly import assemble
from truepose.models.machine.machine import Machine
from truepose.models.machine.states import asked, directions, put_in_place, refuse_sight


@dataclass(frozen=True)
class Present:
    """The state of the machine without effects, where they ask for it."""

    machine: Machine
    values: Mapping[str, ca.SX]
    q: Mapping[str, ca.SX]
    z: Mapping[str, ca.SX]
    x: ca.SX
    marks: Mapping[str, ca.SX]

    def directions(self) -> dict[str, ca.SX]:
        """The states ``axis.*``."""
        placed = assemble(self.machine, self.values, self.q, self.z, self.x)
        return directions(self.machine, placed.bodies, self.values)

    def in_place(self, shifted: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        """Port values with the directions that they ask for in place; only readings may depend on what is seen."""
        read = self.machine.ports_of("reading")
        moving = {name: v for name, v in shifted.items() if name not in read}
        names = asked(list(moving.values()), self.marks)
        if not names:
            return dict(shifted)
        refuse_sight(names, self.machine.name)
        if self.machine.mechanism.loops != "exact":
            raise InputError(
                f"{self.machine.name}: found an effect of joint directions on loops that close about home only "
                "(model: linear or stiffness), expected model: spherical or beam"
            )
        changed = [name for name, v in moving.items() if v is not self.values[name]]
        placed = put_in_place([moving[n] for n in changed], self.marks, self.directions())
        return dict(shifted) | dict(zip(changed, placed, strict=True))
