"""Find what targets mean: the pose in the sensor's frame, and the nominal joints that a controller would take there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.programs.branches import Branches
from truepose.identification.leaves.programs.configurations import Configuration
from truepose.identification.leaves.programs.frames import Told
from truepose.identification.leaves.programs.program import Left, Program, Target
from truepose.identification.leaves.programs.robot import Robot
from truepose.models.units import convert

_OTHER = 1e-3
"""rad, mm: joints that differ by more are another solution."""
_OTHERWISE = "motions go to it with several solutions of the joints: it is corrected for that of the first"


@dataclass(frozen=True)
class Meant:
    """A target with its frames, the pose (4, 4) that is meant in the sensor's frame, and its nominal joints (nq,).

    ``at`` is the program's own target; ``target`` has no configuration where no joints have it.
    """

    target: Target
    told: Told
    goal: Array
    q: Array
    at: Target


def meant_of(
    robot: Robot, program: Program, known: Sequence[tuple[Target, Told]], left: list[Left]
) -> list[Meant]:
    """Nominal joints of all targets. Where nothing else tells, they are the next to those before, as the text goes.

    Targets that no joints can be told of are added to ``left``, and those that motions go to with several.
    """
    poses = [k for k, (target, _) in enumerate(known) if target.kind == "pose"]
    numbers = np.array([[n.value for n in known[k][0].numbers] for k in poses])
    goals = dict(zip(poses, program.form.poses(numbers), strict=True)) if poses else {}
    solutions = dict(_solutions(robot, known, goals, program.configuration))
    out: dict[int, Meant | None] = {}
    before = robot.home
    for k in _visits(known):
        target, told = known[k]
        if target.kind == "joints":
            if k not in out:
                robot.nominal(told.tool)
                q = joint_values(robot, program, [n.value for n in target.numbers])
                out[k] = Meant(target, told, robot.solver.forward(q[None, :])[0][0], q, target)
        elif k not in out or out[k] is not None:
            found = _meant(robot, program, target, solutions[k], before)
            last = out.get(k)
            if isinstance(found, str):
                left.append(Left(target.line, target.name, found))
                out[k] = None
            elif last is None:
                goal = robot.base @ told.base @ goals[k]
                out[k] = Meant(found[0], told, goal, found[1], target)
            elif np.max(np.abs(found[1] - last.q)) > _OTHER:
                left.append(Left(target.line, target.name, _OTHERWISE))
        now = out[k]
        before = before if now is None else now.q
    return [one for one in out.values() if one is not None]


def _visits(known: Sequence[tuple[Target, Told]]) -> list[int]:
    """Targets in the order in which the text goes to them, again and again."""
    visits = [
        (place, k) for k, (target, _) in enumerate(known) for place in (target.places or (target.place,))
    ]
    return [k for _, k in sorted(visits)]


def _meant(
    robot: Robot, program: Program, target: Target, solutions: tuple[Branches, Array], before: Array
) -> tuple[Target, Array] | str:
    """The target and the joints that a motion to it means, next to those ``before``; or why none."""
    configured = tuple(n.value for n in target.configuration)
    near = before if target.near is None else joint_values(robot, program, target.near)
    branches, q = solutions
    chosen = branches.chosen(q, near, program.configuration, configured)
    if isinstance(chosen, str) and target.loose and configured:
        chosen, target = branches.chosen(q, near, None, ()), replace(target, configuration=())
    return chosen if isinstance(chosen, str) else (target, chosen)


def _solutions(
    robot: Robot,
    known: Sequence[tuple[Target, Told]],
    goals: Mapping[int, Array],
    configuration: Configuration | None,
) -> list[tuple[int, tuple[Branches, Array]]]:
    """All nominal joints of each pose: tools are solved one by one, poses of a tool together."""
    out = []
    for tool, rows in by_tool([(k, known[k][1]) for k in goals]):
        robot.nominal(tool)
        branches = Branches(robot.machine, robot.solver)
        poses = np.array([robot.base @ known[k][1].base @ goals[k] for k in rows])
        wanted = [tuple(n.value for n in known[k][0].configuration) for k in rows]
        first: dict[tuple[bytes, tuple[float, ...]], int] = {}  # programs go to some poses many times
        own = [
            first.setdefault((pose.tobytes(), one), len(first))
            for pose, one in zip(poses, wanted, strict=True)
        ]
        at = np.unique(own, return_index=True)[1]
        found = branches.found(poses[at], [wanted[k] for k in at], configuration)
        out += [(k, (branches, found[one])) for k, one in zip(rows, own, strict=True)]
    return out


def by_tool(told: Sequence[tuple[int, Told]]) -> list[tuple[Array | None, list[int]]]:
    """Numbers of targets that have a tool in common, with that tool."""
    groups: dict[bytes | None, tuple[Array | None, list[int]]] = {}
    for k, one in told:
        key = None if one.tool is None else one.tool.tobytes()
        groups.setdefault(key, (one.tool, []))[1].append(k)
    return list(groups.values())


def joint_units(robot: Robot, program: Program) -> list[tuple[str, str]]:
    """Unit inside and in the text of each joint."""
    joints = robot.machine.mechanism.actuators
    own = program.joint_units
    return [(a.reading_unit, own.get(a.reading, own.get(a.reading_unit, a.reading_unit))) for a in joints]


def joint_values(robot: Robot, program: Program, values: Sequence[float]) -> Array:
    """(nq,) joints, mm and rad, of a text's numbers."""
    units = joint_units(robot, program)
    return np.array([convert(v, unit, inside) for v, (inside, unit) in zip(values, units, strict=True)])
