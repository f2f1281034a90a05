"""A machine assembled at home, in numbers: where all bodies, joints and rods stand. It may have closed loops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.export.tree import check_links
from truepose.models.machine.assembly import (
    assemble,
    axis_of,
    frame_of,
    placed_frame,
    rod_ends,
    tool_on_flange,
)
from truepose.models.machine.kinematics import assembled_home, symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Joint


@dataclass(frozen=True)
class Standing:
    """Poses (4, 4) mm in the nominal frame of the base: ``bodies``, and ``joints`` before their motion, by name.

    ``axes`` (3,) are directions of joints in their own frames, ``rods`` the ball centres (3,) of rods, ``readings`` those of
    home, ``tool`` the tool in its flange, ``world`` the base in the sensor's frame. ``gap`` (mm) is what loops lack that cannot
    close: those with more equations than coordinates, as built.
    """

    bodies: Mapping[str, Array]
    joints: Mapping[str, Array]
    axes: Mapping[str, Array]
    rods: Mapping[str, tuple[Array, Array]]
    readings: Mapping[str, float]
    tool: Array
    world: Array
    gap: float


def standing(machine: Machine, values: Mapping[str, float], what: str) -> Standing:
    """The machine with these ``values`` of parameters and ports (mm, rad) at home.

    Raises InputError, which ``what`` (the format) opens, for what no rigid bodies and ideal joints are.
    """
    _check(machine, values, what)
    model = symbolic_model(machine, (), ports=True)
    p = np.array([values[name] for name in model.names])
    x = assembled_home(replace(model, p_home=p)) if len(model.home) else model.home
    constants = {name: ca.SX(value) for name, value in values.items()}
    q = {
        name: ca.SX(v) for name, v in zip(model.readings, model.q_home.tolist(), strict=True)
    }  # none is coupled
    z = {name: ca.SX(v) for name, v in zip(model.drivers, model.z_home.tolist(), strict=True)}
    unknown = ca.SX.sym("x", len(x))
    built = assemble(machine, constants, q, z, unknown)

    def number(expression: ca.SX) -> Array:
        return np.array(ca.Function("at", [unknown], [expression])(x).full(), dtype=float)

    mechanism = machine.mechanism
    moving: tuple[Joint, ...] = (*mechanism.tree, *mechanism.closing)
    along = [joint for joint in moving if joint.kind in ("revolute", "prismatic")]
    rods = {rod.name: rod_ends(rod, built.bodies, constants) for rod in mechanism.rods}
    return Standing(
        {name: number(pose) for name, pose in built.bodies.items()},
        {joint.name: number(placed_frame(joint, built.bodies, constants)) for joint in moving},
        {joint.name: number(axis_of(joint, constants)).ravel() for joint in along},
        {name: (number(a).ravel(), number(b).ravel()) for name, (a, b) in rods.items()},
        dict(zip(model.readings, model.q_home.tolist(), strict=True)),
        number(tool_on_flange(constants)),
        number(frame_of(constants, "base")),
        float(np.max(np.abs(number(built.gap)), initial=0.0)),
    )


def _check(machine: Machine, values: Mapping[str, float], what: str) -> None:
    mechanism = machine.mechanism
    if mechanism.loops != "exact" or any(rod.flexures or rod.elastic for rod in mechanism.rods):
        raise InputError(
            f"{machine.name}: found loops of flexures, expected ideal joints: {what} holds no joint that bends"
        )
    check_links(machine, values, what)
    if mechanism.followers:
        raise InputError(
            f"{machine.name}: joint {mechanism.followers[0].joint!r}: found a joint that follows others in a machine with "
            f"loops, expected none for {what}"
        )
