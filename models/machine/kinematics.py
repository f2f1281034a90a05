"""A machine as CasADi expressions: pose, loop closure, gravity loads, with effects woven in.

``symbolic_model`` is the one place where mechanism, frames and effects meet; identification evaluates its
expressions over recordings, codegen turns the same expressions into C.

An effect never edits the machine: it adds shifts at named *ports* (a parameter, a displacement, an error
motion, a mount). A port's gravity load is its conjugate force, minus the derivative of the potential energy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.file.driver import PAYLOAD, TIME, Driver
from truepose.models.file.machine_file import MachineFile
from truepose.models.machine.assembly import Statics, Still, symbols
from truepose.models.machine.closure import closed_home, coordinate_scale, home_readings
from truepose.models.machine.effect import Site
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.mechanism import AXES, COORDINATES, Mechanism, Parameter, own_motions
from truepose.models.machine.near_home import Stance, near_home
from truepose.models.machine.placed import PlacedEffect
from truepose.models.machine.sensor import TOOL_IN_WORLD, View
from truepose.models.machine.states import (
    AXIS,
    Variables,
    joint_ends,
    put_in_place,
    reading_shifts,
)

_STARTS = ("start", f"from.{TIME}")
"""Settings that say when what follows time began: a drift, and a form without a name."""


@dataclass(frozen=True)
class Held:
    """The ports that effects move as symbols of their own, so that derivatives by coefficients follow from few.

    ports (k,) symbols, values (k,) what they stand for; world (4, 4) and reading_shift (r,) of the model as functions of them.
    """

    ports: ca.SX
    values: ca.SX
    world: ca.SX
    reading_shift: ca.SX


@dataclass(frozen=True)
class SymbolicModel:
    """One machine, symbolically; internal units, readings in the unit of their column (mm, rad or turn).

    readings, q (nq,)       joint readings
    drivers, z (nz,)        payload, temperatures, time, approach ... with defaults ``z_home``
    names, p (np,)          parameters, then effect coefficients (then bare ports, when asked for)
    x (nx,), home (nx,)     unknowns of the closed loops and where their solution starts: passive coordinates, those
                            at home where loops close about home only, leg forces where an effect asks for them
    closure (nx,)           zero when the loops close (and statics hold, where an effect needs leg forces)
    gap (ng,)               what the loops lack, mm; more than nx entries where they are overconstrained
    q_home (nq,)            readings at home
    pose (4, 4)             nominal base frame to tool
    worlds                  poses (4, 4) of each of the machine's views: what its sensors read, and from where
    reading_shift (k,)      what effects, and joints that are read, add to the columns of all sensors, mm or rad
    states                  by name, what effects may ask of the present state (``truepose.models.machine.states``)
    values                  of all parameters and ports by name, with the shifts of effects
    held                    ``world`` and reading_shift by the ports that effects move; None where loops close or
                            sensors read several tips
    """

    machine: Machine
    effects: tuple[PlacedEffect, ...]
    drivers: tuple[str, ...]
    z_home: Array
    names: tuple[str, ...]
    p_home: Array
    home: Array
    q_home: Array
    q: ca.SX
    z: ca.SX
    p: ca.SX
    x: ca.SX
    closure: ca.SX
    gap: ca.SX
    pose: ca.SX
    worlds: Mapping[View, ca.SX]
    energies: Mapping[str, ca.SX]
    still: Still
    reading_shift: ca.SX
    states: Mapping[str, ca.SX]
    values: Mapping[str, ca.SX]
    held: Held | None

    @property
    def readings(self) -> tuple[str, ...]:
        """Names of the joints that are read."""
        return self.machine.mechanism.readings

    @property
    def moved(self) -> dict[str, ca.SX]:
        """Own motions of the joints by name, in the units of their readings."""
        q = dict(zip(self.readings, ca.vertsplit(self.q), strict=True))
        return own_motions(self.machine.mechanism, q)

    @property
    def world(self) -> ca.SX:
        """(4, 4) sensor frame to tool."""
        return self.worlds[TOOL_IN_WORLD]

    @property
    def equations(self) -> ca.SX:
        """What a solver drives to zero: the closure, or all gaps (in least squares) of overconstrained loops.

        Both have the same solution; Gauss-Newton on the gaps finds it from further away.
        """
        coordinates = sum(COORDINATES[joint.kind] for joint in self.machine.mechanism.unknown)
        if self.gap.numel() <= coordinates:
            return self.closure
        return ca.vertcat(self.gap, self.closure[coordinates:])  # the balance of forces stays


def symbolic_model(
    machine: Machine, effects: Sequence[PlacedEffect] = (), *, ports: bool = False, weighed: bool = False
) -> SymbolicModel:
    """Expressions of ``machine`` with ``effects``; with ``ports`` every port is a variable too.

    ``weighed``: the payload's mass is recorded row by row, so that a constant of it plays no part.

    Raises InputError when an effect asks for a port or a load that this machine has not.
    """
    drivers = driver_names(machine, effects, loads=ports)
    variables = Variables.of(machine, effects, drivers, ports=ports, weighed=weighed)
    statics = _statics(variables)
    model = _model(variables, variables.in_place(_shifted(variables, statics)), statics)
    return replace(model, home=assembled_home(model)) if len(model.home) else model


def _model(own: Variables, shifted: Mapping[str, ca.SX], statics: Statics | None) -> SymbolicModel:
    """Place the bodies, and what sensors see of them, for values of parameters and ports with the effects' shifts."""
    machine, (passive, x_home) = own.machine, own.now_and_home
    stance = Stance(shifted, own.moved, passive, tuple(own.q.values()))
    assembly = (
        near_home(machine, stance, x_home, own.z) if x_home.numel() else stance.assembled(machine, own.z)
    )
    x, closure = own.x, assembly.closure
    if statics is not None:
        x, closure = ca.vertcat(x, statics.forces), ca.vertcat(closure, statics.balance(shifted))
    worlds = {view: assembly.seen(view, shifted) for view in machine.views}
    shift, seen = reading_shifts(machine, worlds, own.values, shifted, own.moved)
    return SymbolicModel(
        machine=machine,
        effects=own.effects,
        drivers=tuple(own.z),
        z_home=np.array([driver_default(machine, name) for name in own.z]),
        names=own.names,
        p_home=own.p_home,
        home=np.concatenate([own.home, np.zeros(x.numel() - own.x.numel())]),
        q_home=home_readings(machine.mechanism),
        q=ca.vertcat(*own.q.values()),
        z=ca.vertcat(*own.z.values()) if own.z else ca.SX(0, 1),
        p=own.p,
        x=x,
        closure=closure,
        gap=assembly.gap,
        pose=assembly.tool,
        worlds=worlds,
        energies=assembly.energies,
        still=assembly.still,
        reading_shift=ca.vertcat(*put_in_place(ca.vertsplit(shift), own.marks, seen)) if seen else shift,
        states=(own.directions() if own.bare else {}) | seen,
        values=shifted,
        held=None if own.x.numel() or len(worlds) > 1 else _held(own, shifted, stance),
    )


def assembled_home(model: SymbolicModel) -> Array:
    """(nx,) unknowns at home of the nominal machine."""
    scale = coordinate_scale(model.machine, len(model.home), model.gap.numel())
    outputs = [model.equations, ca.jacobian(model.equations, model.x), model.gap]
    fixed = [model.q, model.z, model.p]
    at = ca.Function("closure", [model.x, *fixed], [ca.densify(o) for o in outputs])
    constants = (model.q_home, model.z_home, model.p_home)
    nominal = ca.Function("home", [model.x], list(at.call([model.x, *(ca.DM(c) for c in constants)])))
    found = closed_home(nominal, model.home, scale)
    if found is None:
        file = model.machine.file
        raise InputError(
            f"{file.path if file else model.machine.name}: mechanism.home: found no way to close the loops near "
            f"it with readings {dict(zip(model.readings, model.q_home.round(4).tolist(), strict=True))} (mm, rad), "
            "expected a home from which the machine can be assembled"
        )
    return found


def driver_names(machine: Machine, effects: Sequence[PlacedEffect], *, loads: bool = False) -> list[str]:
    """Drivers that the model of these effects reads, each once, in a fixed order."""
    carries = any(m.name == PAYLOAD for m in machine.masses)
    elastic = machine.mechanism.loops == "elastic"
    asked = loads or elastic or any(e.needs_load for e in effects)
    names = [*([PAYLOAD] if carries else []), *machine.force_columns] if asked else []
    names += [own.driver for own in machine.equipment if own.tool or (asked and own.mass)]
    for effect in effects:
        names += [name for name in effect.drivers if name not in names]
    return names


def driver_default(machine: Machine, name: str, effects: Sequence[PlacedEffect] = ()) -> float:
    """Return a driver's value where none is recorded: the nominal payload, the latest start of a drift, else that of its kind.

    ``effects`` count beside the machine's. Clocks may count from 1970: at time 0 a drift is far outside of its recording.
    """
    if name == TIME:
        reading = (effect for effect in (*machine.effects, *effects) if TIME in effect.drivers)
        drifting = (effect.settings_map for effect in reading)
        starts = [settings[key] for settings in drifting for key in _STARTS if key in settings]
        return max(starts, default=Driver.of(name).default)
    masses = (m.kg for m in machine.masses if m.name == PAYLOAD == name)
    return next(masses, Driver.of(name).default)


def _shifted(own: Variables, statics: Statics | None) -> dict[str, ca.SX]:
    """Values of all ports with every effect's shifts added."""
    out, loads = dict(own.values), statics.loads(own.values) if statics else {}
    for placed, c in zip(own.effects, own.c, strict=True):
        known = (placed.place, placed.settings_map, c, own.moved, own.z, own.values, loads, own.marks)
        site = Site(own.machine, *known)
        for port, shift in placed.effect.shifts(site).items():
            out[port] = out[site.checked(port, placed)] + shift
    return out


def _held(own: Variables, shifted: Mapping[str, ca.SX], stance: Stance) -> Held:
    machine, read = own.machine, own.machine.ports_of("reading")
    moved = [name for name, v in shifted.items() if v is not own.values[name] and name not in read]
    ports = symbols("port.", moved)
    values = dict(shifted) | ports
    assembly = replace(stance, values=values).assembled(machine, own.z)
    world = assembly.seen(TOOL_IN_WORLD, values)
    shift, seen = reading_shifts(machine, {TOOL_IN_WORLD: world}, own.values, values, own.moved)
    put = ca.vertcat(*put_in_place(ca.vertsplit(shift), own.marks, seen)) if seen else shift
    if not moved:
        return Held(ca.SX(0, 1), ca.SX(0, 1), world, put)
    return Held(ca.vertcat(*ports.values()), ca.vertcat(*(shifted[name] for name in moved)), world, put)


def _statics(own: Variables) -> Statics | None:
    """Gravity's loads where an effect asks for them; those of ball joints where the closure is linear."""
    asking = [effect for effect in own.effects if effect.needs_load]
    if not asking:
        return None
    if own.machine.mechanism.loops == "elastic":
        raise InputError(
            f"effect {asking[0]}: found a machine whose legs are elastic (model: stiffness), which balances its "
            "weight already; expected model: spherical, linear or beam for an effect of loads"
        )
    return Statics.of(own.machine, own.values, own.moved, own.z, own.now_and_home[0])


def home_directions(
    mechanism: Mechanism, file: MachineFile | None = None
) -> Mapping[str, tuple[float, float, float]]:
    """Unit vector of each end of ``joint_ends`` (frames: ``states``), nominal parameters, home readings.

    A calibrated file has the drawing's parameters in ``nominal``: a fit, and the file of it, then have the same directions.

    Raises InputError, which names ``file``, where the mechanism cannot be assembled at home.
    """
    frames = tuple(Parameter(f"{frame}.{axis}", "mm", 0.0) for frame in FRAMES for axis in AXES)
    drawn = {} if file is None else file.nominal
    own = tuple(replace(p, nominal=drawn.get(p.name, p.nominal)) for p in mechanism.parameters)
    closing = replace(mechanism, parameters=own, loops="exact")  # at home every way to close is the exact one
    machine = Machine(file.name if file else "mechanism", closing, frames, (), file=file)
    ends = joint_ends(machine)
    if not ends:
        return {}
    model = symbolic_model(machine, ports=True)
    found = ca.vertcat(*(model.states[f"{AXIS}{end}.{axis}"] for end in ends for axis in "xyz"))
    at = ca.Function("at", [model.q, model.z, model.p, model.x], [found])
    values = np.asarray(at(model.q_home, model.z_home, model.p_home, model.home), dtype=float).reshape(-1, 3)
    return {end: (float(x), float(y), float(z)) for end, (x, y, z) in zip(ends, values, strict=True)}
