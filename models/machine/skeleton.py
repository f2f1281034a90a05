"""A machine as lines: links by their elementary steps, joint axes, rails, legs and plates, for a drawing at any pose.

The lines are those of the kinematic model itself, so that a picture shows what is calculated: a link of a
Denavit-Hartenberg chain runs along its offsets, a rod between its ball centres, a plate through its ball centres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.machine.assembly import Assembly, assemble, axis_of, placed_frame, rod_ends, symbols
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import COORDINATES, Joint, Mechanism

Kind = Literal["link", "axis", "rail", "leg", "plate", "tool"]
FEWEST_OF_A_PLATE = 3
"""Rods on one body from which on their ends are drawn as a plate."""
MOVING = ("revolute", "prismatic")
"""Joints whose axis is drawn."""


@dataclass(frozen=True)
class Piece:
    """A line through some points of a skeleton, and by which names effects may mean it.

    An ``axis`` is drawn about its first point, in the direction of the second; ``plate``: the line is closed.
    """

    kind: Kind
    names: tuple[str, ...]
    points: tuple[int, ...]


@dataclass(frozen=True)
class Skeleton:
    """Pieces, and a function of readings (nq,), passive coordinates (nx,) and parameters (np,) to points (3, k): mm, in the
    base's frame."""

    pieces: tuple[Piece, ...]
    function: ca.Function
    passive: int

    def around(self, points: Array) -> Skeleton:
        """The same with the points of each plate in their order around it, as they lie at one pose, ``points`` (k, 3)."""
        pieces = [
            replace(one, points=_around(one.points, points)) if one.kind == "plate" else one
            for one in self.pieces
        ]
        return replace(self, pieces=tuple(pieces))

    def points(self, q: Array, x: Array, p: Array) -> Array:
        """(n, k, 3) points at readings (n, nq) and passive coordinates (n, at least ``passive``), for parameters (np,)."""
        places = [self.function(a, b[: self.passive], p) for a, b in zip(q, x, strict=True)]
        return np.array([np.array(place).T for place in places]).reshape(len(q), -1, 3)


def skeleton(machine: Machine) -> Skeleton:
    """The skeleton of a machine without its effects. Raises InputError where it cannot be assembled."""
    plain = replace(machine, effects=(), gravity=None)
    mechanism = machine.mechanism
    q = symbols("q", mechanism.readings)
    values = {**symbols("", [p.name for p in machine.parameters]), **{n: ca.SX(0) for n in machine.ports}}
    size = sum(COORDINATES[joint.kind] for joint in mechanism.passive)
    x = ca.SX.sym("x", size)
    drawn = _Drawing(mechanism, assemble(plain, values, q, {}, x), values)
    drawn.joints()
    drawn.rods()
    drawn.add("tool", ("tool", mechanism.flange), [drawn.origin(mechanism.flange), drawn.placed.tool[:3, 3]])
    given = ca.vertcat(*q.values()), x, ca.vertcat(*(values[p.name] for p in machine.parameters))
    function = ca.Function("skeleton", [*given], [ca.horzcat(*drawn.points)])
    return Skeleton(tuple(drawn.pieces), function, size)


def _around(corners: tuple[int, ...], points: Array) -> tuple[int, ...]:
    """Corners by their angle about their middle, in the plane that they lie in."""
    away = points[list(corners)] - points[list(corners)].mean(axis=0)
    plane = np.linalg.svd(away, full_matrices=False)[2][:2]
    angle = np.arctan2(*(away @ plane.T).T)
    return tuple(corners[k] for k in np.argsort(angle, kind="stable"))


class _Drawing:
    """Points and pieces as they are put together."""

    def __init__(self, mechanism: Mechanism, placed: Assembly, values: Mapping[str, ca.SX]) -> None:
        self.mechanism, self.placed, self.values = mechanism, placed, values
        self.points: list[ca.SX] = []
        self.pieces: list[Piece] = []
        self._readings = {a.drives: a.reading for a in mechanism.actuators}
        self._limbs = {limb.reading: limb.name for limb in mechanism.limbs}

    def origin(self, body: str) -> ca.SX:
        return self.placed.bodies[body][:3, 3]

    def add(self, kind: Kind, names: Sequence[str], points: Sequence[ca.SX]) -> None:
        start = len(self.points)
        self.points += points
        self.pieces.append(Piece(kind, tuple(dict.fromkeys(names)), tuple(range(start, len(self.points)))))

    def joints(self) -> None:
        on: dict[str, list[Joint]] = {}
        for joint in self.mechanism.tree:
            if joint.kind != "free":
                on.setdefault(joint.parent, []).append(joint)
        for body, joints in on.items():
            if len(joints) >= FEWEST_OF_A_PLATE:
                names = [name for joint in joints for name in self._still(joint)]
                self.add("plate", [*self._body(body), *names], [self._steps(joint)[-1] for joint in joints])
            else:
                for joint in joints:
                    self.add("link", [*self._body(body), *self._still(joint)], self._steps(joint))
            for joint in joints:
                self._motion(joint)
        for joint in self.mechanism.closing:
            steps = self._steps(joint)
            names = self._of(joint.name)
            self.add("link", [*self._body(joint.parent), *names], steps)
            self.add("link", [*self._body(joint.child), *names], [self.origin(joint.child), steps[-1]])

    def _still(self, joint: Joint) -> list[str]:
        """Names of a joint that has no axis of its own in the drawing: what it stands on is meant."""
        return [] if joint.kind in MOVING else self._of(joint.name)

    def _motion(self, joint: Joint) -> None:
        """The axis of a joint, and the way of a slide."""
        if joint.kind not in MOVING:
            return
        names, child = self._of(joint.name), self.origin(joint.child)
        frame = placed_frame(joint, self.placed.bodies, self.values)
        along = frame[:3, :3] @ axis_of(joint, self.values)
        if joint.kind == "prismatic":
            self.add("link", names, [frame[:3, 3], child])
            self._rail(joint, frame[:3, 3], along)
        self.add("axis", names, [child, child + along])

    def _rail(self, joint: Joint, start: ca.SX, along: ca.SX) -> None:
        """The travel of a driven slide, where its range is known."""
        actuator = next((a for a in self.mechanism.actuators if a.drives == joint.name), None)
        if actuator is None or actuator.range is None:
            return
        gain = self.values[actuator.gain] if actuator.gain else ca.SX(1)
        offset = self.values[actuator.offset] if actuator.offset else ca.SX(0)
        ends = [start + along * (offset + gain * end) for end in actuator.range]
        self.add("rail", self._of(joint.name), ends)

    def _steps(self, joint: Joint) -> list[ca.SX]:
        """From the parent's origin to the joint, with a corner where the way turns."""
        out = [self.origin(joint.parent)]
        turns = [step.kind.startswith("r") for step in joint.placement] + [True]
        for k, step in enumerate(joint.placement, 1):
            if step.kind.startswith("t") and turns[k]:
                part = replace(joint, placement=joint.placement[:k])
                out.append(placed_frame(part, self.placed.bodies, self.values)[:3, 3])
        return out if len(out) > 1 else [*out, *out]

    def rods(self) -> None:
        on: dict[str, list[ca.SX]] = {}
        for rod in self.mechanism.rods:
            a, b = rod_ends(rod, self.placed.bodies, self.values)
            self.add("leg", self._of(rod.name), [a, b])
            on.setdefault(rod.body_a, []).append(a)
            on.setdefault(rod.body_b, []).append(b)
        for body, ends in on.items():
            if len(ends) >= FEWEST_OF_A_PLATE:
                self.add("plate", self._body(body), ends)
            else:
                for end in ends:
                    self.add("link", self._body(body), [self.origin(body), end])

    def _of(self, joint: str) -> list[str]:
        """Names of a joint or a rod: its own, its reading's, its limb's."""
        reading = self._readings.get(joint, "")
        limb = next((limb.name for limb in self.mechanism.limbs if limb.name == joint), "")
        return [n for n in (joint, reading, limb or self._limbs.get(reading, "")) if n]

    def _body(self, body: str) -> list[str]:
        names = [body]
        if body == self.mechanism.platform:
            names.append("platform")
        return names
