"""A machine as CasADi expressions: pose, loop closure, gravity loads, with effects woven in.

``symbolic_model`` is the one place where mechanism, frames and effects meet; identification evaluates its
expressions over recordings, codegen turns the same expressions into C.

An effect never edits the machine: it adds shifts at named *ports* (a parameter, a displacement, an error
motion, a mount). A port's gravity load is its conjugate force, minus the derivative of the potential energy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    energy: ca.SX


@dataclass(frozen=True)
class Assembly:
    """Bodies placed for given port values: poses, closure residual and potential energy (N mm)."""

    bodies: Mapping[str, ca.SX]
    closure: ca.SX
    tool: ca.SX
    energy: ca.SX


def symbolic_model(machine: Machine, effects: Sequence[PlacedEffect] = (), *, ports: bool = False) -> SymbolicModel:
    """Expressions of ``machine`` with ``effects``; with ``ports`` every port is a variable too.

    Raises InputError when an effect asks for a port or a load that this machine has not.
    """
    mechanism = machine.mechanism
    parameters = machine.parameters
    q = _symbols("q", mechanism.readings)
    theta = _symbols("", [p.name for p in parameters])
    port_values = _symbols("", machine.ports) if ports else {name: ca.SX(0) for name in machine.ports}
    labels = [(k, coefficient.name) for k, e in enumerate(effects) for coefficient in e.coefficients]
    c = {label: ca.SX.sym(f"c{label[0]}_{label[1]}") for label in labels}
    drivers = driver_names(machine, effects, loads=ports)
    z = _symbols("z", drivers)
    x, home = _passive_symbols(mechanism)

    values: dict[str, ca.SX] = {**theta, **port_values}
    unknowns, start, statics = [x], [home], ca.SX(0, 1)
    shifted = dict(values)
    if effects:
        loads: Mapping[str, ca.SX] = {}
        multipliers = ca.SX.sym("force", x.numel()) if x.numel() and any(e.needs_load for e in effects) else ca.SX(0, 1)
        if any(e.needs_load for e in effects):
            loads = _loads(machine, values, q, z, x, multipliers)
        for k, effect in enumerate(effects):
            coefficients = {name: c[k, name] for kk, name in labels if kk == k}
            site = Site(machine, effect.place, effect.settings_map, coefficients, q, z, values, loads)
            for port, shift in effect.effect.shifts(site).items():
                shifted[port] = shifted[site.checked(port, effect)] + shift
        if multipliers.numel():
            unknowns.append(multipliers)
            start.append(np.zeros(multipliers.numel()))
    assembly = assemble(machine, shifted, q, z, x)
    if len(unknowns) > 1:
        statics = ca.jacobian(assembly.closure, x).T @ unknowns[1] + ca.gradient(assembly.energy, x)
    base = lie.rpy_transform([values[f"base.{a}"] for a in AXES[:3]], [values[f"base.{a}"] for a in AXES[3:]])
    names = [p.name for p in parameters] + [f"{effects[k].label}:{name}" for k, name in labels]
    symbols = [*theta.values(), *c.values()]
    if ports:
        names += list(machine.ports)
        symbols += list(port_values.values())
    p_home = [p.nominal for p in parameters] + [effects[k].values[name] for k, name in labels]
    p_home += [0.0] * (len(names) - len(p_home))
    return SymbolicModel(
        machine=machine,
        readings=mechanism.readings,
        drivers=tuple(drivers),
        z_home=np.array([driver_default(machine, name) for name in drivers]),
        names=tuple(names),
        p_home=np.array(p_home),
        home=np.concatenate(start),
        q=ca.vertcat(*q.values()),
        z=ca.vertcat(*z.values()) if z else ca.SX(0, 1),
        p=ca.vertcat(*symbols),
        x=ca.vertcat(*unknowns),
        closure=ca.vertcat(assembly.closure, statics),
        pose=assembly.tool,
        world=base @ assembly.tool,
        energy=assembly.energy,
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
    return Assembly(bodies, ca.vertcat(*closure) if closure else ca.SX(0, 1), tool, _energy(machine, bodies, tool, z))


def displacement_of(machine: Machine, reading: str, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX]) -> ca.SX:
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
    """Value of a driver where nothing is recorded: nominal payload, 20 degC, the latest session, no motion."""
    if name == PAYLOAD:
        return next((m.kg for m in machine.masses if m.name == PAYLOAD), 0.0)
    if name.startswith("temperature"):
        return 20.0
    return 1.0 if name.startswith("session.") else 0.0


def _loads(
    machine: Machine,
    values: Mapping[str, ca.SX],
    q: Mapping[str, ca.SX],
    z: Mapping[str, ca.SX],
    x: ca.SX,
    multipliers: ca.SX,
) -> dict[str, ca.SX]:
    """Conjugate gravity load of every port, at the ports' unshifted values."""
    ports = list(values)
    free = _symbols("u", ports)
    payload = {PAYLOAD: z.get(PAYLOAD, ca.SX(driver_default(machine, PAYLOAD)))}
    raw = assemble(machine, free, q, payload, x)
    symbols = ca.vertcat(*free.values())
    potential = raw.energy
    if multipliers.numel():
        potential = potential + ca.dot(multipliers, raw.closure)
    force = -ca.gradient(potential, symbols)
    force = ca.substitute(force, symbols, ca.vertcat(*(values[name] for name in ports)))
    return {name: force[k] / load_scale(machine, name) for k, name in enumerate(ports)}


def load_scale(machine: Machine, port: str) -> float:
    """N mm a unit of the port, by the unit a load is told in: N along lengths, N m about angles."""
    return 1.0 if _is_length(machine, port) else MM_PER_M


def _is_length(machine: Machine, port: str) -> bool:
    if port in machine.geometry:
        return machine.geometry[port].unit != "rad"
    if port.endswith(".displacement"):
        return machine.mechanism.actuator(port.rsplit(".", 1)[0]).unit == "mm"
    return not port.rsplit(".", 1)[-1].startswith("r")


def _energy(machine: Machine, bodies: Mapping[str, ca.SX], tool: ca.SX, z: Mapping[str, ca.SX]) -> ca.SX:
    """Potential energy of gravity, N mm (only differences matter)."""
    energy = ca.SX(0)
    if machine.gravity is None:
        return energy
    gravity = ca.DM(machine.gravity)
    for mass in machine.masses:
        frame = tool if mass.body == "tool" else bodies[mass.body]
        kg = z[PAYLOAD] if mass.name == PAYLOAD and PAYLOAD in z else mass.kg
        energy -= kg * ca.dot(gravity, _point(frame, list(mass.com)))
    return energy


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
    axis = _axis(joint, values)
    across = _perpendicular(joint)
    if joint.kind == "revolute":
        return ca.vertcat(gap, MM_PER_M * (across @ (turn @ axis)))
    return ca.vertcat(across @ gap, MM_PER_M * lie.vee(turn))


def _perpendicular(joint: Joint) -> ca.DM:
    """Two rows across the joint's nominal axis."""
    nominal = np.array(joint.axis if not isinstance(joint.axis, Direction) else (0.0, 0.0, joint.axis.sign))
    return ca.DM(np.linalg.svd(nominal.reshape(1, 3))[2][1:])


def _step(step: Step, value: ca.SX) -> ca.SX:
    if step.kind in _TURNS:
        return _TURNS[step.kind](value)
    at = "xyz".index(step.kind[1])
    return lie.translation(*(value if k == at else ca.SX(0) for k in range(3)))


def _motion(values: Mapping[str, ca.SX], frame: str) -> ca.SX:
    """Small error motion of a frame; smooth at zero, where it is the identity."""
    if f"{frame}.motion.x" not in values:
        return ca.SX.eye(4)
    return lie.rpy_transform([values[f"{frame}.motion.{a}"] for a in AXES[:3]], [values[f"{frame}.motion.{a}"] for a in AXES[3:]])


def _frame(values: Mapping[str, ca.SX], frame: str) -> ca.SX:
    return lie.rpy_transform([values[f"{frame}.{a}"] for a in AXES[:3]], [values[f"{frame}.{a}"] for a in AXES[3:]])


def _point(frame: ca.SX, point: Sequence[object]) -> ca.SX:
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
