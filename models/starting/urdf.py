"""A machine to start from in a URDF: the chain between two links, by reference or written out as a graph."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from truepose.errors import InputError
from truepose.models.builders.urdf import Urdf, expanded
from truepose.models.builders.urdf_file import Robot
from truepose.models.builders.urdf_inertials import gravity_in, inertials_of
from truepose.models.starting.start import UPRIGHT, Start, readings_of
from truepose.models.units import UnitSystem
from truepose.wording import cut, shortened


def urdf_start(path: Path, output: Path, base: str, tip: str, *, written_out: bool) -> Start:
    """The start of a URDF. Empty ``base``: the root link; empty ``tip``: the end of the chain with the most joints; several
    tips have commas between them.

    The file is named as seen from ``output``, unless its chain is ``written_out`` with its masses and gravity.
    Raises InputError for a URDF that cannot be read, or where several chains are as long.
    """
    robot = Robot.read(path)
    base = base or root_of(robot)
    tip = tip or _longest(robot, base)
    shown = os.path.relpath(path.resolve(), output.resolve().parent)
    tips = [name.strip() for name in tip.split(",")]
    several = len(tips) > 1 and tip not in robot.links
    section = Urdf(type="urdf", file=shown, base_link=base, tip_link=tuple(tips) if several else tip)
    graph = expanded(section, robot, UnitSystem(), "--urdf")
    about = (f"Source: {path.name}, from the link {base} to the link {tip}.",)
    if not written_out:
        weighs = bool(inertials_of(robot, graph["bodies"])[0])
        return Start(
            path.stem,
            f"The URDF {path.name}",
            {**section.model_dump(exclude_defaults=True), "tip_link": tips if several else tip},
            about,
            described_in=path.name if weighs else "",
            readings=readings_of(graph),
        )
    inertials, notes = inertials_of(robot, graph["bodies"])
    return Start(
        path.stem,
        f"The URDF {path.name}",
        graph,
        (*about, *(f"Note: {note}" for note in notes)),
        gravity=gravity_in(robot, base) if inertials else UPRIGHT,
        masses={i.body: {"kg": i.kg, "com": list(i.com), "in": i.body} for i in inertials},
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


def _longest(robot: Robot, base: str) -> str:
    """The link at the end of the chain with the most joints that move; of those the one with the fewest fixed beyond."""
    ends = _ends(robot, base)
    if not ends:
        raise InputError(
            f"{robot.path}: found no joint that moves beyond {cut(base)!r}, expected another --base-link"
        )
    most = max(moving for moving, _ in ends.values())
    best = sorted(link for link, (moving, _) in ends.items() if moving == most)
    driven = [link for link in best if robot.above[link].get("type") != "fixed"]
    beyond = [link for link in best if link not in driven]
    if len(driven) == 1 and len(beyond) <= 1:
        return beyond[0] if beyond else driven[0]
    usual = [link for name in ("tool0", "flange", "ee_link") for link in beyond if link.endswith(name)]
    if len(driven) == 1 and usual:
        return usual[0]
    raise InputError(
        f"{robot.path}: found several ends of the chain from {cut(base)!r}: {_named(best)}, expected one: say which with "
        "--tip-link"
    )


def _ends(robot: Robot, base: str) -> dict[str, tuple[int, int]]:
    """Of each link beyond ``base`` with a joint that moves on the way: how many do, and how many joints there are in all."""
    known: dict[str, tuple[int, int] | None] = {base: (0, 0)}
    for link in robot.links:
        way, here = [], link
        while here not in known:
            known[here] = None  # a ring, or another root, unless the walk comes to the base
            way.append(here)
            if here in robot.above:
                here = robot.end(robot.above[here], "parent")
        found = known[here]
        for one in reversed(way):
            found = None if found is None else (found[0] + _moves(robot, one), found[1] + 1)
            known[one] = found
    return {link: found for link, found in known.items() if found is not None and found[0]}


def _moves(robot: Robot, link: str) -> bool:
    """Whether the joint that carries a link moves and has a reading of its own."""
    joint = robot.above[link]
    return joint.get("type") in ("revolute", "continuous", "prismatic") and joint.find("mimic") is None


def _named(links: Sequence[str]) -> str:
    return shortened([cut(link, 60) for link in links], 10)


__all__ = ["root_of", "urdf_start"]
