"""What an MJCF states of a mechanism, as data: bodies with their joints, what ties bodies together, couplings and drives.

Lengths are mm, angles rad; frames (4, 4) are those of the file's own pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from truepose.arrays import Array
from truepose.models.machine.mechanism import JointKind


@dataclass(frozen=True, eq=False)
class PartJoint:
    """A joint of a body: its axis and a point of it (3,) in the body, and its reading (mm or rad) where the file has it."""

    name: str
    kind: JointKind
    axis: Array
    anchor: Array
    reference: float = 0.0
    range: tuple[float, float] | None = None


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

    @property
    def linear(self) -> bool:
        """Whether no power above the first has a coefficient."""
        return not any(self.coefficients[2:])

    def inverted(self) -> Coupling:
        """Return what the lead does where the joint is what is driven; of a linear coupling."""
        shift, ratio = self.coefficients[:2]
        return Coupling(self.lead, self.joint, (-shift / ratio, 1.0 / ratio))


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

    def led_by_drives(self) -> Parts:
        """Return the same with couplings turned round whose joint is driven and whose lead is not."""
        driven = self.driven or frozenset()
        turned = [
            c.inverted()
            if c.joint in driven and c.lead and c.lead not in driven and c.linear and c.coefficients[1]
            else c
            for c in self.couplings
        ]
        return replace(self, couplings=tuple(turned))
