"""A mechanism as data: bodies joined by joints, loops closed by rods and closing joints, and actuators.

Every builder (serial chain, hexapod, graph) makes one of these; nothing downstream knows which.
The symbolic work is in ``truepose.models.machine.kinematics``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.file.formula import Law
from truepose.models.file.machine_file import MachineFile
from truepose.models.lie import AXES as AXES  # noqa: PLC0414 -- exported again
from truepose.models.units import UnitSystem, convert
from truepose.wording import close_matches

_COMPONENTS = ("a", "b", "u", "length", "offset", "gain")
_NUMBERED = re.compile(r"^(?P<element>.*?)\d*\.(?P<rest>.+)$")


@dataclass(frozen=True)
class Parameter:
    """One geometric constant, in internal units (mm, rad).

    ``tolerance`` is the 1-sigma statement of the drawing: 0 means exactly known, inf means unknown.
    ``part`` names the class of part whose tolerances were stated together; a wrong statement is
    wrong for the whole class (diagnosis: inflation of tolerances).
    """

    name: str
    unit: str
    nominal: float
    tolerance: float = 0.0
    part: str = "length"
    field: tuple[str | int, ...] = ()
    """Where the value stands in the machine file's document; empty when it stands nowhere."""

    @property
    def free(self) -> bool:
        """Whether the drawing leaves anything to be estimated."""
        return self.tolerance > 0.0

    def written_in(self, units: UnitSystem) -> str:
        """Its unit in a file of such units."""
        return units.of("gain") if self.part == "gain" else units.written(self.unit)

    @property
    def scale(self) -> float:
        """What one step of this parameter is measured in: its tolerance, or a natural size when unknown."""
        if self.free and math.isfinite(self.tolerance):
            return self.tolerance
        return {"mm": 100.0, "rad": 1.0}.get(self.unit, 1.0)


def element_of(name: str) -> str:
    """The part that a parameter, or the end of a rod, is of: ``leg3`` of ``leg3.a.x``."""
    return name.partition(".")[0]


def vector_of(name: str) -> str:
    """What a parameter is a component of: ``leg3.a`` of ``leg3.a.x``; a plain name is its own."""
    return name.rpartition(".")[0] or name


def like_parts(name: str) -> str:
    """What numbered parts have alike: ``leg.a`` of ``leg3.a.x``, ``q`` of ``q4.beta``."""
    match = _NUMBERED.match(name)
    if match is None:
        return name
    head = element_of(match["rest"])
    return f"{match['element']}.{head}" if head in _COMPONENTS else match["element"]


JointKind = Literal["revolute", "prismatic", "universal", "spherical", "free", "fixed"]
COORDINATES: Mapping[str, int] = {
    "revolute": 1,
    "prismatic": 1,
    "universal": 2,
    "spherical": 3,
    "free": 6,
    "fixed": 0,
}
AXIS_UNITS: Mapping[str, str] = dict(zip(AXES, 3 * ("mm",) + 3 * ("rad",), strict=True))
BASE = "base"
Loops = Literal["exact", "linear", "elastic"]
"""How loops close away from home: as geometry says, to first order about home, or where elastic rods balance."""


@dataclass(frozen=True)
class Step:
    """One elementary transform by a named parameter: kind ``tx ty tz`` (mm) or ``rx ry rz`` (rad)."""

    kind: str
    parameter: str


@dataclass(frozen=True)
class Direction:
    """A unit vector two of whose components are parameters; the third follows and keeps its sign."""

    components: tuple[str | None, str | None, str | None]
    sign: float = 1.0
    field: tuple[str | int, ...] = ()
    """Where the third component stands in the machine file's document."""


@dataclass(frozen=True)
class Joint:
    """A joint between two bodies: the child's frame is placement, then the joint's motion.

    ``axis`` is a constant unit vector or a parameterised Direction (universal joints turn about x, then y).
    ``home`` starts the passive coordinates: angles in rad, lengths in mm, spherical and free turns as
    modified Rodrigues parameters. A joint whose child already has a parent closes a loop.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    placement: tuple[Step, ...] = ()
    axis: tuple[float, float, float] | Direction = (0.0, 0.0, 1.0)
    home: tuple[float, ...] = ()


@dataclass(frozen=True)
class Flexures:
    """The two flexures that a rod has in place of ball joints, as beam theory bends them.

    ``length`` (mm) and ``shape`` (beta of ``truepose.models.machine.assembly``) are parameters; ``axis_a`` and ``axis_b`` are
    the unit vector along the straight rod, in the frames of its two bodies.
    """

    length: str
    shape: str
    axis_a: tuple[float, float, float]
    axis_b: tuple[float, float, float]


@dataclass(frozen=True)
class ElasticChain:
    """A rod as flexure, bar, flexure, clamped to its bodies: the parameters of ``truepose.models.machine.near_home``.

    ``flexure`` and ``bar`` name bending EI (N mm^2), tension EA (N) and torsion GJ (N mm^2) of a section;
    ``stiffness`` (N/mm) is the rod's nominal one in tension; ``follows`` says that the rod stretches along the
    direction it has, not the one at home.
    """

    flexure_length: str
    flexure: tuple[str, str, str]
    bar: tuple[str, str, str]
    stiffness: float
    follows: bool = False


@dataclass(frozen=True)
class Rod:
    """A link between ball centres on two bodies: one closure equation, distance = length.

    Points are given by three parameters each, in their body's frame (None: its origin); ``length`` is a
    parameter, or None when an actuator sets it. ``flexures`` bend in place of ball joints; an ``elastic`` rod
    has its length at home, where nothing is strained.
    """

    name: str
    body_a: str
    point_a: tuple[str, str, str] | None
    body_b: str
    point_b: tuple[str, str, str] | None
    length: str | None
    nominal_length: float
    flexures: Flexures | None = None
    elastic: ElasticChain | None = None


@dataclass(frozen=True)
class Actuator:
    """What a reading drives: displacement = offset + gain * reading of joint (or rod) ``drives``.

    ``unit`` is that of the displacement (mm or rad), ``reading_unit`` that of the column (mm, rad, turn).
    ``range`` limits readings; gear ratio and pitch (mm) tell effects what turns inside; ``home`` is the own motion
    from which the assembly of closed loops is followed. ``counted`` is the unit of a column of encoder counts; ``wrap``
    (reading unit) is what readings come modulo, stated without a unit if ``plain_wrap``; ``coupled`` is what a unit of other
    joints' readings adds to this one: recorded J3 = own angle of J3 + k * recorded J2 (``resolve_couplings``).
    """

    reading: str
    drives: str
    unit: str
    reading_unit: str
    offset: str | None = None
    gain: str | None = None
    range: tuple[float, float] | None = None
    gear_ratio: float | None = None
    screw_pitch: float | None = None
    home: float | None = None
    counted: str | None = None
    wrap: float | None = None
    plain_wrap: bool = False
    coupled: Mapping[str, float] = field(default_factory=dict)
    reads: tuple[float, float] | None = None

    @property
    def reading_range(self) -> tuple[float, float] | None:
        """Lowest and highest reading: ``range``, which is the joint's own, and what coupled joints add to it."""
        return self.reads if any(self.coupled.values()) else self.range

    @property
    def displacement(self) -> str:
        """Name of the port that adds to the displacement."""
        return f"{self.reading}.displacement"

    @property
    def zero(self) -> str:
        """Name of the constant that says where the joint is when its reading is 0."""
        return self.offset or f"{self.drives}.{'theta' if self.unit == 'rad' else 'r'}"


@dataclass(frozen=True)
class Follower:
    """A joint without a reading that driven ones carry along: displacement = offset + sum of ratio * their displacements.

    ``terms`` are (reading of the driven joint, parameter of the ratio); ``unit`` is that of the displacement (mm or rad). A
    ``law`` stands in place of the sum.
    """

    joint: str
    unit: str
    offset: str
    terms: tuple[tuple[str, str], ...]
    law: Law | None = None


@dataclass(frozen=True)
class Limb:
    """A leg of a parallel machine as effects see it: the ports of its ends and of its length."""

    name: str
    reading: str
    base_point: tuple[str, ...]
    platform_point: tuple[str, ...]
    length: str


@dataclass(frozen=True)
class Inertial:
    """What a body weighs by the description that the mechanism was read from: kg, and its centre in the body's frame, mm."""

    body: str
    kg: float
    com: tuple[float, float, float]


@dataclass(frozen=True)
class Mechanism:
    """Bodies, joints, loops and actuators with their named parameters.

    ``lengths`` says which ports heat up together at a place (``base``, ``link2``, ``leg1``, ``platform``).
    ``limbs`` are the legs, for effects on legs and platform. ``flange`` is the body that carries the tool.
    ``flexure_length`` (mm) is given where joints are flexures: they bend what they are fixed to.
    ``expanded`` is the section of the same mechanism as a graph, in the file's units, where the file's own
    form has no field for every parameter; ``tool_length`` (mm) is how far along the flange's z the tool frame
    stands where the file gives none. ``loops`` says how loops close away from home; ``elastic`` needs elastic rods.
    ``home_directions`` are unit vectors along what joint ends carry, as drawn (``truepose.models.machine.kinematics``);
    the loading of a machine adds them. ``inertials`` are what the mechanism's own description says of masses,
    ``gravity`` (m/s^2, base frame) of gravity; ``notes`` is what a user should know of how they were read.
    ``table_frames`` are a (mm) and alpha (rad) of TransX(a) RotX(alpha) from a body's frame to the one that the file
    means by its name, where they differ (standard Denavit-Hartenberg).
    """

    parameters: tuple[Parameter, ...]
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    flange: str
    rods: tuple[Rod, ...] = ()
    limbs: tuple[Limb, ...] = ()
    lengths: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    platform: str | None = None
    flexure_length: float | None = None
    expanded: Mapping[str, Any] | None = None
    tool_length: float = 0.0
    loops: Loops = "exact"
    home_directions: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    inertials: tuple[Inertial, ...] = ()
    gravity: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()
    table_frames: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    followers: tuple[Follower, ...] = ()

    @cached_property
    def tree(self) -> tuple[Joint, ...]:
        """Joints that give a body its pose, in an order in which parents come first."""
        placed, pending, order = {BASE}, list(self.joints), []
        children: set[str] = {BASE}
        while pending:
            ready = next((j for j in pending if j.parent in placed and j.child not in children), None)
            if ready is None:
                break
            pending.remove(ready)
            order.append(ready)
            placed.add(ready.child)
            children.add(ready.child)
        return tuple(order)

    @property
    def closing(self) -> tuple[Joint, ...]:
        """Joints whose child already has a parent: each closes a loop."""
        tree = {joint.name for joint in self.tree}
        return tuple(joint for joint in self.joints if joint.name not in tree)

    @property
    def readings(self) -> tuple[str, ...]:
        """Column names of the actuated joints, in order."""
        return tuple(actuator.reading for actuator in self.actuators)

    @property
    def rod_ends(self) -> Mapping[str, Rod]:
        """The rod of each of its ends ``R.a``, ``R.b``, as effects name them."""
        return {f"{rod.name}.{end}": rod for rod in self.rods for end in "ab"}

    @property
    def reading_units(self) -> Mapping[str, str]:
        """Unit of each reading's column: mm, rad or turn."""
        return {actuator.reading: actuator.reading_unit for actuator in self.actuators}

    @property
    def passive(self) -> tuple[Joint, ...]:
        """Joints of the tree that no reading moves and that can move."""
        return tuple(j for j in self.tree if j.name not in self.driven and COORDINATES[j.kind])

    @property
    def driven(self) -> frozenset[str]:
        """What readings move: joints and rods of actuators, and the joints that follow."""
        return frozenset((*(a.drives for a in self.actuators), *(f.joint for f in self.followers)))

    @property
    def unknown(self) -> tuple[Joint, ...]:
        """Joints whose coordinates the closure determines, in order: passive ones, again as they are at home."""
        return self.passive if self.loops == "exact" else (*self.passive, *self.passive)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Base first, then the bodies of the tree."""
        return (BASE, *(joint.child for joint in self.tree))

    def actuator(self, reading: str) -> Actuator:
        """The actuator of a reading; InputError where there is none."""
        for actuator in self.actuators:
            if actuator.reading == reading:
                return actuator
        raise InputError(f"found no joint {reading!r}, expected one of {', '.join(self.readings)}")

    def joint(self, name: str) -> Joint:
        """Return the joint of a name, which is there."""
        return next(joint for joint in self.joints if joint.name == name)

    def way(self, body: str) -> list[Joint]:
        """Return the joints of the tree from the base to a body."""
        above, out = {joint.child: joint for joint in self.tree}, list[Joint]()
        while body in above:
            out.insert(0, above[body])
            body = above[body].parent
        return out


@dataclass(frozen=True)
class Part:
    """Joints in a row, from one outwards, and the body at which the row ends."""

    joints: tuple[Joint, ...]
    end: str


def looped(mechanism: Mechanism) -> frozenset[str]:
    """Names of the joints that are part of a loop.

    They lie on the ways from both ends of a closing joint, or of a rod, to the body where the ways meet.
    """
    ends = [(joint.parent, joint.child) for joint in mechanism.closing]
    ends += [(rod.body_a, rod.body_b) for rod in mechanism.rods]
    ways = [[{joint.name for joint in mechanism.way(body)} for body in pair] for pair in ends]
    inside = {name for one, two in ways for name in one ^ two}
    return frozenset(inside | {joint.name for joint in mechanism.closing})


def serial_part(mechanism: Mechanism, joint: Joint) -> tuple[Part, Part]:
    """From a joint to where the mechanism branches or ends: one part through its parent, one through its child.

    Both parts open with the joint itself.
    """
    return _outwards(mechanism, joint, joint.parent), _outwards(mechanism, joint, joint.child)


def around(mechanism: Mechanism, body: str) -> list[Joint]:
    """Joints that join a body to others."""
    return [joint for joint in mechanism.joints if body in {joint.parent, joint.child}]


def _outwards(mechanism: Mechanism, start: Joint, body: str) -> Part:
    row = [start]
    while body not in {BASE, mechanism.flange}:
        here = around(mechanism, body)
        if len(here) != 2:
            break
        row.append(next(joint for joint in here if joint.name != row[-1].name))
        body = row[-1].child if row[-1].parent == body else row[-1].parent
    return Part(tuple(row), body)


Range = tuple[float, float]
_SINGULAR = 1e-9
"""Determinant below which readings do not tell the joints' own motions."""


def resolve_couplings(mechanism: Mechanism, file: MachineFile) -> Mechanism:
    """Return the mechanism with couplings in the units of its readings. Raises InputError for what cannot be coupled."""
    known, actuators = mechanism.reading_units, []
    for actuator in mechanism.actuators:
        where = f"{file.path}: mechanism: joint {actuator.reading!r}: coupled"
        factors = {}
        for other, factor in actuator.coupled.items():
            if other not in known or other == actuator.reading:
                others = [name for name in known if name != actuator.reading]
                raise InputError(
                    f"{where}: found {other!r}, expected another joint that is read; {close_matches(other, others)}"
                )
            own, theirs = (file.units.of_joint(unit) for unit in (actuator.reading_unit, known[other]))
            scale = convert(1.0, own, actuator.reading_unit) / convert(1.0, theirs, known[other])
            factors[other] = factor * scale
        actuators.append(replace(actuator, coupled=factors))
    stated = {actuator.reading: actuator.range for actuator in actuators}
    actuators = [replace(actuator, reads=_recorded_range(actuator, stated)) for actuator in actuators]
    found = replace(mechanism, actuators=tuple(actuators))
    matrix = coupling_matrix(found)
    if matrix is not None and abs(np.linalg.det(matrix)) < _SINGULAR:
        raise InputError(
            f"{file.path}: mechanism: found joints {', '.join(_coupled(found))} coupled to each other so that their "
            "readings do not tell their own motions, expected couplings one way"
        )
    return found


def _recorded_range(actuator: Actuator, stated: Mapping[str, Range | None]) -> Range | None:
    """Return what a joint can read: its own range, as a data sheet states it, and what others add to it within theirs."""
    if actuator.range is None:
        return None
    low, high = actuator.range
    for other, factor in actuator.coupled.items():
        theirs = stated[other]
        if factor and theirs is None:
            return None
        theirs = theirs or (0.0, 0.0)
        ends = sorted(factor * end for end in theirs)
        low, high = low + ends[0], high + ends[1]
    return low, high


def coupling_matrix(mechanism: Mechanism) -> Array | None:
    """Return the matrix (nq, nq) that takes readings to the joints' own motions; None where they are the same."""
    if not _coupled(mechanism):
        return None
    place, out = {name: k for k, name in enumerate(mechanism.readings)}, np.eye(len(mechanism.readings))
    for actuator in mechanism.actuators:
        for other, factor in actuator.coupled.items():
            out[place[actuator.reading], place[other]] -= factor
    out.setflags(write=False)
    return out


def own_motions(mechanism: Mechanism, readings: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Return each joint's own motion by name, in the unit of its reading: what is recorded, less what others add to it."""
    out = dict(readings)
    for actuator in mechanism.actuators:
        for other, factor in actuator.coupled.items():
            out[actuator.reading] -= factor * readings[other]
    return out


def recorded_reading(mechanism: Mechanism, reading: str, own: Mapping[str, ca.SX]) -> ca.SX:
    """Return what a joint's encoder reads, of all joints' own motions."""
    matrix = coupling_matrix(mechanism)
    if matrix is None:
        return own[reading]
    row = np.linalg.inv(matrix)[mechanism.readings.index(reading)]
    return sum((float(r) * own[name] for r, name in zip(row, mechanism.readings, strict=True) if r), ca.SX(0))


def turns_freely(mechanism: Mechanism, reading: str) -> bool:
    """Return whether a whole turn of a reading leaves the machine where it is."""
    actuator = mechanism.actuator(reading)
    moved = [other.coupled.get(reading, 0.0) for other in mechanism.actuators if other.unit == "rad"]
    slides = any(other.coupled.get(reading) for other in mechanism.actuators if other.unit != "rad")
    whole = not slides and all(float(factor).is_integer() for factor in moved)
    return actuator.unit == "rad" and actuator.gain is None and whole


def _coupled(mechanism: Mechanism) -> list[str]:
    return [actuator.reading for actuator in mechanism.actuators if any(actuator.coupled.values())]
