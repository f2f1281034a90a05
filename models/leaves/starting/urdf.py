"""A machine to start from in a URDF: the chain between two links, by reference or written out as a graph."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from truepose.errors import InputError
from truepose.models.builders.urdf import Urdf, expanded
from truepose.models.builders.urdf_file import Robot, gravity_in, inertials_of
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
    """Return the one link without joints beyond that a joint that moves leads to."""
    known: dict[str, bool | None] = {base: False}
    carrying = {robot.end(joint, "parent") for joint in robot.above.values()}
    ends = sorted(link for link in robot.links if link not in carrying and robot.carried(link, known, _moves))
    if not ends:
        raise InputError(
            f"{robot.path}: found no joint that moves beyond {cut(base)!r}, expected another --base-link"
        )
    if len(ends) != 1:
        raise InputError(
            f"{robot.path}: found several ends of the chain from {cut(base)!r}: {_named(ends)}, expected one: say which with "
            "--tip-link, which also takes a link before they part, such as the flange"
        )
    return ends[0]


def _moves(before: bool, joint: Element) -> bool:
    """Return True if a joint moves, or one before it does."""
    return before or joint.get("type") != "fixed"


def _left_out(robot: Robot, bodies: Sequence[str]) -> tuple[str, ...]:
    """Return in words what the machine has not of its URDF."""
    off = sorted(robot.links - set(bodies))
    lines = [f"links that are not on the way to the tip: {_named(off)}"] if off else []
    lines += [f"elements that nothing reads: {_named(robot.unread)}"] if robot.unread else []
    return tuple(lines)


def _named(links: Sequence[str]) -> str:
    return shortened([cut(link, 60) for link in links], 10)
