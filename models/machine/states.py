"""What an effect may ask of the machine's present state: directions and turns of joints, values that sensors see.

An effect gets a placeholder symbol for each; ``truepose.models.machine.kinematics`` puts the expression in its place.
Directions and turns are those of the machine without the effects (their change by an effect is of second order); what
sensors see includes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.machine.assembly import placed_frame, rod_ends, way_of
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Direction, Joint
from truepose.models.machine.view import View

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
    return (*ends, *(f"{TURN}{joint.name}" for joint in hinges(machine)), *seen_names(machine))


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


def seen_names(machine: Machine) -> tuple[str, ...]:
    """One state for each sensor column."""
    return tuple(f"{SEEN}{column}" for sensor in machine.sensors for column in sensor.columns)


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


__all__ = [
    "across",
    "asked",
    "directions",
    "hinges",
    "joint_ends",
    "put_in_place",
    "reading_shifts",
    "refuse_sight",
    "state_names",
]
