"""A machine as CasADi expressions: pose, loop closure, gravity loads, with effects woven in.

``symbolic_model`` is the one place where mechanism, frames and effects meet; identification evaluates its
expressions over recordings, codegen turns the same expressions into C.

An effect never edits the machine: it adds shifts at named *ports* (a parameter, a displacement, an error
motion, a mount). A port's gravity load is its conjugate force, minus the derivative of the potential energy.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.models import lie
from truepose.models.effects.base import PlacedEffect, Site
from truepose.models.machine import FRAMES, PAYLOAD, Machine
from truepose.models.mechanism import AXES, BASE, COORDINATES, Direction, Joint, Mechanism, Step

MM_PER_M = 1000.0
_TURNS = {"rx": lie.rot_x, "ry": lie.rot_y, "rz": lie.rot_z}


@dataclass(frozen=True)
class SymbolicModel:
    """One machine, symbolically; internal units, readings in the unit of their column (mm, rad or turn).

    readings, q (nq,)       joint readings
    drivers, z (nz,)        payload, temperatures, time, approach ... with defaults ``z_home``
    names, p (np,)          parameters, then effect coefficients (then bare ports, when asked for)
    x (nx,), home (nx,)     unknowns of the closed loops and where their solution starts
    closure (nx,)           zero when the loops close (and statics hold, where an effect needs leg forces)
    pose (4, 4)             nominal base frame to tool
    world (4, 4)            sensor frame to tool
    """

    machine: Machine
    readings: tuple[str, ...]
    drivers: tuple[str, ...]
    z_home: NDArray[np.float64]
    names: tuple[str, ...]
    p_home: NDArray[np.float64]
    home: NDArray[np.float64]
    q: ca.SX
    z: ca.SX
    p: ca.SX
    x: ca.SX
    closure: ca.SX
    pose: ca.SX
    world: ca.SX
    energies: Mapping[str, ca.SX]


@dataclass(frozen=True)
class Assembly:
    """Bodies placed for given port values: poses, closure residual, potential energy of load cases (N mm)."""

    bodies: Mapping[str, ca.SX]
    closure: ca.SX
    tool: ca.SX
    energies: Mapping[str, ca.SX]


def symbolic_model(
    machine: Machine, effects: Sequence[PlacedEffect] = (), *, ports: bool = False
) -> SymbolicModel:
    """Expressions of ``machine`` with ``effects``; with ``ports`` every port is a variable too.

    Raises InputError when an effect asks for a port or a load that this machine has not.
    """
    q = _symbols("q", machine.mechanism.readings)
    drivers = driver_names(machine, effects, loads=ports)
    z = _symbols("z", drivers)
    x, home = _passive_symbols(machine.mechanism)
    theta = _symbols("", [p.name for p in machine.parameters])
    bare = _symbols("", machine.ports) if ports else dict[str, ca.SX]()
    c = [_symbols(f"c{k}_", list(effect.values)) for k, effect in enumerate(effects)]
    values = {**theta, **{name: bare.get(name, ca.SX(0)) for name in machine.ports}}
    statics = _Statics.of(machine, values, q, z, x) if any(e.needs_load for e in effects) else None
    loads = statics.loads(values) if statics else {}
    sites = [
        Site(machine, effect.place, effect.settings_map, own, q, z, values, loads)
        for effect, own in zip(effects, c, strict=True)
    ]
    shifted = _shifted(values, effects, sites)
    assembly = assemble(machine, shifted, q, z, x)
    names, p_home = _constants(machine, effects, tuple(bare))
    return SymbolicModel(
        machine=machine,
        readings=machine.mechanism.readings,
        drivers=tuple(drivers),
        z_home=np.array([driver_default(machine, name) for name in drivers]),
        names=names,
        p_home=p_home,
        home=np.concatenate([home, np.zeros(statics.forces.numel() if statics else 0)]),
        q=ca.vertcat(*q.values()),
        z=ca.vertcat(*z.values()) if z else ca.SX(0, 1),
        p=ca.vertcat(*theta.values(), *(symbol for own in c for symbol in own.values()), *bare.values()),
        x=ca.vertcat(x, statics.forces) if statics else x,
        closure=ca.vertcat(assembly.closure, statics.balance(shifted)) if statics else assembly.closure,
        pose=assembly.tool,
        world=_frame(shifted, "base") @ assembly.tool,
        energies=assembly.energies,
    )


def assemble(
    machine: Machine, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX], z: Mapping[str, ca.SX], x: ca.SX
) -> Assembly:
    """Place every body: ``values`` of parameters and ports, readings ``q``, drivers ``z``, passive ``x``."""
    mechanism = machine.mechanism
    displacement = {a.drives: displacement_of(machine, a.reading, values, q) for a in mechanism.actuators}
    passive, offset = {}, 0
    for joint in mechanism.passive:
        size = COORDINATES[joint.kind]
        passive[joint.name] = x[offset : offset + size]
        offset += size
    bodies = {BASE: _motion(values, "base")}
    for joint in mechanism.tree:
        bodies[joint.child] = bodies[joint.parent] @ _joint(joint, values, displacement, passive)
    closure = [_closing(joint, bodies, values, displacement) for joint in mechanism.closing]
    for rod in mechanism.rods:
        a, b = _end(bodies[rod.body_a], rod.point_a, values), _end(bodies[rod.body_b], rod.point_b, values)
        length = displacement[rod.name] if rod.length is None else values[rod.length]
        # (|d|^2 - l^2) / 2l: its derivative by l is -1 at closure, so its multiplier is the rod's tension
        closure.append((ca.sumsqr(b - a) - length**2) / (2 * length))
    tool = ca.mtimes([bodies[mechanism.flange], _motion(values, "tool"), _frame(values, "tool")])
    return Assembly(
        bodies, ca.vertcat(*closure) if closure else ca.SX(0, 1), tool, _energies(machine, bodies, tool, z)
    )


def displacement_of(
    machine: Machine, reading: str, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX]
) -> ca.SX:
    """offset + gain * reading + what effects add, in mm or rad."""
    actuator = machine.mechanism.actuator(reading)
    gain = values[actuator.gain] if actuator.gain else 1
    offset = values[actuator.offset] if actuator.offset else 0
    return offset + gain * q[reading] + values[actuator.displacement]


def driver_names(machine: Machine, effects: Sequence[PlacedEffect], *, loads: bool = False) -> list[str]:
    """Drivers that the model of these effects reads, each once, in a fixed order."""
    carries = any(m.name == PAYLOAD for m in machine.masses)
    names = [PAYLOAD] if carries and (loads or any(e.needs_load for e in effects)) else []
    for effect in effects:
        names += [name for name in effect.drivers if name not in names]
    return names


def driver_default(machine: Machine, name: str) -> float:
    """Value of a driver where nothing is recorded: nominal payload, 20 degC, latest session, no motion."""
    if name == PAYLOAD:
        return next((m.kg for m in machine.masses if m.name == PAYLOAD), 0.0)
    if name.startswith("temperature"):
        return 20.0
    return 1.0 if name.startswith("session.") else 0.0


@dataclass(frozen=True)
class _Statics:
    """Gravity's potential (N mm) as a function of the ports, which are symbols of their own.

    In closed loops ``forces`` are the closure's multipliers, unknowns that ``balance`` determines.
    """

    machine: Machine
    ports: Mapping[str, ca.SX]
    x: ca.SX
    forces: ca.SX
    potentials: Mapping[str, ca.SX]

    @classmethod
    def of(
        cls,
        machine: Machine,
        names: Iterable[str],
        q: Mapping[str, ca.SX],
        z: Mapping[str, ca.SX],
        x: ca.SX,
    ) -> _Statics:
        """Potential of a machine whose ports are ``names``."""
        ports = _symbols("u", list(names))
        raw = assemble(machine, ports, q, z, x)
        count = raw.closure.numel()
        forces = ca.SX.sym("force", count) if count else ca.SX(0, 1)
        work = ca.dot(forces, raw.closure)
        return cls(machine, ports, x, forces, {case: energy + work for case, energy in raw.energies.items()})

    def loads(self, values: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        """Conjugate gravity load of every port, by load case and name: N along lengths, N m about angles."""
        out: dict[str, ca.SX] = {}
        for case, potential in self.potentials.items():
            force = self._at(values, -ca.gradient(potential, ca.vertcat(*self.ports.values())))
            out |= {
                f"{case}{name}": force[k] / load_scale(self.machine, name)
                for k, name in enumerate(self.ports)
            }
        return out

    def balance(self, values: Mapping[str, ca.SX]) -> ca.SX:
        """(nx,) zero when the forces hold the passive coordinates where they are."""
        if not self.forces.numel():
            return self.forces
        return self._at(values, ca.gradient(self.potentials[""], self.x))

    def _at(self, values: Mapping[str, ca.SX], expression: ca.SX) -> ca.SX:
        symbols = ca.vertcat(*self.ports.values())
        out: ca.SX = ca.substitute(expression, symbols, ca.vertcat(*(values[name] for name in self.ports)))
        return out


def _shifted(
    values: Mapping[str, ca.SX], effects: Sequence[PlacedEffect], sites: Sequence[Site]
) -> dict[str, ca.SX]:
    """Values of all ports with every effect's shifts added."""
    out = dict(values)
    for placed, site in zip(effects, sites, strict=True):
        for port, shift in placed.effect.shifts(site).items():
            out[port] = out[site.checked(port, placed)] + shift
    return out


def _constants(
    machine: Machine, effects: Sequence[PlacedEffect], ports: tuple[str, ...]
) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Names of the entries of p and their values as the machine file has them."""
    names = [p.name for p in machine.parameters]
    values = [p.nominal for p in machine.parameters]
    for effect in effects:
        names += [f"{effect.label}:{name}" for name in effect.values]
        values += effect.values.values()
    return (*names, *ports), np.array([*values, *(0.0 for _ in ports)])


def load_scale(machine: Machine, port: str) -> float:
    """N mm a unit of the port, by the unit a load is told in: N along lengths, N m about angles."""
    return 1.0 if _is_length(machine, port) else MM_PER_M


def _is_length(machine: Machine, port: str) -> bool:
    if port in machine.geometry:
        return machine.geometry[port].unit != "rad"
    if port.endswith(".displacement"):
        return machine.mechanism.actuator(port.rsplit(".", 1)[0]).unit == "mm"
    return not port.rsplit(".", 1)[-1].startswith("r")


def _energies(
    machine: Machine, bodies: Mapping[str, ca.SX], tool: ca.SX, z: Mapping[str, ca.SX]
) -> dict[str, ca.SX]:
    """Potential energy of gravity for each load case, N mm (only differences matter)."""
    if machine.gravity is None:
        return {}
    gravity = ca.DM(machine.gravity)
    out = {}
    for case in machine.load_cases:
        if case:  # 1 kg at the origin of a body
            frame = tool if case == "tool|" else bodies[case.removesuffix("|")]
            out[case] = -ca.dot(gravity, frame[:3, 3])
            continue
        out[case] = ca.SX(0)
        for mass in machine.masses:
            frame = tool if mass.body == "tool" else bodies[mass.body]
            kg = z[PAYLOAD] if mass.name == PAYLOAD and PAYLOAD in z else mass.kg
            out[case] -= kg * ca.dot(gravity, _point(frame, list(mass.com)))
    return out


def _joint(
    joint: Joint, values: Mapping[str, ca.SX], displacement: Mapping[str, ca.SX], passive: Mapping[str, ca.SX]
) -> ca.SX:
    """Parent to child: placement, motion, error motion."""
    out = ca.SX.eye(4)
    for step in joint.placement:
        out = out @ _step(step, values[step.parameter])
    if joint.name in displacement:
        return ca.mtimes([out, _moved(joint, displacement[joint.name], values), _motion(values, joint.name)])
    if joint.name in passive:
        return out @ _moved(joint, passive[joint.name], values)
    return out


def _moved(joint: Joint, coordinate: ca.SX, values: Mapping[str, ca.SX]) -> ca.SX:
    if joint.kind == "universal":
        return lie.rot_x(coordinate[0]) @ lie.rot_y(coordinate[1])
    if joint.kind == "spherical":
        return lie.transform(lie.mrp_rotation(coordinate), ca.SX.zeros(3, 1))
    if joint.kind == "free":
        return lie.transform(lie.mrp_rotation(coordinate[3:]), coordinate[:3])
    axis = _axis(joint, values)
    if joint.kind == "prismatic":
        return lie.transform(ca.SX.eye(3), axis * coordinate)
    if joint.axis == (0.0, 0.0, 1.0):
        return lie.rot_z(coordinate)
    return lie.transform(lie.axis_rotation(axis, coordinate), ca.SX.zeros(3, 1))


def _axis(joint: Joint, values: Mapping[str, ca.SX]) -> ca.SX:
    if not isinstance(joint.axis, Direction):
        return ca.SX(ca.DM(joint.axis))
    known = [values[name] for name in joint.axis.components if name is not None]
    third = joint.axis.sign * ca.sqrt(1 - sum(v**2 for v in known))
    return ca.vertcat(*(third if name is None else values[name] for name in joint.axis.components))


def _closing(
    joint: Joint, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX], displacement: Mapping[str, ca.SX]
) -> ca.SX:
    """Closure residual of a joint that closes a loop: what of the relative pose its kind forbids."""
    frame = bodies[joint.parent]
    for step in joint.placement:
        frame = frame @ _step(step, values[step.parameter])
    if joint.name in displacement:
        frame = frame @ _moved(joint, displacement[joint.name], values)
    child = bodies[joint.child]
    gap = frame[:3, :3].T @ (child[:3, 3] - frame[:3, 3])
    turn = frame[:3, :3].T @ child[:3, :3]
    if joint.kind == "spherical":
        return gap
    if joint.kind == "universal":
        return ca.vertcat(gap, MM_PER_M * turn[0, 1])  # the cross's axes stay perpendicular
    if joint.kind == "fixed" or joint.name in displacement:
        return ca.vertcat(gap, MM_PER_M * lie.vee(turn))
    axis, across = _axis(joint, values), _across(joint)
    if joint.kind == "revolute":
        return ca.vertcat(gap, MM_PER_M * (across @ ca.cross(axis, turn @ axis)))
    return ca.vertcat(across @ ca.cross(axis, gap), MM_PER_M * lie.vee(turn))


def _across(joint: Joint) -> ca.SX:
    """Two rows (2, 3) across the joint's nominal axis, or across its largest component where it may turn."""
    if isinstance(joint.axis, Direction):
        axis = [float(name is None) for name in joint.axis.components]
    else:
        axis = list(joint.axis)
    return ca.SX(ca.DM(np.linalg.svd(np.reshape(axis, (1, 3)))[2][1:]))


def _step(step: Step, value: ca.SX) -> ca.SX:
    if step.kind in _TURNS:
        return _TURNS[step.kind](value)
    at = "xyz".index(step.kind[1])
    return lie.translation(*(value if k == at else ca.SX(0) for k in range(3)))


def _motion(values: Mapping[str, ca.SX], frame: str) -> ca.SX:
    """Small error motion of a frame; smooth at zero, where it is the identity."""
    if f"{frame}.motion.x" not in values:
        return ca.SX.eye(4)
    return lie.rpy_transform(
        [values[f"{frame}.motion.{a}"] for a in AXES[:3]], [values[f"{frame}.motion.{a}"] for a in AXES[3:]]
    )


def _frame(values: Mapping[str, ca.SX], frame: str) -> ca.SX:
    return lie.rpy_transform(
        [values[f"{frame}.{a}"] for a in AXES[:3]], [values[f"{frame}.{a}"] for a in AXES[3:]]
    )


def _point(frame: ca.SX, point: Sequence[ca.SX | float]) -> ca.SX:
    return frame[:3, :3] @ ca.vertcat(*(ca.SX(v) for v in point)) + frame[:3, 3]


def _end(frame: ca.SX, point: tuple[str, str, str] | None, values: Mapping[str, ca.SX]) -> ca.SX:
    return frame[:3, 3] if point is None else _point(frame, [values[name] for name in point])


def _symbols(prefix: str, names: Sequence[str]) -> dict[str, ca.SX]:
    return {name: ca.SX.sym(f"{prefix}{name}") for name in names}


def _passive_symbols(mechanism: Mechanism) -> tuple[ca.SX, NDArray[np.float64]]:
    size = sum(COORDINATES[j.kind] for j in mechanism.passive)
    home = [v for j in mechanism.passive for v in (j.home or (0.0,) * COORDINATES[j.kind])]
    return (ca.SX.sym("x", size) if size else ca.SX(0, 1)), np.array(home, dtype=float)


__all__ = ["FRAMES", "SymbolicModel", "assemble", "symbolic_model"]
