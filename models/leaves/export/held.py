"""Which effects rigid links can hold, and what is lost with the others.

An effect that shifts parameters and ports by constants (a wrong constant, a mount moved between sessions) is geometry
and goes into the links. One that follows a driver is held as it is at the driver's default; one that follows the
joints or their loads is left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.leaves.export.links import Tree
from truepose.models.machine.assembly import symbols
from truepose.models.machine.effect import Site
from truepose.models.machine.kinematics import driver_default, symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import PlacedEffect
from truepose.models.machine.states import state_names

SAMPLES = 64
"""Poses at which the size of what is left out is looked for."""
_SEED = 1
_HALF = {"rad": math.radians(150.0), "mm": 100.0}
"""Where a joint without a range is sampled: this far on both sides of zero."""


@dataclass(frozen=True)
class Held:
    """Values of parameters and ports (mm, rad) with the constant shifts of effects in them.

    ``frozen`` are labels of effects, and of tools, held at the defaults of their drivers (by name), ``left`` the effects that
    are left out.
    """

    values: Mapping[str, float]
    frozen: Mapping[str, Mapping[str, float]]
    left: tuple[PlacedEffect, ...]


def held(machine: Machine) -> Held:
    """Return what constant values can hold of a machine's effects."""
    drawn = {p.name: p.nominal for p in machine.parameters} | dict.fromkeys(machine.ports, 0.0)
    values = dict(drawn)
    moving = {p.name for p in (*machine.mechanism.parameters, *machine.frames)}
    moving |= set(machine.ports_of("displacement", "motion"))
    frozen, left = held_tools(machine), []
    for placed in machine.effects:
        shifts = None if placed.needs_load else _constant_shifts(machine, placed, drawn, moving)
        if shifts is None:
            left.append(placed)
            continue
        for port, shift in shifts.items():
            values[port] += shift
        if placed.drivers and shifts:
            frozen[placed.label] = {name: driver_default(machine, name) for name in placed.drivers}
    return Held(values, frozen, tuple(left))


def held_tools(machine: Machine) -> dict[str, Mapping[str, float]]:
    """Return the drivers at which the tool is that of ``frames``, by tool of the section ``recordings``."""
    tools = [own for own in machine.equipment if own.tool]
    return {f"recordings.{own.name}.tool": {own.driver: driver_default(machine, own.driver)} for own in tools}


def losses(machine: Machine, tree: Tree, left: Sequence[PlacedEffect]) -> tuple[dict[str, float], float]:
    """Return the largest change of the tool's position (mm) by each effect left out, and by all of them.

    The machine with its effects, drivers at their defaults, is compared with its rigid links at ``SAMPLES`` poses.
    """
    if not left:
        return {}, 0.0
    model = symbolic_model(machine, machine.effects)
    position = ca.Function("position", [model.q, model.z, model.p], [model.pose[:3, 3]])
    rows = sample_readings(machine)

    def at(p: Array) -> Array:
        return np.array([np.array(position(q, model.z_home, p)).ravel() for q in rows])

    of_effect = {e.label: np.isin(model.names, e.parameter_names) for e in left}
    bare = np.where(np.any(list(of_effect.values()), axis=0), 0.0, model.p_home)
    rigid = at(bare)
    each = {
        label: _largest(at(np.where(own, model.p_home, bare)) - rigid) for label, own in of_effect.items()
    }
    linked = [tree.pose(dict(zip(model.readings, q, strict=True)))[:3, 3] for q in rows.tolist()]
    return each, _largest(at(model.p_home) - np.array(linked))


def sample_readings(machine: Machine) -> Array:
    """Return readings (n, nq), mm and rad, at which the size of what is left out is looked for."""
    low, high = np.transpose(
        [a.range or (-_HALF[a.unit], _HALF[a.unit]) for a in machine.mechanism.actuators]
    )
    return np.random.default_rng(_SEED).uniform(low, high, (SAMPLES, len(low)))


def _largest(vectors: Array) -> float:
    return float(np.max(np.linalg.norm(vectors, axis=1)))


def _constant_shifts(
    machine: Machine, placed: PlacedEffect, values: Mapping[str, float], moving: set[str]
) -> dict[str, float] | None:
    """Return the shifts of what moves the machine, if they are constant with drivers at their defaults; else None."""
    constants = {name: ca.SX(value) for name, value in values.items()}
    coefficients = {name: ca.SX(value) for name, value in placed.values.items()}
    z = {name: ca.SX(driver_default(machine, name)) for name in placed.drivers}
    q, marks = symbols("q", machine.mechanism.readings), symbols("state.", state_names(machine))
    site = Site(machine, placed.place, placed.settings_map, coefficients, q, z, constants, {}, marks)
    shifts = {site.checked(port, placed): ca.SX(s) for port, s in placed.effect.shifts(site).items()}
    shifts = {port: shift for port, shift in shifts.items() if port in moving}
    if any(ca.symvar(shift) for shift in shifts.values()):
        return None
    return {port: float(ca.evalf(shift)) for port, shift in shifts.items()}
