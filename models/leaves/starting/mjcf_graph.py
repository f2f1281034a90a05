"""Parts of an MJCF as the section of a graph, in mm and deg.

A body's frame stands where the axis of its last joint does, a free body's where the tie that it hangs on holds it. That tie
is a joint of the tree; each other one closes a loop: a weld by a fixed joint, a point by a spherical one to a body that has
its origin there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.starting.mjcf_choice import Choice, Follow
from truepose.models.leaves.starting.mjcf_parts import PartJoint, Tie, Tip
from truepose.models.lie import exp_so3, inverse_pose, pose_of
from truepose.models.machine.mechanism import BASE
from truepose.wording import cut

_SAME = 1e-9
"""mm; points that are no further apart are one."""
_DEG = 180.0 / np.pi


@dataclass
class MjcfGraph:
    """The graph of a choice; ``shifts`` are the origins (3,) mm of its bodies in the MJCF's."""

    choice: Choice
    where: str
    bodies: list[str] = field(default_factory=list)
    joints: list[dict[str, Any]] = field(default_factory=list)

    def section(self, tip: Tip) -> dict[str, Any]:
        """Return the section of the machine that ends at ``tip``. Raises InputError for a free body that no tie holds."""
        self.bodies.append(self.names[self.choice.base])
        for body in self.choice.bodies:
            if body in self.held:
                self._hang(body)
            else:
                self._add(body)
        for tie in self.choice.ties:
            if tie not in self.held.values():
                self._close(tie)
        flange, frame = self.names[tip.body], tip.frame.copy()
        frame[:3, 3] -= self.shifts[tip.body]
        if not np.array_equal(frame, np.eye(4)):
            flange = self._fixed(flange, tip.site or "tip", frame)
        out: dict[str, Any] = {
            "type": "graph",
            "bodies": self.bodies,
            "flange": flange,
            "joints": self.joints,
        }
        if self.choice.ties:  # where the file has the machine: joints that nothing drives count from there
            drives = [joint for body, joint in self.choice.joints if self.choice.drives(body, joint)]
            out["home"] = {joint.name: _written(joint, joint.reference) for joint in drives}
        return out

    @property
    def pose(self) -> Array:
        """The base (4, 4) mm in the world."""
        out: Array = self.choice.parts.poses[self.choice.base]
        return out

    @cached_property
    def names(self) -> Mapping[int, str]:
        """Names of the bodies; a body called base that is not the first has another one."""
        kept = {k: self.choice.parts.bodies[k].name for k in (self.choice.base, *self.choice.bodies)}
        return {k: f"{n}_body" if n == BASE and k != self.choice.base else n for k, n in kept.items()}

    @cached_property
    def held(self) -> Mapping[int, Tie]:
        """The tie that each free body hangs on."""
        parts, out = self.choice.parts, dict[int, Tie]()
        for body in self.choice.bodies:
            if not parts.bodies[body].free:
                continue
            found = next(
                (tie for tie in self.choice.ties if body in tie.bodies and tie not in out.values()), None
            )
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
        out = {self.choice.base: np.zeros(3)}
        for body in self.choice.bodies:
            joints = self.choice.parts.bodies[body].joints
            out[body] = joints[-1].anchor if joints else np.zeros(3)
        for body, tie in self.held.items():
            out[body] = tie.frames[tie.bodies.index(body)][:3, 3]
        return out

    def _hang(self, body: int) -> None:
        """A free body at the tie that holds it."""
        tie = self.held[body]
        at = tie.bodies.index(body)
        other = tie.bodies[1 - at]
        frame = self._across(tie, other, body)
        self.bodies.append(self.names[body])
        self._join(tie.name, tie.kind, self.names[other], self.names[body], frame)

    def _add(self, body: int) -> None:
        """A body's joints, each with a body of its own that stands where its anchor is; one without is fixed."""
        part, name = self.choice.parts.bodies[body], self.names[body]
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
                self._join(joint.name, joint.kind, above, child, frame, **self._moving(body, joint))
            else:
                self._join(joint.name, "fixed", above, child, frame @ still)
            above, here, frame = child, joint.anchor, np.eye(4)

    def _stands(self, joint: PartJoint) -> Array | None:
        """Return the motion (4, 4) of a joint that a constraint holds at a constant; None for others."""
        led = self.choice.follows.get(joint.name)
        if led is None or (led.lead and led.ratio):
            return None
        turns, way = joint.kind == "revolute", led.offset * joint.axis
        return pose_of(exp_so3(way * turns), way * (not turns))

    def _moving(self, body: int, joint: PartJoint) -> dict[str, Any]:
        """Return how a joint moves: driven, led by another, or passive."""
        if joint.kind == "spherical":
            return {}
        led = self.choice.follows.get(joint.name)
        out: dict[str, Any] = {"axis": joint.axis.tolist()}
        if led is not None:
            offset, ratio = _written(joint, led.offset), self._ratio(joint, led)
            return (
                out | {"mimic": {"joint": led.lead, "ratio": ratio}} | ({"offset": offset} if offset else {})
            )
        if not self.choice.drives(body, joint):
            return out
        out["actuated"] = True
        if joint.reference:  # the file's pose is where the joint reads this much
            out["offset"] = -_written(joint, joint.reference)
        if joint.range is not None:
            out["range"] = [_written(joint, end) for end in joint.range]
        return out

    def _ratio(self, joint: PartJoint, led: Follow) -> float:
        lead = next(other for _, other in self.choice.joints if other.name == led.lead)
        return led.ratio * _written(joint, 1.0) / _written(lead, 1.0)

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
            poses = self.choice.parts.poses
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
        taken = {joint["name"] for joint in self.joints} | set(self.choice.parts.places) - {name}
        while name in taken:
            name += "_"
        place = {"xyz": frame[:3, 3].tolist(), "rpy": np.degrees(_rpy(frame[:3, :3])).tolist()}
        self.joints.append({"name": name, "kind": kind, "parent": parent, "child": child, **place, **more})


def _written(joint: PartJoint, value: float) -> float:
    """Return a displacement as the section has it, in mm or deg."""
    return float(value if joint.kind == "prismatic" else _DEG * value)


def _rpy(rotation: Array) -> Array:
    """Roll, pitch, yaw of Rz(yaw) Ry(pitch) Rx(roll); yaw is 0 where the pitch is 90 deg and only a sum is known."""
    across = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = np.arctan2(-rotation[2, 0], across)
    if across < 1e-9:
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])
