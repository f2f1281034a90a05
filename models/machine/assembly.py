"""Bodies placed for given parameters and readings: poses, loop closure, potential energy of gravity."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from truepose.models import lie
from truepose.models.file.driver import PAYLOAD
from truepose.models.file.sections import FORCE
from truepose.models.machine.machine import WEIGHT, Machine, Mass, MeasuredForce, Spring
from truepose.models.machine.mechanism import AXES, BASE, COORDINATES, Direction, Flexures, Joint, Rod
from truepose.models.machine.sensor import TOOL, WORLD, View

SHAPE = 0.25
"""beta of a flexure of constant section: its tip runs on a circle of 3/4 of its length (eq. 13)."""


def flexure_gain(length: ca.SX, shape: ca.SX, cosine: ca.SX) -> ca.SX:
    """What a flexure bent by acos(``cosine``) adds to its rod, mm; ``shape`` is beta, 1/2 a ball joint's circle."""
    turned = (1 - 2 * shape) * cosine
    return length / 2 * (ca.sqrt(3 - 4 * shape + turned**2) - turned - 1)


def flexure_gains(
    flexures: Flexures, span: ca.SX, frame_a: ca.SX, frame_b: ca.SX, values: Mapping[str, ca.SX]
) -> ca.SX:
    """What both flexures of a rod along ``span`` (3,) between two bodies' frames (4, 4) add to its length, mm."""
    along = span / ca.norm_2(span)
    length, shape = values[flexures.length], values[flexures.shape]
    ends = ((frame_a, flexures.axis_a), (frame_b, flexures.axis_b))
    cosines = [ca.dot(along, frame[:3, :3] @ ca.DM(axis)) for frame, axis in ends]
    return sum((flexure_gain(length, shape, cosine) for cosine in cosines), ca.SX(0))


Number = ca.SX | float
MM_PER_M = 1000.0


@dataclass(frozen=True)
class Still:
    """What does not vary with the machine: symbols (k,), and what they are at present (k,)."""

    symbols: ca.SX
    present: ca.SX

    def slope(self, energy: ca.SX, by: ca.SX) -> ca.SX:
        """Gradient of an energy by ``by``, a column, with the present in place."""
        gradient = ca.gradient(energy, by)
        if not self.symbols.numel():
            return gradient
        placed: ca.SX = ca.substitute(gradient, self.symbols, self.present)
        return placed


def energies(
    machine: Machine, frames: Mapping[str, ca.SX], z: Mapping[str, ca.SX], values: Mapping[str, ca.SX]
) -> tuple[dict[str, ca.SX], Still]:
    """Of each load case, and of all stated masses and springs, N mm (only differences matter); with what stands still in it.

    ``frames`` (4, 4) are bodies and carried frames in the base; ``z`` drivers, ``values`` parameters by name.
    """
    down = ca.DM(machine.gravity or (0.0, 0.0, 0.0))
    if not machine.stated_loads:  # 1 kg at the origin of a body
        probes = {case: frames[case.removesuffix("|")][:3, 3] for case in machine.load_cases}
        return {case: -ca.dot(down, at) for case, at in probes.items()}, _still([])
    weight = ca.SX(0)
    carried = [own for own in machine.equipment if own.mass is not None]
    others = 1 - sum((z.get(own.driver, ca.SX(0)) for own in carried), ca.SX(0)) if carried else 1
    for mass in machine.masses if machine.weighs else ():
        kg, com = _mass(mass, z, values)
        kg *= others if mass.name == PAYLOAD else 1
        weight -= kg * ca.dot(down, in_base(frames[mass.body], com))
    for own in carried if machine.weighs else ():
        assert own.mass is not None
        kg, com = of_mass(own.mass, values)
        here = z.get(own.driver, ca.SX(0)) * kg
        weight -= here * ca.dot(down, in_base(frames[own.mass.body], com))
    pulling = [_spring(spring, frames, values) for spring in machine.springs]
    pushing = [_work(force, frames, z) for force in machine.forces]
    whole = sum((*pulling, *(-work for work, _ in pushing)), weight)
    alone = {WEIGHT: weight} if machine.weight_case else {}
    return {"": whole, **alone}, _still([still for _, still in pushing])


def _work(force: MeasuredForce, frames: Mapping[str, ca.SX], z: Mapping[str, ca.SX]) -> tuple[ca.SX, Still]:
    """Work (N mm) of the present force F and moment M, which stand still: F . p + M . turn, in the base.

    The turn from the present R0 is ``vee(R R0')``; M . vee(R R0') is the sum of products of R with ``skew(M) R0 / 2``.
    """
    frame, axes = frames[force.body], frames[force.axes][:3, :3]
    read = [force.sign * z.get(column, ca.SX(0)) for column in force.columns]
    present = axes @ ca.vertcat(*read[:FORCE])
    still = ca.SX.sym(f"force.{force.name}", 3)
    work = ca.dot(still, in_base(frame, force.at))
    if len(read) == FORCE:
        return work, Still(still, present)
    turned = lie.skew(MM_PER_M * (axes @ ca.vertcat(*read[FORCE:]))) @ frame[:3, :3] / 2
    turning = ca.SX.sym(f"moment.{force.name}", 3, 3)
    work += ca.dot(turning, frame[:3, :3])
    return work, Still(ca.vertcat(still, ca.vec(turning)), ca.vertcat(present, ca.vec(turned)))


def _still(parts: Sequence[Still]) -> Still:
    none = ca.SX(0, 1)
    return Still(
        ca.vertcat(none, *(part.symbols for part in parts)),
        ca.vertcat(none, *(part.present for part in parts)),
    )


def _mass(mass: Mass, z: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> tuple[Number, Sequence[Number]]:
    """kg and centre (3,), mm: a payload's kg is the recorded one and what an unknown one differs from its nominal by."""
    kg, com = of_mass(mass, values)
    if mass.name == PAYLOAD and PAYLOAD in z:
        kg = z[PAYLOAD] + (kg - mass.kg) if mass.parameters else z[PAYLOAD]
    return kg, com


def of_mass(mass: Mass, values: Mapping[str, ca.SX]) -> tuple[Number, Sequence[Number]]:
    """kg and centre (3,), mm, as the parameters have them where they are not exactly known."""
    if not mass.parameters:
        return mass.kg, mass.com
    kg, *com = (values[parameter.name] for parameter in mass.parameters)
    return kg, com


def _spring(spring: Spring, frames: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> ca.SX:
    """force l + stiffness (l - free length)^2 / 2, l the distance of its ends."""
    (a, at_a), (b, at_b) = spring.ends
    length = ca.norm_2(in_base(frames[b], at_b) - in_base(frames[a], at_a))
    own = [values.get(f"{spring.name}.{name}", ca.SX(value)) for name, value in spring.constants.items()]
    force, stiffness, free = own
    return force * length + stiffness * (length - free) ** 2 / 2


def in_base(frame: ca.SX, at: Sequence[Number]) -> ca.SX:
    """(3,) a point of a frame (4, 4) where the frame stands."""
    return frame[:3, :3] @ ca.vertcat(*(ca.SX(v) for v in at)) + frame[:3, 3]


_TURNS = {"rx": lie.rot_x, "ry": lie.rot_y, "rz": lie.rot_z}


@dataclass(frozen=True)
class Assembly:
    """Bodies placed for given port values: poses, closure residual, potential energy of load cases (N mm), and what stands
    still when it is varied.

    ``carried`` are the frames that the machine carries, by name: the tool, and the further ones of its file.
    """

    bodies: Mapping[str, ca.SX]
    closure: ca.SX
    gap: ca.SX
    tool: ca.SX
    energies: Mapping[str, ca.SX]
    still: Still
    carried: Mapping[str, ca.SX]

    def seen(self, view: View, values: Mapping[str, ca.SX]) -> ca.SX:
        """Pose (4, 4) of the tip of a view in the frame that its readings are in."""
        if view.frame in self.carried and view.tip in self.carried:  # where the base stands plays no part
            return lie.inverse(self.carried[view.frame]) @ self.carried[view.tip]
        tip = self._in_world(view.tip, values)
        return lie.inverse(self._in_world(view.frame, values)) @ tip if view.relative else tip

    def _in_world(self, name: str, values: Mapping[str, ca.SX]) -> ca.SX:
        if name in self.carried:
            return frame_of(values, BASE) @ self.carried[name]
        return motion_of(values, name) @ frame_of(values, name)


def assemble(
    machine: Machine,
    values: Mapping[str, ca.SX],
    q: Mapping[str, ca.SX],
    z: Mapping[str, ca.SX],
    x: ca.SX,
    poses: Mapping[str, ca.SX] | None = None,
) -> Assembly:
    """Place every body: ``values`` of parameters and ports, readings ``q``, drivers ``z``, passive ``x``.

    Bodies named in ``poses`` stand where it says (4, 4), whatever their joints are.
    """
    given = poses or {}
    mechanism = machine.mechanism
    displacement = displacements(machine, values, q)
    passive, offset = {}, 0
    for joint in mechanism.passive:
        size = COORDINATES[joint.kind]
        passive[joint.name] = x[offset : offset + size]
        offset += size
    bodies = {BASE: motion_of(values, "base")}
    for joint in mechanism.tree:
        if joint.child in given:
            bodies[joint.child] = given[joint.child]
        else:
            bodies[joint.child] = bodies[joint.parent] @ _joint(joint, values, displacement, passive)
    closure = [_closing(joint, bodies, values, displacement) for joint in mechanism.closing]
    closure += [_rod(rod, bodies, values, displacement) for rod in mechanism.rods]
    tool = ca.mtimes([bodies[mechanism.flange], motion_of(values, "tool"), frame_of(values, "tool")])
    gap = ca.vertcat(*closure) if closure else ca.SX(0, 1)
    square = _least_squares(gap, x) if gap.numel() > x.numel() else gap
    carried = _carried(machine, bodies, tool, values)
    energy, still = energies(machine, {**bodies, **carried}, z, values)
    return Assembly(bodies, square, gap, tool, energy, still, carried)


def _carried(
    machine: Machine, bodies: Mapping[str, ca.SX], tool: ca.SX, values: Mapping[str, ca.SX]
) -> dict[str, ca.SX]:
    """Pose (4, 4), in the nominal base frame, of the tool and of every further frame that a body carries."""
    out = {TOOL: tool}
    for mount in machine.mounts:
        if mount.body == WORLD:
            continue
        body = tool if mount.body == TOOL else bodies[mount.body]
        out[mount.name] = ca.mtimes([body, motion_of(values, mount.name), frame_of(values, mount.name)])
    return out


def tool_on_flange(values: Mapping[str, ca.SX]) -> ca.SX:
    """Pose (4, 4) of the tool in the flange's frame."""
    return motion_of(values, "tool") @ frame_of(values, "tool")


def rod_ends(rod: Rod, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Ball centres (3,) of a rod in the base frame, mm."""
    return _end(bodies[rod.body_a], rod.point_a, values), _end(bodies[rod.body_b], rod.point_b, values)


def _rod(
    rod: Rod, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX], displacement: Mapping[str, ca.SX]
) -> ca.SX:
    """Closure residual of a rod: how much its ends are too far apart, mm."""
    a, b = rod_ends(rod, bodies, values)
    length = displacement[rod.name] if rod.length is None else values[rod.length]
    if rod.flexures is not None:
        length = length + flexure_gains(rod.flexures, b - a, bodies[rod.body_a], bodies[rod.body_b], values)
    # (|d|^2 - l^2) / 2l: its derivative by l is -1 at closure, so its multiplier is the rod's tension
    return (ca.sumsqr(b - a) - length**2) / (2 * length)


def _least_squares(gap: ca.SX, x: ca.SX) -> ca.SX:
    """(nx,) zero where overconstrained loops close best: the gap across each column of its Jacobian, mm."""
    by_x = ca.jacobian(gap, x)
    columns = [by_x[:, k] for k in range(x.numel())]
    return ca.vertcat(*(ca.dot(column, gap) / ca.norm_2(column) for column in columns))


def displacement_of(
    machine: Machine, reading: str, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX]
) -> ca.SX:
    """offset + gain * reading + what effects add, in mm or rad."""
    actuator = machine.mechanism.actuator(reading)
    gain = values[actuator.gain] if actuator.gain else 1
    offset = values[actuator.offset] if actuator.offset else 0
    return offset + gain * q[reading] + values[actuator.displacement]


def way_of(machine: Machine, reading: str, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX]) -> ca.SX:
    """How far a joint is from where its reading is 0, mm or rad: gain * reading + what effects add."""
    offset = machine.mechanism.actuator(reading).offset
    return displacement_of(machine, reading, values, q) - (values[offset] if offset else 0)


def displacements(machine: Machine, values: Mapping[str, ca.SX], q: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Displacement of every joint and rod that readings move, mm or rad, by its name."""
    mechanism = machine.mechanism
    own = {a.reading: displacement_of(machine, a.reading, values, q) for a in mechanism.actuators}
    out = {a.drives: own[a.reading] for a in mechanism.actuators}
    for follower in mechanism.followers:
        carried = (values[ratio] * own[reading] for reading, ratio in follower.terms)
        out[follower.joint] = sum(carried, values[follower.offset])
        if follower.law is not None:
            out[follower.joint] += follower.law.value(own, values)
    return out


def _joint(
    joint: Joint, values: Mapping[str, ca.SX], displacement: Mapping[str, ca.SX], passive: Mapping[str, ca.SX]
) -> ca.SX:
    """Parent to child: placement, motion, error motion."""
    out = _placed(joint, values)
    if joint.name in displacement:
        return ca.mtimes(
            [out, moved_by(joint, displacement[joint.name], values), motion_of(values, joint.name)]
        )
    if joint.name in passive:
        return out @ moved_by(joint, passive[joint.name], values)
    return out


def _placed(joint: Joint, values: Mapping[str, ca.SX]) -> ca.SX:
    """Pose (4, 4) of the joint's own frame in its parent."""
    if not joint.placement:
        return ca.SX.eye(4)
    constants = ca.vertcat(*(values[step.parameter] for step in joint.placement))
    placed: ca.SX = _placement(tuple(step.kind for step in joint.placement))(constants)
    return placed


@cache
def _placement(kinds: tuple[str, ...]) -> ca.Function:
    """Steps one after the other as recorded operations: repeated, they need a fifth of the time."""
    constants, out = ca.SX.sym("c", len(kinds)), ca.SX.eye(4)
    for k, kind in enumerate(kinds):
        out = out @ _step(kind, constants[k])
    return ca.Function("placement", [constants], [out])


def moved_by(joint: Joint, coordinate: ca.SX, values: Mapping[str, ca.SX]) -> ca.SX:
    if joint.kind == "universal":
        return lie.rot_x(coordinate[0]) @ lie.rot_y(coordinate[1])
    if joint.kind == "spherical":
        return lie.transform(lie.mrp_rotation(coordinate), ca.SX.zeros(3, 1))
    if joint.kind == "free":
        return lie.transform(lie.mrp_rotation(coordinate[3:]), coordinate[:3])
    axis = axis_of(joint, values)
    if joint.kind == "prismatic":
        return lie.transform(ca.SX.eye(3), axis * coordinate)
    if joint.axis == (0.0, 0.0, 1.0):
        return lie.rot_z(coordinate)
    return lie.transform(lie.axis_rotation(axis, coordinate), ca.SX.zeros(3, 1))


def axis_of(joint: Joint, values: Mapping[str, ca.SX]) -> ca.SX:
    if not isinstance(joint.axis, Direction):
        return ca.SX(ca.DM(joint.axis))
    known = [values[name] for name in joint.axis.components if name is not None]
    third = joint.axis.sign * ca.sqrt(1 - sum(v**2 for v in known))
    return ca.vertcat(*(third if name is None else values[name] for name in joint.axis.components))


def placed_frame(joint: Joint, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX]) -> ca.SX:
    """Pose (4, 4) of a joint's own frame, before its motion, in the base frame."""
    frame = bodies[joint.parent]
    for step in joint.placement:
        frame = frame @ _step(step.kind, values[step.parameter])
    return frame


def _closing(
    joint: Joint, bodies: Mapping[str, ca.SX], values: Mapping[str, ca.SX], displacement: Mapping[str, ca.SX]
) -> ca.SX:
    """Closure residual of a joint that closes a loop: what of the relative pose its kind forbids."""
    frame = placed_frame(joint, bodies, values)
    if joint.name in displacement:
        frame = frame @ moved_by(joint, displacement[joint.name], values)
    child = bodies[joint.child]
    gap = frame[:3, :3].T @ (child[:3, 3] - frame[:3, 3])
    turn = frame[:3, :3].T @ child[:3, :3]
    if joint.kind == "spherical":
        return gap
    if joint.kind == "universal":
        return ca.vertcat(gap, MM_PER_M * turn[0, 1])  # the cross's axes stay perpendicular
    if joint.kind == "fixed" or joint.name in displacement:
        return ca.vertcat(gap, MM_PER_M * lie.vee(turn))
    axis, across = axis_of(joint, values), across_of(joint)
    if joint.kind == "revolute":
        return ca.vertcat(gap, MM_PER_M * (across @ ca.cross(axis, turn @ axis)))
    return ca.vertcat(across @ ca.cross(axis, gap), MM_PER_M * lie.vee(turn))


def across_of(joint: Joint) -> ca.SX:
    """Two rows (2, 3) across the joint's nominal axis, or across its largest component where it may turn."""
    if isinstance(joint.axis, Direction):
        axis = [float(name is None) for name in joint.axis.components]
    else:
        axis = list(joint.axis)
    return ca.SX(ca.DM(np.linalg.svd(np.reshape(axis, (1, 3)))[2][1:]))


def _step(kind: str, value: ca.SX) -> ca.SX:
    if kind in _TURNS:
        return _TURNS[kind](value)
    at = "xyz".index(kind[1])
    return lie.translation(*(value if k == at else ca.SX(0) for k in range(3)))


def motion_of(values: Mapping[str, ca.SX], frame: str) -> ca.SX:
    """Small error motion of a frame; smooth at zero, where it is the identity."""
    if f"{frame}.motion.x" not in values:
        return ca.SX.eye(4)
    return lie.rpy_transform(
        [values[f"{frame}.motion.{a}"] for a in AXES[:3]], [values[f"{frame}.motion.{a}"] for a in AXES[3:]]
    )


def frame_of(values: Mapping[str, ca.SX], frame: str) -> ca.SX:
    """Pose of ``base``, ``tool`` or a further frame in what it stands in (rpy angles)."""
    return lie.rpy_transform(
        [values[f"{frame}.{a}"] for a in AXES[:3]], [values[f"{frame}.{a}"] for a in AXES[3:]]
    )


def _end(frame: ca.SX, point: tuple[str, str, str] | None, values: Mapping[str, ca.SX]) -> ca.SX:
    return frame[:3, 3] if point is None else in_base(frame, [values[name] for name in point])


def symbols(prefix: str, names: Sequence[str]) -> dict[str, ca.SX]:
    """One scalar symbol a name."""
    return {name: ca.SX.sym(f"{prefix}{name}") for name in names}


@dataclass(frozen=True)
class Statics:
    """Potential (N mm) of all loads as a function of the ports, which are symbols of their own.

    In closed loops ``forces`` are the closure's multipliers, unknowns that ``balance`` determines.
    """

    machine: Machine
    ports: Mapping[str, ca.SX]
    x: ca.SX
    forces: ca.SX
    potentials: Mapping[str, ca.SX]
    still: Still

    @classmethod
    def of(
        cls, machine: Machine, names: Iterable[str], q: Mapping[str, ca.SX], z: Mapping[str, ca.SX], x: ca.SX
    ) -> Statics:
        """Potential of a machine whose ports are ``names``."""
        ports = symbols("u", list(names))
        raw = assemble(machine, ports, q, z, x)
        count = raw.closure.numel()
        forces = ca.SX.sym("force", count) if count else ca.SX(0, 1)
        work = ca.dot(forces, raw.closure)
        potentials = {case: energy + work for case, energy in raw.energies.items()}
        return cls(machine, ports, x, forces, potentials, raw.still)

    def loads(self, values: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        """Conjugate load of every port, by load case and name: N along lengths, N m about angles."""
        out: dict[str, ca.SX] = {}
        for case, potential in self.potentials.items():
            force = self._at(values, -self.still.slope(potential, ca.vertcat(*self.ports.values())))
            out |= {
                f"{case}{name}": force[k] / load_scale(self.machine, name)
                for k, name in enumerate(self.ports)
            }
        return out

    def balance(self, values: Mapping[str, ca.SX]) -> ca.SX:
        """(nx,) zero when the forces hold the passive coordinates where they are."""
        if not self.forces.numel():
            return self.forces
        return self._at(values, self.still.slope(self.potentials[""], self.x))

    def _at(self, values: Mapping[str, ca.SX], expression: ca.SX) -> ca.SX:
        symbols = ca.vertcat(*self.ports.values())
        out: ca.SX = ca.substitute(expression, symbols, ca.vertcat(*(values[name] for name in self.ports)))
        return out


def load_scale(machine: Machine, port: str) -> float:
    """Factor from the unit of a load at a port (N along lengths, N m about angles) to N mm per mm or rad of the port."""
    return MM_PER_M if machine.unit_of(port) == "rad" else 1.0
