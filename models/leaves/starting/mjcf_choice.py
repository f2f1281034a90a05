"""Which parts of an MJCF make the machine that ends at a body: what leads to it, the loops that move it, and what leads those.

A loop belongs to the machine if a joint of the machine moves one end of its tie against the other. A free body that ties hold
is part of loops, such as a hexapod's platform; one that nothing holds is the base, and where it stands is the base's frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from truepose.errors import InputError
from truepose.models.leaves.starting.mjcf_parts import Coupling, PartJoint, Parts, Tie
from truepose.wording import cut, shortened

_NAMED = 10


@dataclass(frozen=True, eq=False)
class Follow:
    """A joint's displacement: ``offset`` + ``ratio`` times that of the joint ``lead``, which none leads; mm and rad."""

    lead: str
    ratio: float
    offset: float


@dataclass(frozen=True, eq=False)
class Choice:
    """The machine's parts: its base, its other bodies, parents first, the ties among them, and joints that others lead."""

    parts: Parts
    base: int
    bodies: tuple[int, ...]
    ties: tuple[Tie, ...]
    follows: Mapping[str, Follow]

    @cached_property
    def looped(self) -> frozenset[int]:
        """Bodies whose joints a loop moves."""
        return frozenset(body for tie in self.ties for body in self.parts.loop(tie))

    @cached_property
    def joints(self) -> list[tuple[int, PartJoint]]:
        """All joints that move a body against another one of the machine, with their bodies."""
        return [(body, joint) for body in self.bodies for joint in self.parts.bodies[body].joints]

    def drives(self, body: int, joint: PartJoint) -> bool:
        """Return whether a joint has a reading: it leads itself, and is driven or in no loop."""
        driven = self.parts.driven or frozenset()
        return joint.name not in self.follows and (body not in self.looped or joint.name in driven)

    def left_out(self) -> tuple[str, ...]:
        """Return in words what the file has and the machine has not."""
        parts, kept = self.parts, {self.base, *self.bodies}
        ties = [f"{tie.name!r}" for tie in parts.ties if tie not in self.ties]
        known = {joint.name for _, joint in self.joints}
        ties += [f"of joint {c.joint!r}" for c in parts.couplings if c.joint not in known]
        kept |= {0, *parts.way(self.base)}
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


def choose(parts: Parts, tips: Sequence[int], where: str) -> Choice:
    """Return the machine that ends at the bodies ``tips``. Raises InputError, which ``where`` opens, where there is none."""
    kept, ties = _closed_over(parts, tips)
    base = _base(parts, kept, ties, tips[0])
    if not any(parts.bodies[b].joints for b in kept - {base}):
        name = cut(parts.bodies[tips[0]].name)
        raise InputError(f"{where}: found no joint on the way to {name!r}, expected another --tip")
    bodies = sorted(
        b for b in kept if b != base and (base in parts.way(b) or parts.bodies[parts.way(b)[0]].free)
    )
    choice = Choice(parts, base, tuple(bodies), tuple(ties), _follows(parts, kept, where))
    _check(choice, where)
    return choice


def _closed_over(parts: Parts, tips: Sequence[int]) -> tuple[set[int], list[Tie]]:
    """Return the bodies on the way to the tips, with all that moves them through ties and couplings, and these ties."""
    kept, size = {body for tip in tips for body in parts.way(tip)}, 0
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
        if not c.linear:
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


def _check(choice: Choice, where: str) -> None:
    """Refuse joints that nothing determines. Raises InputError naming them."""
    read = {joint.name for body, joint in choice.joints if choice.drives(body, joint)}
    for body, joint in choice.joints:
        if joint.kind in ("spherical", "free") and body not in choice.looped:
            raise InputError(
                f"{where}: joint {cut(joint.name)!r}: found a ball or free joint, expected hinges and slides on the way from "
                "the base to the tip, or a loop that moves it"
            )
    if choice.ties and choice.parts.driven is None:
        names = shortened([cut(repr(tie.name)) for tie in choice.ties], _NAMED)
        raise InputError(
            f"{where}: found loops, closed by the equality constraints {names}, and no actuator, expected an actuator for "
            "each joint that is driven"
        )
    for name, follow in choice.follows.items():
        if follow.lead and follow.lead not in read:
            raise InputError(
                f"{where}: equality of joint {cut(name)!r}: found {cut(follow.lead)!r}, which no actuator drives, expected "
                "a joint with a reading"
            )
    if not read:
        raise InputError(
            f"{where}: found no joint that an actuator drives on the way to the tip, expected one"
        )
