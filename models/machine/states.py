"""What an effect may ask of the machine's present state: directions and turns of joints, values that sensors see.

An effect gets a placeholder symbol for each; ``truepose.models.machine.kinematics`` puts the expression in its place.
Directions and turns are those of the machine without the effects (their change by an effect is of second order); what
sensors see includes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.assembly import assemble, placed_frame, rod_ends, symbols, way_of
from truepose.models.machine.loads import with_own_tools
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import COORDINATES, Direction, Joint, own_motions
from truepose.models.machine.placed import PlacedEffect
from truepose.models.machine.sensor import View

_XYZ = ("x", "y", "z")
SEEN = "seen."
AXIS = "axis."
TURN = "turn."


def state_names(machine: Machine) -> tuple[str, ...]:
    """Names of all states.

    ``axis.J.x`` (y, z): unit vector along z of the child of passive joint J in the joint's own frame;
    ``axis.R.a.x`` and ``axis.R.b.x``: unit vector from end a to end b of rod R in the frame of its body a or b;
    ``turn.J``: angle of passive revolute joint J, rad;
    ``seen.C``: what column C of a sensor should read (mm, rad; the length itself where a reading is its change).
    """
    ends = [f"{AXIS}{end}.{k}" for end in joint_ends(machine) for k in _XYZ]
    return (
        *ends,
        *(f"{TURN}{joint.name}" for joint in hinges(machine)),
        *(f"{SEEN}{column}" for sensor in machine.sensors for column in sensor.columns),
    )


def joint_ends(machine: Machine) -> tuple[str, ...]:
    """Universal and spherical joints by name, and both ends ``R.a``, ``R.b`` of rods on ball joints."""
    mechanism = machine.mechanism
    bent = [j.name for j in mechanism.joints if j.kind in ("universal", "spherical")]
    return (*bent, *mechanism.rod_ends)


def hinges(machine: Machine) -> tuple[Joint, ...]:
    """Passive revolute joints about a constant axis."""
    driven = machine.mechanism.driven
    turning = (j for j in machine.mechanism.joints if j.kind == "revolute" and j.name not in driven)
    return tuple(j for j in turning if not isinstance(j.axis, Direction))


def across(axis: ArrayLike) -> tuple[Array, Array]:
    """Two unit vectors (3,) across a unit vector (3,) that make a right-handed frame with it."""
    along = np.asarray(axis, dtype=float)
    u = np.eye(3)[np.argmin(np.abs(along))]
    u = u - (u @ along) * along
    u /= np.linalg.norm(u)
    return u, np.cross(along, u)


def directions(
    machine: Machine, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX]
) -> dict[str, ca.SX]:
    """Expressions of the states ``axis.*`` and ``turn.*`` for placed bodies (4, 4) in the base frame."""
    out: dict[str, ca.SX] = {}
    for joint in machine.mechanism.joints:
        if joint.kind in ("universal", "spherical"):
            turn = placed_frame(joint, bodies, values)[:3, :3].T @ bodies[joint.child][:3, :3]
            out |= _components(joint.name, turn[:, 2])
    for rod in machine.mechanism.rods:
        a, b = rod_ends(rod, bodies, values)
        along = (b - a) / ca.norm_2(b - a)
        out |= _components(f"{rod.name}.a", bodies[rod.body_a][:3, :3].T @ along)
        out |= _components(f"{rod.name}.b", bodies[rod.body_b][:3, :3].T @ along)
    return out | {f"{TURN}{j.name}": _turned(j, bodies, values) for j in hinges(machine)}


def _turned(joint: Joint, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> ca.SX:
    """Angle (rad) of a child about its joint's axis, whichever way round the loops the child was placed."""
    assert not isinstance(joint.axis, Direction)
    u, v = (ca.DM(w) for w in across(joint.axis))
    carried = placed_frame(joint, bodies, values)[:3, :3].T @ bodies[joint.child][:3, :3] @ u
    return ca.atan2(ca.dot(v, carried), ca.dot(u, carried))


def _components(name: str, vector: ca.SX) -> dict[str, ca.SX]:
    return {f"{AXIS}{name}.{k}": vector[i] for i, k in enumerate(_XYZ)}


def reading_shifts(
    machine: Machine,
    worlds: Mapping[View, ca.SX],
    plain: Mapping[str, ca.SX],
    shifted: Mapping[str, ca.SX],
    q: Mapping[str, ca.SX],
) -> tuple[ca.SX, dict[str, ca.SX]]:
    """(k,) what is added to the columns of all sensors, in order: by effects, and by the joints that a column reads; and the
    states ``seen.*``.

    ``worlds`` are poses (4, 4) by view. ``plain`` and ``shifted`` are values of parameters and ports without and with the
    effects' shifts, ``q`` the readings. Effects at a sensor's own parameters act through what it would read with them.
    """
    parts, seen = [], {}
    for sensor in machine.sensors:
        own, world = [*(p.name for p in sensor.parameters), *sensor.reads], worlds[sensor.view]
        now = sensor.predict(world, {name: shifted[name] for name in own})
        moved = any(shifted[name] is not plain[name] for name in own)
        without = sensor.predict(world, {name: plain[name] for name in own}) if moved else now
        shift = now - without if moved else ca.SX.zeros(len(sensor.columns))
        for k, column in enumerate(sensor.columns):
            way = way_of(machine, sensor.joints[column], shifted, q) if column in sensor.joints else 0
            seen[f"{SEEN}{column}"] = now[k] + way
            shift[k] += way
            if f"{column}.reading" in shifted:
                shift[k] += shifted[f"{column}.reading"]
        parts.append(shift)
    return ca.vertcat(*parts), seen


def put_in_place(
    expressions: Sequence[ca.SX], marks: Mapping[str, ca.SX], states: Mapping[str, ca.SX]
) -> list[ca.SX]:
    """The expressions with placeholders replaced by states."""
    names = list(states)
    stacked = ca.vertcat(*expressions)
    done = ca.substitute(
        stacked, ca.vertcat(*(marks[n] for n in names)), ca.vertcat(*(states[n] for n in names))
    )
    return list(ca.vertsplit(done))


def asked(expressions: Sequence[ca.SX], marks: Mapping[str, ca.SX]) -> set[str]:
    """Names of the states that expressions contain."""
    symbols = {symbol.name() for symbol in ca.symvar(ca.vertcat(*expressions))}
    return {name for name, mark in marks.items() if mark.name() in symbols}


def refuse_sight(names: set[str], where: str) -> None:
    """Raise InputError where what a sensor sees would move the machine."""
    seen = sorted(name for name in names if name.startswith(SEEN))
    if seen:
        raise InputError(
            f"{where}: found a shift of the machine that depends on {seen[0]!r}, "
            "expected what a sensor sees to shift readings only"
        )


@dataclass(frozen=True)
class Variables:
    """Symbols of a machine with effects, by name where they have one.

    q, z            readings, drivers
    theta           parameters
    c               coefficients, of each effect
    bare            ports, where these are variables too
    x (nx,)         passive coordinates, then those at home where loops close about home only
    marks           placeholders of the states that effects may ask for
    weighed         whether the payload's mass is recorded row by row, so that its constant plays no part
    """

    machine: Machine
    effects: tuple[PlacedEffect, ...]
    q: Mapping[str, ca.SX]
    z: Mapping[str, ca.SX]
    theta: Mapping[str, ca.SX]
    c: tuple[Mapping[str, ca.SX], ...]
    bare: Mapping[str, ca.SX]
    x: ca.SX
    marks: Mapping[str, ca.SX]
    weighed: bool

    @classmethod
    def of(
        cls,
        machine: Machine,
        effects: Sequence[PlacedEffect],
        drivers: Sequence[str],
        *,
        ports: bool,
        weighed: bool,
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
            marks=symbols("state.", state_names(machine)),
            weighed=weighed,
        )

    @cached_property
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

    @cached_property
    def now_and_home(self) -> tuple[ca.SX, ca.SX]:
        """Passive coordinates, and those of the assembly at home where the closure refers to it (else none)."""
        n = sum(COORDINATES[joint.kind] for joint in self.machine.mechanism.passive)
        return self.x[:n], self.x[n:]

    @cached_property
    def values(self) -> dict[str, ca.SX]:
        """Values of parameters and ports without effects, by name; the payload's mass is constant where it is ``weighed``."""
        machine, mass = self.machine, f"{PAYLOAD}.kg"
        values = {**self.theta, **{name: self.bare.get(name, ca.SX(0)) for name in machine.ports}}
        if self.weighed and mass in values:
            values[mass] = ca.SX(machine.geometry[mass].nominal)
        return with_own_tools(machine, values, self.z)

    def directions(self) -> dict[str, ca.SX]:
        """The states ``axis.*`` and ``turn.*`` of the machine without effects."""
        placed = assemble(self.machine, self.values, self.moved, self.z, self.now_and_home[0])
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
