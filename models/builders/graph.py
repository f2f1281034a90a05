"""Any mechanism, open or closed: bodies and joints; a joint whose child already has a parent closes a loop.

Every joint's frame has six parameters (``J.x ... J.rz``), so that the error model is complete whatever the
mechanism; many of them are redundant, and tolerances decide how they share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from truepose.errors import InputError
from truepose.models.builders.driven import (
    Driven,
    Encoder,
    Mimic,
    check_lengths,
    law_of,
    ratio_name,
    ratio_unit,
)
from truepose.models.file.fields import (
    AngleVector,
    In,
    Length,
    LengthVector,
    Number,
    Section,
    Vector,
    bad_value,
)
from truepose.models.lie import unit_vector
from truepose.models.machine.builder import BuildContext, builders
from truepose.models.machine.mechanism import (
    BASE,
    COORDINATES,
    Follower,
    Joint,
    Limb,
    Mechanism,
    Parameter,
    Part,
    Step,
    around,
    looped,
    serial_part,
)
from truepose.models.units import convert
from truepose.wording import close_matches

_XYZ = ("x", "y", "z")
_HUB = 3
"""From so many joints on a body is where limbs meet."""


def limbs_of(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """The mechanism with a limb for every actuated sliding joint inside a loop.

    A limb is the serial part around the joint, up to bodies where the graph branches. ``names`` gives limbs
    other names than their joint's.
    """
    joints = {joint.name: joint for joint in mechanism.joints}
    limbs = []
    for actuator in mechanism.actuators:
        joint = joints[actuator.drives]
        if joint.kind == "prismatic" and joint.name in looped(mechanism):
            ends = [_end(part) for part in serial_part(mechanism, joint)]
            name = names.get(joint.name, joint.name)
            limbs.append(Limb(name, actuator.reading, ends[0], ends[1], actuator.displacement))
    return replace(mechanism, limbs=tuple(limbs))


def thermal_lengths(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """The mechanism with the ports that heat up together: those of a body's joints; a limb's own length.

    A body heats up what lies between the joints that stand in it; a limb, named as in ``limbs_of``, what lies
    inside it.
    """
    inside = _inside(mechanism)
    taken = {joint for own in inside.values() for joint in own}
    lengths = {limb.reading: limb.length for limb in mechanism.limbs}
    out: dict[str, tuple[str, ...]] = {}
    for body in mechanism.bodies:
        own = [j.name for j in mechanism.joints if _stands_in(mechanism, j) == body and j.name not in taken]
        out[body] = tuple(port for joint in own for port in _point(joint))
    for reading, own in inside.items():
        length = (lengths[reading],) if reading in lengths else ()
        limb = names.get(reading, reading)
        out[limb] = (*out.get(limb, ()), *length, *(port for joint in own for port in _point(joint)))
    return replace(mechanism, lengths={place: ports for place, ports in out.items() if ports})


def _inside(mechanism: Mechanism) -> dict[str, list[str]]:
    """Joints whose frames stand in the bodies of each actuated limb, by reading; of two actuators the first's."""
    joints, out = {joint.name: joint for joint in mechanism.joints}, dict[str, list[str]]()
    closed, taken = looped(mechanism), set[str]()
    for actuator in mechanism.actuators:
        joint = joints[actuator.drives]
        if joint.name not in closed:
            continue
        parts = serial_part(mechanism, joint)
        ends = {part.end for part in parts}
        row = dict.fromkeys(j.name for part in parts for j in part.joints)
        own = [n for n in row if n not in taken and _stands_in(mechanism, joints[n]) not in ends]
        taken |= set(own)
        out[actuator.reading] = own
    return out


def _stands_in(mechanism: Mechanism, joint: Joint) -> str:
    """The body that a joint's frame is part of: its parent.

    The end piece of a limb, fixed to the body where limbs meet, is part of that body, whichever way it is told.
    """
    if joint.kind != "fixed":
        return joint.parent
    piece = len(around(mechanism, joint.parent)) == 2 and len(around(mechanism, joint.child)) >= _HUB
    return joint.child if piece else joint.parent


def _end(part: Part) -> tuple[str, ...]:
    """Coordinates of a limb's end where they are told in the frame of the body that it ends at, else none."""
    return _point(part.joints[-1].name) if part.joints[-1].parent == part.end else ()


def _point(joint: str) -> tuple[str, ...]:
    return tuple(f"{joint}.{axis}" for axis in _XYZ)


_PLACEMENT = (("tx", "x"), ("ty", "y"), ("tz", "z"), ("rz", "rz"), ("ry", "ry"), ("rx", "rx"))
"""Steps of a joint's frame: Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll)."""
_ONE_AXIS = ("revolute", "prismatic")
FLANGE = "flange"
PLATFORM = "platform"

Home = Annotated[float | tuple[float, ...], Field()]


class GraphJoint(Driven):
    """A joint: its frame in the parent (``xyz``, ``rpy``), then its motion about or along ``axis``."""

    name: str = Field(min_length=1)
    """Name of the joint and, if it is actuated, of the recording's column of its readings."""
    kind: Literal["revolute", "prismatic", "universal", "spherical", "fixed"]
    """How it moves: universal joints turn about x, then y of their frame; fixed joints do not move."""
    parent: str
    """Body that carries the joint."""
    child: str
    """Body that it moves. A child that already has a parent closes a loop."""
    xyz: LengthVector = (0.0, 0.0, 0.0)
    """Where the joint's frame stands in the parent."""
    rpy: AngleVector = (0.0, 0.0, 0.0)
    """How the joint's frame is turned in the parent: Rz(yaw) Ry(pitch) Rx(roll)."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Axis of a revolute or prismatic joint, in the joint's frame; its length does not count."""
    actuated: bool = False
    """Whether it is driven and its reading recorded; revolute and prismatic joints only."""
    mimic: Mimic | tuple[Mimic, ...] = ()
    """It has no reading: `{joint: q2, ratio: -1}` moves it with that joint; several in a list add up."""
    computed: str | None = None
    """It has no reading: a formula of driven joints, `90 - q2 - q3`, in the file's units; see below."""
    lengths: dict[str, Length] = Field(default_factory=dict)
    """Lengths that the formula names, such as a linkage's bars: parameters `J.NAME`."""
    offset: Annotated[Number, In("reading")] = 0.0
    """Added to the reading, or to what `mimic` or `computed` says."""

    @model_validator(mode="after")
    def _sound(self) -> GraphJoint:
        for key in Encoder.model_fields:
            if getattr(self, key) and not self.actuated:
                raise bad_value(
                    f"{key} beside `actuated: true`: no other joint has a column", getattr(self, key)
                )
        if self.actuated and self.kind not in _ONE_AXIS:
            raise bad_value("actuated: true on a revolute or prismatic joint only", self.kind)
        if self.follows and (self.actuated or self.kind not in _ONE_AXIS):
            raise bad_value("mimic on a revolute or prismatic joint that is not actuated", self.kind)
        if self.computed is not None and (self.actuated or self.follows or self.kind not in _ONE_AXIS):
            raise bad_value(
                "computed on a revolute or prismatic joint without `actuated` or `mimic`", self.kind
            )
        if self.lengths and self.computed is None:
            raise bad_value("lengths beside `computed`, whose formula names them", dict(self.lengths))
        if not any(self.axis):
            raise bad_value("axis: a direction", self.axis)
        return self

    @property
    def dimension(self) -> str:
        """Dimension of the displacement: ``length`` or ``angle``."""
        return "length" if self.kind == "prismatic" else "angle"

    @property
    def unit(self) -> str:
        """Internal unit of the displacement."""
        return "mm" if self.kind == "prismatic" else "rad"

    @property
    def follows(self) -> tuple[Mimic, ...]:
        """The joints that carry it along by a ratio."""
        return (self.mimic,) if isinstance(self.mimic, Mimic) else self.mimic

    @property
    def carried(self) -> bool:
        """Whether others move it: by ratios or by a formula."""
        return bool(self.follows) or self.computed is not None


class Graph(Section):
    """The section ``mechanism`` of a graph.

    ``limbs`` may name the limb of an actuated joint; ``flange`` the body that carries the tool, where it is neither
    called so nor the last one.
    """

    type: Literal["graph"]
    """Any mechanism, open or closed: bodies and the joints between them."""
    bodies: tuple[str, ...]
    """Names of the bodies; the first is the base."""
    joints: tuple[GraphJoint, ...]
    """The joints, parents before children."""
    flange: str | None = None
    """Body that carries the tool: by default the one called `flange`, else the last one."""
    home: Annotated[dict[str, Home], In("reading")] = Field(default_factory=dict)
    """Where the loops close, nearly, by joint: a number; two of a universal, three (roll, pitch, yaw) of a spherical one."""
    limbs: dict[str, str] = Field(default_factory=dict)
    """Names of limbs, `leg1: q1`: places of effects on the limb of that actuated joint."""


@builders.add("graph")
def graph(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
    """Mechanism of bodies and joints; the base is the first body, the flange the one named or called so, else the last."""
    return mechanism_of(context.parse(Graph, section), context)


def mechanism_of(parsed: Graph, context: BuildContext) -> Mechanism:
    """The mechanism of a checked graph. Raises InputError naming joint and body."""
    _check(parsed, context)
    base = parsed.bodies[0]
    home = _homes(parsed, context)
    parameters, joints, actuators = [], [], []
    for k, joint in enumerate(parsed.joints):
        parameters += _parameters(k, joint, {other.name: other for other in parsed.joints}, context)
        placement = tuple(Step(kind, f"{joint.name}.{axis}") for kind, axis in _PLACEMENT)
        parent, child = (BASE if end == base else end for end in (joint.parent, joint.child))
        axis = unit_vector(joint.axis).tolist()
        start = () if joint.actuated or joint.carried else home.get(joint.name, ())
        joints.append(Joint(joint.name, joint.kind, parent, child, placement, tuple(axis), start))
        if joint.actuated:
            own, offset = home.get(joint.name), f"{joint.name}.offset"
            actuators.append(
                joint.actuator(
                    joint.name,
                    joint.name,
                    joint.dimension,
                    context,
                    offset=offset,
                    home=own[0] if own else None,
                )
            )
    mechanism = Mechanism(
        tuple(parameters),
        tuple(joints),
        tuple(actuators),
        parsed.flange or (FLANGE if FLANGE in parsed.bodies else parsed.bodies[-1]),
        platform=PLATFORM if PLATFORM in parsed.bodies else None,
        followers=tuple(_follower(k, parsed, context) for k, j in enumerate(parsed.joints) if j.carried),
    )
    _check_reach(mechanism, parsed, context)
    named = {joint: limb for limb, joint in parsed.limbs.items()}
    return thermal_lengths(limbs_of(mechanism, named), named)


def _parameters(
    place: int, joint: GraphJoint, others: Mapping[str, GraphJoint], context: BuildContext
) -> list[Parameter]:
    out = [*context.vector(joint.name, (*joint.xyz, *joint.rpy), ("joints", place))]
    if joint.actuated or joint.carried:
        offset = context.file.units.to_internal(joint.offset, joint.dimension)
        out.append(context.parameter(f"{joint.name}.offset", joint.unit, offset, ("joints", place, "offset")))
    for name, length in joint.lengths.items():
        bar = ("joints", place, "lengths", name)
        out.append(context.parameter(f"{joint.name}.{name}", "mm", length, bar, default=0.0))
    for k, mimic in enumerate(joint.follows):
        unit = ratio_unit(joint.unit, others[mimic.joint].unit)
        own = context.file.units.written(unit)
        at = () if isinstance(joint.mimic, Mimic) else (k,)
        value, field = convert(mimic.ratio, own, unit), ("joints", place, "mimic", *at, "ratio")
        name = ratio_name(joint.name, mimic.joint)
        out.append(context.parameter(name, unit, value, field, "ratio", default=0.0))
    return out


def _follower(place: int, parsed: Graph, context: BuildContext) -> Follower:
    joint = parsed.joints[place]
    terms = tuple((mimic.joint, ratio_name(joint.name, mimic.joint)) for mimic in joint.follows)
    driven = {other.name: other.dimension for other in parsed.joints if other.actuated}
    where = f"{context.where}.joints[{place}]"
    law = None
    if joint.computed is not None:
        check_lengths(joint.lengths, driven, where)
        law = law_of(joint.computed, joint.name, joint.dimension, driven, joint.lengths, context, where)
    return Follower(joint.name, joint.unit, f"{joint.name}.offset", terms, law)


def _homes(parsed: Graph, context: BuildContext) -> dict[str, tuple[float, ...]]:
    """Home of each joint that has one, in internal units; angles of a spherical joint as roll pitch yaw."""
    joints = {joint.name: joint for joint in parsed.joints}
    out = {}
    for name, value in parsed.home.items():
        if name not in joints:
            raise InputError(f"{context.where}.home: found joint {name!r}; {close_matches(name, joints)}")
        values = value if isinstance(value, tuple) else (value,)
        size = COORDINATES[joints[name].kind]
        if len(values) != size:
            raise InputError(
                f"{context.where}.home.{name}: found {len(values)} numbers, expected {size} of a "
                f"{joints[name].kind} joint"
            )
        turned = tuple(context.file.units.to_internal(v, joints[name].dimension) for v in values)
        out[name] = (
            tuple(Rotation.from_euler("xyz", turned).as_mrp().tolist())
            if joints[name].kind == "spherical"
            else turned
        )
    return out


def _check(parsed: Graph, context: BuildContext) -> None:
    where = context.where
    for what, names in (("bodies", parsed.bodies), ("joints", [j.name for j in parsed.joints])):
        twice = sorted({n for n in names if list(names).count(n) > 1})
        if twice or not names:
            found = f"{twice[0]!r} twice" if twice else "none"
            raise InputError(f"{where}.{what}: found {found}, expected at least one, each with its own name")
    if parsed.flange is not None and parsed.flange not in parsed.bodies:
        hint = close_matches(parsed.flange, parsed.bodies)
        raise InputError(f"{where}.flange: found {parsed.flange!r}, expected a body; {hint}")
    if BASE in parsed.bodies[1:]:
        raise InputError(f"{where}.bodies: found {BASE!r} after {parsed.bodies[0]!r}, expected it first")
    for k, joint in enumerate(parsed.joints):
        for end in ("parent", "child"):
            body = getattr(joint, end)
            if body not in parsed.bodies:
                hint = close_matches(body, parsed.bodies)
                raise InputError(f"{where}.joints[{k}].{end}: found {body!r}, expected a body; {hint}")
        _check_mimic(k, joint, parsed, where)
        if joint.parent == joint.child:
            raise InputError(f"{where}.joints[{k}]: found {joint.name!r} between {joint.parent!r} and itself")
    for limb, joint_name in parsed.limbs.items():
        if joint_name not in {j.name for j in parsed.joints if j.actuated}:
            raise InputError(f"{where}.limbs.{limb}: found {joint_name!r}, expected an actuated joint")


def _check_mimic(place: int, joint: GraphJoint, parsed: Graph, where: str) -> None:
    """What a joint follows must have a reading, and be named once."""
    driven = [other.name for other in parsed.joints if other.actuated]
    for k, mimic in enumerate(joint.follows):
        at = "" if isinstance(joint.mimic, Mimic) else f"[{k}]"
        field = f"{where}.joints[{place}].mimic{at}.joint"
        if mimic.joint not in driven:
            hint = close_matches(mimic.joint, driven)
            raise InputError(
                f"{field}: found {mimic.joint!r}, expected a joint with `actuated: true`; {hint}"
            )
        if mimic.joint in [other.joint for other in joint.follows[:k]]:
            raise InputError(f"{field}: found {mimic.joint!r} a second time, expected one ratio a joint")


def _check_reach(mechanism: Mechanism, parsed: Graph, context: BuildContext) -> None:
    """Every body must hang on the base, and something must move."""
    lost = [b for b in parsed.bodies[1:] if b not in mechanism.bodies]
    if lost:
        raise InputError(
            f"{context.where}.joints: found no joints from {parsed.bodies[0]!r} to body {lost[0]!r}, "
            "expected parents before children, starting at the base"
        )
    if not mechanism.actuators:
        raise InputError(
            f"{context.where}.joints: found no joint with `actuated: true`, expected at least one"
        )
