"""Parts of an MJCF as the section of a graph, in mm and deg.

A body's frame stands where the axis of its last joint does, a free body's where the tie that it hangs on holds it. That tie
is a joint of the tree; each other one closes a loop: a weld by a fixed joint, a point by a spherical one to a body that has
its origin there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.lie import exp_so3, inverse_pose, pose_of
from truepose.models.machine.mechanism import BASE, JointKind
from truepose.wording import cut, shortened


@dataclass(frozen=True, eq=False)
class PartJoint:
    """A joint of a body: its axis and a point of it (3,) in the body, and its reading (mm or rad) where the file has it."""

    name: str
    kind: JointKind
    axis: Array
    anchor: Array
    reference: float = 0.0
    range: tuple[float, float] | None = None

    def written(self, value: float) -> float:
        """Return a displacement (mm or rad) as a machine file has it, in mm or deg."""
        return float(value if self.kind == "prismatic" else _DEG * value)


@dataclass(frozen=True, eq=False)
class PartBody:
    """A body, its frame in its parent's, and its joints, one after the other."""

    name: str
    parent: int
    frame: Array
    joints: tuple[PartJoint, ...] = ()

    @property
    def free(self) -> bool:
        """Whether nothing but constraints holds it."""
        return any(joint.kind == "free" for joint in self.joints)


@dataclass(frozen=True, eq=False)
class Tie:
    """A constraint between frames in two bodies: ``spherical``: their origins are one point; ``fixed``: they are one frame."""

    name: str
    kind: JointKind
    bodies: tuple[int, int]
    frames: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Tip:
    """Where a machine ends: the frame (4, 4) mm in a body, that of a ``site`` or, where its name is empty, the body's."""

    body: int
    site: str = ""
    frame: Array = field(default_factory=lambda: np.eye(4))


@dataclass(frozen=True)
class Coupling:
    """A joint's displacement (mm or rad) as a polynomial of another's; ``lead`` is empty where it is a constant."""

    joint: str
    lead: str
    coefficients: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Parts:
    """Bodies by their number, the world first and parents before children; ``driven`` is None where the file has no actuator.

    ``sites`` are the named ones. ``unread`` are in words the constraints and actuators that are none of these.
    """

    bodies: tuple[PartBody, ...]
    ties: tuple[Tie, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    driven: frozenset[str] | None = None
    unread: tuple[str, ...] = ()
    sites: tuple[Tip, ...] = ()

    @cached_property
    def places(self) -> Mapping[str, int]:
        """The body of each joint."""
        return {joint.name: k for k, body in enumerate(self.bodies) for joint in body.joints}

    @cached_property
    def poses(self) -> Array:
        """(nbody, 4, 4) of every body in the world as the file places them."""
        out = [self.bodies[0].frame]
        for body in self.bodies[1:]:
            out.append(out[body.parent] @ body.frame)
        return np.array(out)

    def way(self, body: int) -> list[int]:
        """Return the bodies from the world, or from a free body, to this one."""
        out = [body]
        while out[-1] and not self.bodies[out[-1]].free:
            out.append(self.bodies[out[-1]].parent)
        return out[::-1]

    def loop(self, tie: Tie) -> frozenset[int]:
        """Return the bodies with joints that move the two ends of a tie against each other."""
        one, other = (frozenset(self.way(body)) for body in tie.bodies)
        return frozenset(body for body in one ^ other if self.bodies[body].joints)


_NAMED = 10


@dataclass(frozen=True, eq=False)
class Follow:
    """A joint's displacement: ``offset`` + ``ratio`` times that of the joint ``lead``, which none leads; mm and rad."""

    lead: str
    ratio: float
    offset: float


def choose(parts: Parts, tip: Tip, where: str) -> MjcfGraph:
    """Return the machine that ends at ``tip``. Raises InputError, which ``where`` opens, if there is none."""
    kept, ties = _closed_over(parts, tip.body)
    base = _base(parts, kept, ties, tip.body)
    if not any(parts.bodies[b].joints for b in kept - {base}):
        name = cut(parts.bodies[tip.body].name)
        raise InputError(f"{where}: found no joint on the way to {name!r}, expected another --tip")
    bodies = sorted(
        b for b in kept if b != base and (base in parts.way(b) or parts.bodies[parts.way(b)[0]].free)
    )
    graph = MjcfGraph(parts, tip, where, base, tuple(bodies), tuple(ties), _follows(parts, kept, where))
    _check(graph)
    return graph


def _closed_over(parts: Parts, tip: int) -> tuple[set[int], list[Tie]]:
    """Return the bodies on the way to the tip, with all that moves them through ties and couplings, and these ties."""
    kept, size = set(parts.way(tip)), 0
    ties: list[Tie] = []
    while size < len(kept) + len(ties):
        size = len(kept) + len(ties)
        ties = [tie for tie in parts.ties if tie in ties or parts.loop(tie) & kept]
        leads = [c.lead for c in parts.couplings if c.lead and parts.places[c.joint] in kept]
        ends = [*(body for tie in ties for body in tie.bodies), *(parts.places[lead] for lead in leads)]
        kept |= {body for end in ends for body in parts.way(end)}
    return kept, ties


def _base(parts: Parts, kept: set[int], ties: Sequence[Tie], tip: int) -> int:
    """Return the last body that all ways to joints, and to ties, begin with; what a free body carries begins there."""
    tied = {body for tie in ties for body in tie.bodies}
    ways = [parts.way(body) for body in kept | tied]
    fixed = [way for way in ways if not parts.bodies[way[0]].free]
    starts = []
    for way in fixed or [way for way in ways if way[0] == parts.way(tip)[0]]:
        moving = next((k for k, body in enumerate(way) if k and parts.bodies[body].joints), len(way))
        starts += [way[:moving]] if moving < len(way) or way[-1] in tied else []
    shared = [bodies[0] for bodies in zip(*starts, strict=False) if len(set(bodies)) == 1]
    return shared[-1] if shared else tip


def _follows(parts: Parts, kept: Iterable[int], where: str) -> dict[str, Follow]:
    """Return what the joints of these bodies follow. Raises InputError for a polynomial, two leads, and a ring."""
    own = [c for c in parts.couplings if parts.places[c.joint] in kept]
    direct: dict[str, Coupling] = {}
    for c in own:
        said = f"{where}: equality of joint {cut(c.joint)!r}"
        if any(c.coefficients[2:]):
            numbers = " ".join(f"{value:g}" for value in c.coefficients)
            raise InputError(
                f"{said}: found the polynomial {numbers} (mm, rad) of {cut(c.lead)!r}, expected a linear one; type: graph "
                "has others by `computed`"
            )
        if c.joint in direct:
            raise InputError(f"{said}: found a second one, expected one joint that it follows")
        direct[c.joint] = c
    out = {}
    for name in direct:
        ratio, offset, here, seen = 1.0, 0.0, name, set[str]()
        while here in direct:
            if here in seen:
                found = f"that it follows {cut(here)!r}, which follows itself"
                raise InputError(
                    f"{where}: equality of joint {cut(name)!r}: found {found}, expected a joint that leads"
                )
            seen.add(here)
            shift, slope = (*direct[here].coefficients, 0.0)[:2]
            ratio, offset, here = ratio * slope, offset + ratio * shift, direct[here].lead
        out[name] = Follow(here, ratio, offset)
    return out


def _check(graph: MjcfGraph) -> None:
    """Refuse joints that nothing determines. Raises InputError naming them."""
    where, read = graph.where, {joint.name for joint in graph.drives}
    for body, joint in graph.moving:
        if joint.kind in ("spherical", "free") and body not in graph.looped:
            raise InputError(
                f"{where}: joint {cut(joint.name)!r}: found a ball or free joint, expected hinges and slides on the way from "
                "the base to the tip, or a loop that moves it"
            )
    if graph.ties and graph.parts.driven is None:
        names = shortened([cut(repr(tie.name)) for tie in graph.ties], _NAMED)
        raise InputError(
            f"{where}: found loops, closed by the equality constraints {names}, and no actuator, expected an actuator for "
            "each joint that is driven"
        )
    for name, follow in graph.follows.items():
        if follow.lead and follow.lead not in read:
            raise InputError(
                f"{where}: equality of joint {cut(name)!r}: found {cut(follow.lead)!r}, which no actuator drives, expected "
                "a joint with a reading"
            )
    if not read:
        raise InputError(
            f"{where}: found no joint that an actuator drives on the way to the tip, expected one"
        )


_SAME = 1e-9
"""mm; points that are no further apart are one."""
_DEG = 180.0 / np.pi


@dataclass(eq=False)
class MjcfGraph:
    """A machine in an MJCF: its base, its other bodies, parents first, the ties among them, and joints that others lead.

    ``section`` fills the names of the graph's bodies, and its joints.
    """

    parts: Parts
    tip: Tip
    where: str
    base: int
    kept: tuple[int, ...]
    ties: tuple[Tie, ...]
    follows: Mapping[str, Follow]
    bodies: list[str] = field(default_factory=list)
    joints: list[dict[str, Any]] = field(default_factory=list)

    @cached_property
    def looped(self) -> frozenset[int]:
        """Bodies whose joints a loop moves."""
        return frozenset(body for tie in self.ties for body in self.parts.loop(tie))

    @cached_property
    def moving(self) -> list[tuple[int, PartJoint]]:
        """All joints that move a body against another one of the machine, with their bodies."""
        return [(body, joint) for body in self.kept for joint in self.parts.bodies[body].joints]

    @cached_property
    def drives(self) -> list[PartJoint]:
        """Joints with a reading: those that lead themselves, and are driven or in no loop."""
        driven = self.parts.driven or frozenset()
        return [
            joint
            for body, joint in self.moving
            if joint.name not in self.follows and (body not in self.looped or joint.name in driven)
        ]

    def left_out(self) -> tuple[str, ...]:
        """Return in words what the file has and the machine has not."""
        parts = self.parts
        ties = [f"{tie.name!r}" for tie in parts.ties if tie not in self.ties]
        known = {joint.name for _, joint in self.moving}
        ties += [f"of joint {c.joint!r}" for c in parts.couplings if c.joint not in known]
        kept = {0, *self.kept, *parts.way(self.base)}
        off = [cut(body.name, 60) for k, body in enumerate(parts.bodies) if k not in kept]
        lines = [f"bodies that are not on the way to the tip: {shortened(off, _NAMED)}"] if off else []
        lines += [f"equality constraints that move none of these: {shortened(ties, _NAMED)}"] if ties else []
        lines += [shortened(list(parts.unread), _NAMED)] if parts.unread else []
        base = parts.bodies[self.base]
        if base.free:
            lines.append(
                f"the free joint of the body {base.name!r}, which is the base: frames.base says where it stands"
            )
        return tuple(lines)

    def section(self) -> dict[str, Any]:
        """Return the section of the machine. Raises InputError for a free body that no tie holds."""
        self.bodies.append(self.names[self.base])
        for body in self.kept:
            tie = self.held.get(body)
            if tie is None:
                self._add(body)
                continue
            (other,) = set(tie.bodies) - {body}
            self.bodies.append(self.names[body])
            self._join(
                tie.name, tie.kind, self.names[other], self.names[body], self._across(tie, other, body)
            )
        for tie in self.ties:
            if tie not in self.held.values():
                self._close(tie)
        flange, frame = self.names[self.tip.body], self.tip.frame.copy()
        frame[:3, 3] -= self.shifts[self.tip.body]
        if not np.array_equal(frame, np.eye(4)):
            flange = self._fixed(flange, self.tip.site or "tip", frame)
        out: dict[str, Any] = {
            "type": "graph",
            "bodies": self.bodies,
            "flange": flange,
            "joints": self.joints,
        }
        if self.ties:  # where the file has the machine: joints that nothing drives count from there
            out["home"] = {joint.name: joint.written(joint.reference) for joint in self.drives}
        return out

    @cached_property
    def names(self) -> Mapping[int, str]:
        """Names of the bodies; a body called base that is not the first has another one."""
        kept = {k: self.parts.bodies[k].name for k in (self.base, *self.kept)}
        return {k: f"{n}_body" if n == BASE and k != self.base else n for k, n in kept.items()}

    @cached_property
    def held(self) -> Mapping[int, Tie]:
        """The tie that each free body hangs on."""
        parts, out = self.parts, dict[int, Tie]()
        for body in self.kept:
            if not parts.bodies[body].free:
                continue
            found = next((tie for tie in self.ties if body in tie.bodies and tie not in out.values()), None)
            if found is None:
                name = cut(parts.bodies[body].name)
                raise InputError(
                    f"{self.where}: body {name!r}: found a free joint, expected an equality constraint that holds the body"
                )
            out[body] = found
        return out

    @cached_property
    def shifts(self) -> Mapping[int, Array]:
        """Origins (3,) mm of the graph's bodies in the MJCF's."""
        out = {self.base: np.zeros(3)}
        for body in self.kept:
            joints = self.parts.bodies[body].joints
            out[body] = joints[-1].anchor if joints else np.zeros(3)
        for body, tie in self.held.items():
            out[body] = tie.frames[tie.bodies.index(body)][:3, 3]
        return out

    def _add(self, body: int) -> None:
        """A body's joints, each with a body of its own that stands where its anchor is; one without is fixed."""
        part, name = self.parts.bodies[body], self.names[body]
        above, frame = self.names[part.parent], part.frame.copy()
        frame[:3, 3] -= self.shifts[part.parent]
        if not part.joints:
            self.bodies.append(name)
            self._join(f"{name}_joint", "fixed", above, name, frame)
        here = np.zeros(3)
        for k, joint in enumerate(part.joints, start=1):
            frame[:3, 3] += frame[:3, :3] @ (joint.anchor - here)
            child = name if k == len(part.joints) else f"{name}.{k}"
            self.bodies.append(child)
            still = self._stands(joint)
            if still is None:
                self._join(joint.name, joint.kind, above, child, frame, **self._motion(joint))
            else:
                self._join(joint.name, "fixed", above, child, frame @ still)
            above, here, frame = child, joint.anchor, np.eye(4)

    def _stands(self, joint: PartJoint) -> Array | None:
        """Return the motion (4, 4) of a joint that a constraint holds at a constant; None for others."""
        led = self.follows.get(joint.name)
        if led is None or (led.lead and led.ratio):
            return None
        turns, way = joint.kind == "revolute", led.offset * joint.axis
        return pose_of(exp_so3(way * turns), way * (not turns))

    def _motion(self, joint: PartJoint) -> dict[str, Any]:
        """Return how a joint moves: driven, led by another, or passive."""
        if joint.kind == "spherical":
            return {}
        led = self.follows.get(joint.name)
        out: dict[str, Any] = {"axis": joint.axis.tolist()}
        if led is not None:
            offset, ratio = joint.written(led.offset), self._ratio(joint, led)
            return (
                out | {"mimic": {"joint": led.lead, "ratio": ratio}} | ({"offset": offset} if offset else {})
            )
        if joint not in self.drives:
            return out
        out["actuated"] = True
        if joint.reference:  # the file's pose is where the joint reads this much
            out["offset"] = -joint.written(joint.reference)
        if joint.range is not None:
            out["range"] = [joint.written(end) for end in joint.range]
        return out

    def _ratio(self, joint: PartJoint, led: Follow) -> float:
        lead = next(other for _, other in self.moving if other.name == led.lead)
        return led.ratio * joint.written(1.0) / lead.written(1.0)

    def _close(self, tie: Tie) -> None:
        """A joint whose child has its place already."""
        one, other = tie.bodies
        if tie.kind == "spherical" and np.abs(self._origin(tie, 1)).max() > _SAME:
            if np.abs(self._origin(tie, 0)).max() > _SAME:
                child = self._fixed(
                    self.names[other], f"{tie.name}_end", pose_of(np.eye(3), self._origin(tie, 1))
                )
                self._join(tie.name, tie.kind, self.names[one], child, self._across(tie, one, other))
                return
            one, other = other, one
        self._join(tie.name, tie.kind, self.names[one], self.names[other], self._across(tie, one, other))

    def _origin(self, tie: Tie, end: int) -> Array:
        """Return where a tie stands in the graph's body at one of its ends, (3,) mm."""
        out: Array = tie.frames[end][:3, 3] - self.shifts[tie.bodies[end]]
        return out

    def _across(self, tie: Tie, one: int, other: int) -> Array:
        """Return the frame of a joint of a tie from one body to the other, in the one's."""
        at = tie.bodies.index(one)
        here, there = tie.frames[at], tie.frames[1 - at]
        if tie.kind == "fixed":
            out: Array = here @ inverse_pose(there)
            out[:3, 3] += out[:3, :3] @ self.shifts[other]
        else:
            poses = self.parts.poses
            out = inverse_pose(poses[one]) @ poses[other]
            out[:3, 3] = here[:3, 3]
        out[:3, 3] -= self.shifts[one]
        return out

    def _fixed(self, parent: str, name: str, frame: Array) -> str:
        """Fix a further body to one, and return its name."""
        while name in self.bodies:
            name += "_"
        self.bodies.append(name)
        self._join(f"{name}_joint", "fixed", parent, name, frame)
        return name

    def _join(self, name: str, kind: str, parent: str, child: str, frame: Array, **more: Any) -> None:
        taken = {joint["name"] for joint in self.joints} | set(self.parts.places) - {name}
        while name in taken:
            name += "_"
        place = {"xyz": frame[:3, 3].tolist(), "rpy": np.degrees(_rpy(frame[:3, :3])).tolist()}
        self.joints.append({"name": name, "kind": kind, "parent": parent, "child": child, **place, **more})


def _rpy(rotation: Array) -> Array:
    """Roll, pitch, yaw of Rz(yaw) Ry(pitch) Rx(roll); yaw is 0 where the pitch is 90 deg and only a sum is known."""
    across = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = np.arctan2(-rotation[2, 0], across)
    if across < 1e-9:
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])
