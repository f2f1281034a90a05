"""What a machine's expressions are functions of: readings, drivers, constants, and the unknowns of its loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.assembly import symbols
from truepose.models.machine.couplings import own_motions
from truepose.models.machine.equipment import with_own_tools
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import COORDINATES
from truepose.models.machine.placed import PlacedEffect


@dataclass(frozen=True)
class Variables:
    """Symbols of a machine with effects, by name where they have one.

    q, z            readings, drivers
    theta           parameters
    c               coefficients, of each effect
    bare            ports, where these are variables too
    x (nx,)         passive coordinates, then those at home where loops close about home only
    """

    machine: Machine
    effects: tuple[PlacedEffect, ...]
    q: Mapping[str, ca.SX]
    z: Mapping[str, ca.SX]
    theta: Mapping[str, ca.SX]
    c: tuple[Mapping[str, ca.SX], ...]
    bare: Mapping[str, ca.SX]
    x: ca.SX

    @classmethod
    def of(
        cls, machine: Machine, effects: Sequence[PlacedEffect], drivers: Sequence[str], *, ports: bool
    ) -> Variables:
        """New symbols; with ``ports`` for every port too."""
        size = sum(COORDINATES[joint.kind] for joint in machine.mechanism.unknown)
        return cls(
            machine=machine,
            effects=tuple(effects),
            q=symbols("q", machine.mechanism.readings),
            z=symbols("z", drivers),
            theta=symbols("", [p.name for p in machine.parameters]),
            c=tuple(symbols(f"c{k}_", list(effect.values)) for k, effect in enumerate(effects)),
            bare=symbols("", [*machine.ports] if ports else []),
            x=ca.SX.sym("x", size) if size else ca.SX(0, 1),
        )

    @property
    def moved(self) -> dict[str, ca.SX]:
        """Own motions of the joints by name, in the units of their readings."""
        return own_motions(self.machine.mechanism, self.q)

    @property
    def p(self) -> ca.SX:
        """(np,) parameters, coefficients, ports."""
        coefficients = (symbol for own in self.c for symbol in own.values())
        return ca.vertcat(*self.theta.values(), *coefficients, *self.bare.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of ``p``."""
        coefficients = (name for effect in self.effects for name in effect.parameter_names)
        return (*self.theta, *coefficients, *self.bare)

    @property
    def p_home(self) -> Array:
        """(np,) ``p`` as the machine file has it."""
        coefficients = (value for effect in self.effects for value in effect.values.values())
        nominal = (parameter.nominal for parameter in self.machine.parameters)
        return np.array([*nominal, *coefficients, *(0.0 for _ in self.bare)])

    @property
    def home(self) -> Array:
        """(nx,) where the solution for ``x`` starts."""
        unknown = self.machine.mechanism.unknown
        return np.array([v for j in unknown for v in j.home or (0.0,) * COORDINATES[j.kind]], dtype=float)

    @property
    def now_and_home(self) -> tuple[ca.SX, ca.SX]:
        """Passive coordinates, and those of the assembly at home where the closure refers to it (else none)."""
        n = sum(COORDINATES[joint.kind] for joint in self.machine.mechanism.passive)
        return self.x[:n], self.x[n:]

    def values(self, *, weighed: bool) -> dict[str, ca.SX]:
        """Values of parameters and ports without effects, by name; the payload's mass is constant where it is ``weighed``."""
        machine, mass = self.machine, f"{PAYLOAD}.kg"
        values = {**self.theta, **{name: self.bare.get(name, ca.SX(0)) for name in machine.ports}}
        if weighed and mass in values:
            values[mass] = ca.SX(machine.geometry[mass].nominal)
        return with_own_tools(machine, values, self.z)
