"""Loads at ports: minus the derivative of the energy of weights, springs and measured forces, through closed loops too."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import casadi as ca

from truepose.models.machine.assembly import assemble, symbols
from truepose.models.machine.machine import Machine
from truepose.models.machine.potential import MM_PER_M, Still


@dataclass(frozen=True)
class Statics:
    """Potential (N mm) of all loads as a function of the ports, which are symbols of their own.

    In closed loops ``forces`` are the closure's multipliers, unknowns that ``balance`` determines.
    """

    machine: Machine
    ports: Mapping[str, ca.SX]
    x: ca.SX
    forces: ca.SX
    potentials: Mapping[str, ca.SX]
    still: Still

    @classmethod
    def of(
        cls,
        machine: Machine,
        names: Iterable[str],
        q: Mapping[str, ca.SX],
        z: Mapping[str, ca.SX],
        x: ca.SX,
    ) -> Statics:
        """Potential of a machine whose ports are ``names``."""
        ports = symbols("u", list(names))
        raw = assemble(machine, ports, q, z, x)
        count = raw.closure.numel()
        forces = ca.SX.sym("force", count) if count else ca.SX(0, 1)
        work = ca.dot(forces, raw.closure)
        potentials = {case: energy + work for case, energy in raw.energies.items()}
        return cls(machine, ports, x, forces, potentials, raw.still)

    def loads(self, values: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        """Conjugate load of every port, by load case and name: N along lengths, N m about angles."""
        out: dict[str, ca.SX] = {}
        for case, potential in self.potentials.items():
            force = self._at(values, -self.still.slope(potential, ca.vertcat(*self.ports.values())))
            out |= {
                f"{case}{name}": force[k] / load_scale(self.machine, name)
                for k, name in enumerate(self.ports)
            }
        return out

    def balance(self, values: Mapping[str, ca.SX]) -> ca.SX:
        """(nx,) zero when the forces hold the passive coordinates where they are."""
        if not self.forces.numel():
            return self.forces
        return self._at(values, self.still.slope(self.potentials[""], self.x))

    def _at(self, values: Mapping[str, ca.SX], expression: ca.SX) -> ca.SX:
        symbols = ca.vertcat(*self.ports.values())
        out: ca.SX = ca.substitute(expression, symbols, ca.vertcat(*(values[name] for name in self.ports)))
        return out


def load_scale(machine: Machine, port: str) -> float:
    """Factor from the unit of a load at a port (N along lengths, N m about angles) to N mm per mm or rad of the port."""
    return MM_PER_M if machine.unit_of(port) == "rad" else 1.0
