"""Loops that close near home only: to first order about the assembly there, or where elastic rods balance.

Both refer to the assembly at home, which depends on the parameters: its coordinates are unknowns too, closed by
the exact equations at the home readings, with the same drivers. ``truepose.models.machine.kinematics`` calls
``near_home`` for mechanisms whose ``loops`` are not exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from truepose.errors import InputError
from truepose.models.machine.assembly import Assembly, assemble, rod_ends
from truepose.models.machine.elastic import Ends, strain_energy
from truepose.models.machine.home import coordinate_scale, home_readings
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Rod


@dataclass(frozen=True)
class Stance:
    """What an assembly is made of: values of ports, joints' own motions ``q`` (column units), passive coordinates ``x``.

    ``readings`` are the symbols that all this is expressed in.
    """

    values: Mapping[str, ca.SX]
    q: Mapping[str, ca.SX]
    x: ca.SX
    readings: tuple[ca.SX, ...]

    def at_home(self, machine: Machine, x: ca.SX) -> Stance:
        """The same values at the home readings, with the passive coordinates ``x``."""
        home = ca.DM(home_readings(machine.mechanism))
        now = ca.vertcat(*self.q.values(), *self.values.values())
        moved = ca.vertsplit(ca.substitute(now, ca.vertcat(*self.readings), home))
        q, values = moved[: len(self.q)], moved[len(self.q) :]
        return Stance(
            dict(zip(self.values, values, strict=True)), dict(zip(self.q, q, strict=True)), x, self.readings
        )

    def assembled(self, machine: Machine, z: Mapping[str, ca.SX]) -> Assembly:
        """The bodies placed."""
        return assemble(machine, self.values, self.q, z, self.x)


def near_home(machine: Machine, now: Stance, x_home: ca.SX, z: Mapping[str, ca.SX]) -> Assembly:
    """The assembly with the closure of ``now.x`` (nx,), then that of ``x_home`` (nx,); gap: the first of them, mm."""
    home = now.at_home(machine, x_home)
    here, there = now.assembled(machine, z), home.assembled(machine, z)
    if machine.mechanism.loops == "linear":
        loops = _to_first_order(machine, home, now, z)
    else:
        loops = _out_of_balance(machine, (home, there), (now, here))
    return replace(here, closure=ca.vertcat(loops, there.closure), gap=loops)


def _to_first_order(machine: Machine, home: Stance, now: Stance, z: Mapping[str, ca.SX]) -> ca.SX:
    """The closure's derivative at home along the straight way from home to now: zero in the linear model.

    For a hexapod that is J^-1 (X - X0) = rho - rho0 (Gayral and Daney 2012, eq. 9), X a position and modified
    Rodrigues parameters. Effects shift readings and ports by their exact amounts, and act to first order.
    """
    way = ca.SX.sym("way")
    between = Stance(
        {name: v + way * (now.values[name] - v) for name, v in home.values.items()},
        {name: v + way * (now.q[name] - v) for name, v in home.q.items()},
        home.x + way * (now.x - home.x),
        now.readings,
    )
    slope = ca.jacobian(between.assembled(machine, z).closure, way)
    first: ca.SX = ca.substitute(slope, way, 0)
    return first


def _out_of_balance(machine: Machine, home: tuple[Stance, Assembly], now: tuple[Stance, Assembly]) -> ca.SX:
    """(nx,) slope of the rods' strain energy and of the loads' by every passive coordinate, as mm of rod.

    It is the balance of wrenches of every free body (Gayral and Daney 2012, eq. 19), moments transported by the
    chain rule.
    """
    rods = machine.mechanism.rods
    energy = sum((_strain(rod, home, now) for rod in rods), ca.SX(0))
    energy += now[1].energies.get("", 0)
    x = now[0].x
    natural = coordinate_scale(machine, 2 * x.numel(), 0).size[: x.numel()]
    stiffness = float(np.mean([rod.elastic.stiffness for rod in rods if rod.elastic is not None]))
    return now[1].still.slope(energy, x) * ca.DM(natural / (natural.max() * stiffness))


def _strain(rod: Rod, home: tuple[Stance, Assembly], now: tuple[Stance, Assembly]) -> ca.SX:
    """Strain energy of a rod, N mm."""
    if rod.elastic is None or rod.length is None:
        raise InputError(
            f"rod {rod.name!r}: found a rigid rod among elastic ones, expected all of them elastic"
        )
    length, grown = (stance.values[rod.length] for stance, _ in (home, now))
    return strain_energy(
        rod.elastic, _ends(rod, home), _ends(rod, now), length, grown - length, home[0].values
    )


def _ends(rod: Rod, placed: tuple[Stance, Assembly]) -> Ends:
    stance, assembly = placed
    points = rod_ends(rod, assembly.bodies, stance.values)
    return Ends(assembly.bodies[rod.body_a], assembly.bodies[rod.body_b], *points)
