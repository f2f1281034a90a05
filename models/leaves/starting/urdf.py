"""A machine to start from in a URDF: the chain between two links, by reference or written out as a graph."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from truepose.errors import InputError
from truepose.models.builders.urdf import Urdf, expanded
from truepose.models.builders.urdf_file import KINDS, Robot, gravity_in, inertials_of
from truepose.models.leaves.starting.start import UPRIGHT, Start, readings_of, unranged
from truepose.models.machine.mechanism import BASE
from truepose.models.units import UnitSystem
from truepose.wording import cut, shortened


def urdf_start(path: Path, output: Path, base: str, tip: str, *, written_out: bool) -> Start:
    """Return the start of a URDF. Empty ``base``: the root link, or the link `base` that is fixed to it; empty ``tip``: the
    one end of the chain; several tips have commas between them.

    The file is named as seen from ``output``, unless its chain is ``written_out`` with its masses and gravity.
    Raises InputError for a URDF that cannot be read, or with several ends and no ``tip``.
    """
    robot = Robot.read(path)
    base = base or _usual_base(robot, root_of(robot))
    tip = tip or _only_end(robot, base)
    shown = os.path.relpath(path.resolve(), output.resolve().parent)
    tips = [name.strip() for name in tip.split(",")]
    several = len(tips) > 1 and tip not in robot.links
    section = Urdf(type="urdf", file=shown, base_link=base, tip_link=tuple(tips) if several else tip)
    graph = expanded(section, robot, UnitSystem(), "--urdf")
    inertials, notes = inertials_of(robot, graph["bodies"])
    about = (f"Source: {path.name}, from the link {base} to the link {tip}.", *unranged(graph["joints"]))
    named = Start(
        path.stem,
        f"The URDF {path.name}",
        {**section.model_dump(exclude_defaults=True), "tip_link": tips if several else tip},
        about,
        described_in=path.name if inertials else "",
        readings=readings_of(graph),
        left_out=_left_out(robot, graph["bodies"]),
    )
    if not written_out:
        return named
    return replace(
        named,
        mechanism=graph,
        about=(*about, *(f"Note: {note}" for note in notes)),
        gravity=gravity_in(robot, base) if inertials else UPRIGHT,
        masses={i.body: {"kg": i.kg, "com": list(i.com), "in": i.body} for i in inertials},
        described_in="",
    )


def root_of(robot: Robot) -> str:
    """The link that no joint carries. Raises InputError where there are several."""
    roots = sorted(robot.links - set(robot.above))
    if len(roots) != 1:
        found = _named(roots) or "none"
        raise InputError(
            f"{robot.path}: found the root links {found}, expected one: say which with --base-link"
        )
    return roots[0]


def _usual_base(robot: Robot, root: str) -> str:
    """Return the link `base` where fixed joints alone lead to it from the root; else the root."""
    link = BASE
    while link in robot.above and robot.above[link].get("type") == "fixed":
        link = robot.end(robot.above[link], "parent")
    return BASE if link == root else root


def _only_end(robot: Robot, base: str) -> str:
    """Return the one link without joints beyond that a chain of driven joints, and of what follows them, leads to.

    Where no such link can be reached without a floating or planar joint, it is one behind that joint.
    """
    ways = _ways(robot, base)
    carrying = {robot.end(joint, "parent") for joint in robot.above.values()}
    leaves = sorted(link for link, way in ways.items() if way.moving and link not in carrying)
    known = [link for link in leaves if not ways[link].unknown]
    ends = [link for link in known if not ways[link].following or _follows_itself(robot, base, link)]
    if leaves and not known:
        return leaves[0]
    if not leaves:
        raise InputError(
            f"{robot.path}: found no joint that moves beyond {cut(base)!r}, expected another --base-link"
        )
    if len(ends) != 1:
        raise InputError(
            f"{robot.path}: found several ends of the chain from {cut(base)!r}: {_named(ends or known)}, expected one: say "
            "which with --tip-link, which also takes a link before they part, such as the flange"
        )
    return ends[0]


class _Way(NamedTuple):
    """How many joints on the way to a link move, follow others, and are of kinds that a chain cannot have."""

    moving: int = 0
    following: int = 0
    unknown: int = 0

    def beyond(self, joint: Element) -> _Way:
        """Return the way beyond a further joint."""
        kind, follows = joint.get("type", ""), joint.find("mimic") is not None
        return _Way(
            self.moving + (kind != "fixed" and not follows),
            self.following + (kind != "fixed" and follows),
            self.unknown + (kind not in KINDS),
        )


def _follows_itself(robot: Robot, base: str, end: str) -> bool:
    """Return whether joints on the way to a link follow only joints on that way."""
    way, link = [], end
    while link != base:
        way.append(robot.above[link])
        link = robot.end(way[-1], "parent")
    names = {robot.joint_name(joint) for joint in way}
    leads = [robot.mimic(joint) for joint in reversed(way)]
    return all(lead is None or lead[0] in names for lead in leads)


def _left_out(robot: Robot, bodies: Sequence[str]) -> tuple[str, ...]:
    """Return in words what the machine has not of its URDF."""
    off = sorted(robot.links - set(bodies))
    lines = [f"links that are not on the way to the tip: {_named(off)}"] if off else []
    lines += [f"elements that nothing reads: {_named(robot.unread)}"] if robot.unread else []
    return tuple(lines)


def _ways(robot: Robot, base: str) -> dict[str, _Way]:
    """Return the way from ``base`` to each link beyond."""
    known: dict[str, _Way | None] = {base: _Way()}
    ways = ((link, robot.carried(link, known, _Way.beyond)) for link in robot.links)
    return {link: way for link, way in ways if way is not None}


def _named(links: Sequence[str]) -> str:
    return shortened([cut(link, 60) for link in links], 10)
