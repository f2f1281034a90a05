"""Loops that close near home only: to first order about the assembly there, or where elastic rods balance.

Both refer to the assembly at home, which depends on the parameters: its coordinates are unknowns too, closed by
the exact equations at the home readings, with the same drivers. ``truepose.models.machine.kinematics`` calls
``near_home`` for mechanisms whose ``loops`` are not exact.

An elastic rod between two bodies: flexure, bar, flexure in series, clamped at both ends.

The rod's straight, unstrained state is the one at home. The displacements of its far end against the near
end's rigid motion are six relative ones e, and the energy is e' F^-1 e / 2, F the flexibility of the chain as a
cantilever. That is the 12 x 12 stiffness of Gayral and Daney 2012 (INRIA RR-8096, eqs. 20 to 27, whose K12 and K21 are
printed with two wrong signs each) after its inner nodes are condensed, without forming it: sections are round,
so that only the rod's direction counts.

As in the report (eq. 28) the rod keeps the direction it has at home. What it stretches is then wrong by w^2/2l when
its ends move by w across each other; a rod that ``follows`` takes the change of their distance instead.
Motions are small all the same: rotations add as vectors. Forces N, lengths mm, energy N mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from truepose.errors import InputError
from truepose.models import lie
from truepose.models.machine.assembly import Assembly, assemble, rod_ends
from truepose.models.machine.closure import coordinate_scale, home_readings
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Rod

Segment = tuple[ca.SX, ...]
"""One straight piece of a chain: length (mm), bending EI (N mm^2), tension EA (N), torsion GJ (N mm^2)."""


def chain_energy(segments: Sequence[Segment], along: ca.SX, shift: ca.SX, turned: ca.SX) -> ca.SX:
    """N mm of ``shift`` (3,) and small rotation ``turned`` (3,) of a clamped chain's far end, ``along`` its unit vector.

    Cantilever formulae of each segment are carried to the far end and added: how far it goes by unit loads along the chain
    (``stretch`` mm/N, ``twist`` rad/(N mm)), and across it by a force (``tip`` mm/N, ``slope`` rad/N) and a moment (``turn``
    rad/(N mm)).
    """
    stretch = twist = tip = slope = turn = beyond = ca.SX(0)  # beyond: from a segment's end to the far end
    for length, bending, tension, torsion in reversed(segments):
        own_slope, own_turn = length**2 / (2 * bending), length / bending
        tip += length**3 / (3 * bending) + 2 * beyond * own_slope + beyond**2 * own_turn
        slope += own_slope + beyond * own_turn
        turn += own_turn
        stretch += length / tension
        twist += length / torsion
        beyond += length
    drawn, screwed = ca.dot(along, shift), ca.dot(along, turned)
    across, lean = shift - drawn * along, ca.cross(turned, along)
    determinant = tip * turn - slope**2
    bent = turn * ca.sumsqr(across) - 2 * slope * ca.dot(across, lean) + tip * ca.sumsqr(lean)
    return (drawn**2 / stretch + screwed**2 / twist + bent / determinant) / 2


def _moved(home: ca.SX, now: ca.SX, shift: ca.SX, beyond: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Displacement and small rotation of what a body holds ``beyond`` (3,) a point that moved by ``shift``."""
    turn = now[:3, :3] @ home[:3, :3].T
    return shift + (turn - ca.SX.eye(3)) @ beyond, lie.vee(turn)


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
    energy = sum((strain_energy(rod, home, now) for rod in rods), ca.SX(0))
    energy += now[1].energies.get("", 0)
    x = now[0].x
    natural = coordinate_scale(machine, 2 * x.numel(), 0).size[: x.numel()]
    stiffness = float(np.mean([rod.elastic.stiffness for rod in rods if rod.elastic is not None]))
    return now[1].still.slope(energy, x) * ca.DM(natural / (natural.max() * stiffness))


def strain_energy(rod: Rod, home: tuple[Stance, Assembly], now: tuple[Stance, Assembly]) -> ca.SX:
    """Energy (N mm) of an elastic rod since home, where it was unstrained.

    The flexures' middles are where ball joints would be: each reaches half its length beyond (eq. 22).
    """
    chain = rod.elastic
    if chain is None or rod.length is None:
        raise InputError(
            f"rod {rod.name!r}: found a rigid rod among elastic ones, expected all of them elastic"
        )
    values, (was, bodies) = home[0].values, (home[1].bodies, now[1].bodies)
    length, grown = (stance.values[rod.length] for stance, _ in (home, now))
    flexure = values[chain.flexure_length]
    (home_a, home_b), (now_a, now_b) = (rod_ends(rod, a.bodies, s.values) for s, a in (home, now))
    along = home_b - home_a
    along = along / ca.norm_2(along)
    half = flexure / 2 * along
    shift_a, turn_a = _moved(was[rod.body_a], bodies[rod.body_a], now_a - home_a, -half)
    shift_b, turn_b = _moved(was[rod.body_b], bodies[rod.body_b], now_b - home_b, half)
    carried = shift_a + ca.cross(turn_a, (length + flexure) * along)
    joint, bar = (tuple(values[name] for name in part) for part in (chain.flexure, chain.bar))
    shift = shift_b - carried
    if chain.follows:
        apart = ca.norm_2(now_b - now_a) - ca.norm_2(home_b - home_a)
        shift += (apart - ca.dot(along, shift)) * along
    segments = [(flexure, *joint), (length - flexure, *bar), (flexure, *joint)]
    return chain_energy(segments, along, shift - (grown - length) * along, turn_b - turn_a)
