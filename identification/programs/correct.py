"""Targets of a robot program corrected in place: a nominal controller that is given them brings the real tool where they meant.

A pose means where the tool is to be: the controller's nominal inverse kinematics makes joints of it, and the real machine, with
its constants and effects, then stands elsewhere. Solved are the joints that bring the real tool there, and what is written is
the nominal machine's pose of those joints. Joint targets mean where nominal joints and links would put the flange. What
cannot be corrected stays as it is and is listed with its reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.compensation.inverse import Reach
from truepose.identification.compensation.rows import twists_between
from truepose.identification.programs.branches import Branches
from truepose.identification.programs.configurations import Configuration
from truepose.identification.programs.forms import written
from truepose.identification.programs.frames import Cell, Frames, Told, shown_name
from truepose.identification.programs.points import decimals_of
from truepose.identification.programs.program import Left, Number, Program, Target, in_order
from truepose.identification.programs.robot import Robot
from truepose.models import lie
from truepose.models.machine import Machine
from truepose.models.units import convert

Array = NDArray[np.float64]
FARTHEST = 0.1
"""rad, or part of the machine's size: a correction that moves a joint by more is not made. Calibrations move joints by
thousandths; a tenth is reached next to singular poses only, where a joint swings for nothing."""


@dataclass(frozen=True)
class Corrected:
    """A target that was corrected: ``numbers`` are the new texts of its numbers and, behind them, of its configuration.

    ``change``, ``before``, ``after`` (6,) are twists [mm, rad]: the correction; where the real tool is from the target with
    the program as it was; and with what is written now, its rounding included.
    """

    target: Target
    numbers: tuple[str, ...]
    change: Array
    before: Array
    after: Array
    reconfigured: bool


@dataclass(frozen=True)
class Correction:
    """A corrected text and what was done. ``left`` are the lines where something was not, or not wholly, corrected.

    ``drivers`` are the values of the effects' drivers that hold for all targets; ``arrival`` is the largest change of the
    tool (mm) by effects of the direction in which joints arrive, which no target tells; ``assumed`` are names of tools that
    were taken for the machine file's.
    """

    text: str
    done: tuple[Corrected, ...]
    left: tuple[Left, ...]
    drivers: Mapping[str, float]
    arrival: float
    assumed: tuple[str, ...]


@dataclass(frozen=True)
class _Meant:
    """A target with its frames, the pose (4, 4) that is meant in the sensor's frame, and its nominal joints (nq,)."""

    target: Target
    told: Told
    goal: Array
    q: Array


def correct(
    machine: Machine, program: Program, cell: Cell | None = None, drivers: Mapping[str, float] | None = None
) -> Correction:
    """The text of a program with its targets corrected.

    ``drivers`` are values of what effects depend on (``payload``, ``temperature.base``), mm, rad, kg, degC; the rest has its
    defaults. Raises InputError for a machine that is no arm of six joints where the program has poses, and where no target is
    left to correct.
    """
    _check(machine, program)
    frames, robot = Frames(program, cell or Cell()), Robot(machine, drivers or {})
    left = list(program.left)
    known: list[tuple[Target, Told]] = []
    for target in program.targets:
        told = frames.of(target)
        if isinstance(told, str):
            left.append(Left(target.line, target.name, told))
        else:
            known.append((target, told))
    meant = _meant(robot, program, known, left)
    done = _corrected(robot, program, meant, left)
    assumed = sorted({shown_name(m.told.assumed) for m in meant if m.told.assumed})
    arrival = robot.arrival(np.array([m.q for m in meant])) if meant else 0.0
    return Correction(
        _edited(program.text, done), tuple(done), in_order(left), robot.drivers, arrival, tuple(assumed)
    )


def _check(machine: Machine, program: Program) -> None:
    joints = machine.mechanism.actuators
    if not program.targets and not program.left:
        raise InputError("found no target in the program, expected poses or joints that it moves to")
    if any(t.kind == "pose" for t in program.targets) and len(joints) != 6:
        raise InputError(
            f"{machine.name}: found {len(joints)} joints, expected six: a program's pose tells the joints of no other robot"
        )
    odd = [a.reading for a in joints if a.reading_unit not in ("rad", "mm")]
    counts = {len(t.numbers) for t in program.targets if t.kind == "joints"}
    if counts and (odd or counts != {len(joints)}):
        found = f"joints {', '.join(odd)} in turns" if odd else f"{len(joints)} joints"
        raise InputError(
            f"{machine.name}: found {found}, expected {max(counts)} joints in angles and lengths, as the program has them"
        )


def _meant(
    robot: Robot, program: Program, known: Sequence[tuple[Target, Told]], left: list[Left]
) -> list[_Meant]:
    """Nominal joints of all targets. Where nothing else tells, they are the next to those before, as the text goes."""
    poses = [k for k, (target, _) in enumerate(known) if target.kind == "pose"]
    numbers = np.array([[n.value for n in known[k][0].numbers] for k in poses])
    goals = dict(zip(poses, program.form.poses(numbers), strict=True)) if poses else {}
    solutions = dict(_solutions(robot, known, goals, program.configuration))
    out: list[_Meant] = []
    before = robot.home
    for k, (target, told) in sorted(enumerate(known), key=lambda item: item[1][0].place):
        robot.nominal(told.tool)
        if target.kind == "joints":
            q = _joints(robot, program, [n.value for n in target.numbers])
            out.append(_Meant(target, told, robot.solver.forward(q[None, :])[0][0], q))
            before = q
            continue
        configured = tuple(n.value for n in target.configuration)
        near = before if target.near is None else _joints(robot, program, target.near)
        chosen = solutions[k][0].chosen(solutions[k][1], near, program.configuration, configured)
        if chosen.q is None:
            left.append(Left(target.line, target.name, chosen.why))
            continue
        out.append(_Meant(target, told, robot.base @ told.base @ goals[k], chosen.q))
        before = chosen.q
    return out


def _solutions(
    robot: Robot,
    known: Sequence[tuple[Target, Told]],
    goals: Mapping[int, Array],
    configuration: Configuration | None,
) -> list[tuple[int, tuple[Branches, Array]]]:
    """All nominal joints of each pose: tools are solved one by one, poses of a tool together."""
    out = []
    for tool, rows in _by_tool([(k, known[k][1]) for k in goals]):
        robot.nominal(tool)
        branches = Branches(robot.machine, robot.solver)
        poses = np.array([robot.base @ known[k][1].base @ goals[k] for k in rows])
        wanted = [tuple(n.value for n in known[k][0].configuration) for k in rows]
        found = branches.found(poses, wanted, configuration)
        out += [(k, (branches, q)) for k, q in zip(rows, found, strict=True)]
    return out


def _by_tool(told: Sequence[tuple[int, Told]]) -> list[tuple[Array | None, list[int]]]:
    groups: dict[bytes | None, tuple[Array | None, list[int]]] = {}
    for k, one in told:
        key = None if one.tool is None else one.tool.tobytes()
        groups.setdefault(key, (one.tool, []))[1].append(k)
    return list(groups.values())


def _corrected(robot: Robot, program: Program, meant: list[_Meant], left: list[Left]) -> list[Corrected]:
    out: list[Corrected] = []
    for tool, rows in _by_tool([(k, m.told) for k, m in enumerate(meant)]):
        some = [meant[k] for k in rows]
        goal, q = np.array([m.goal for m in some]), np.array([m.q for m in some])
        robot.real(tool)
        before = twists_between(goal, robot.solver.forward(q)[0])
        found = robot.solver.inverse(goal, q, restarts=0, rewind=False)
        robot.nominal(tool)
        seen = robot.solver.forward(found.q)[0]
        change = twists_between(goal, seen)
        good, texts = [], []
        for row, m in enumerate(some):
            why = _refused(robot, found.status[row], found.saturated(row), found.q[row] - q[row])
            new = _texts(robot, program, m, found.q[row], seen[row]) if why is None else None
            if new is None:
                left.append(Left(m.target.line, m.target.name, why or _WRIST))
                continue
            good.append(row)
            texts.append(new)
        after = _after(robot, program, [some[row] for row in good], texts, found.q[good], tool)
        for row, new, left_over in zip(good, texts, after, strict=True):
            target = some[row].target
            turned = new[len(target.numbers) :] != tuple(n.text for n in target.configuration)
            out.append(Corrected(target, new, change[row], before[row], left_over, turned))
    return sorted(out, key=lambda one: one.target.numbers[0].start)


_WRIST = "the correction would take axis 5 through zero, into another configuration of the wrist"


def _refused(robot: Robot, status: int, saturated: tuple[str, ...], moved: Array) -> str | None:
    """Why the joints that were found are none to write."""
    if status == Reach.JOINT_RANGE:
        return f"the correction would take {', '.join(saturated)} out of the range"
    if status != Reach.SOLVED:
        return "the real machine cannot reach it"
    share = np.abs(moved) / robot.reach
    if np.max(share) > FARTHEST:
        k = int(np.argmax(share))
        name, unit = robot.machine.mechanism.readings[k], robot.machine.mechanism.actuators[k].reading_unit
        size = f"{np.degrees(moved[k]):.3g} deg" if unit == "rad" else f"{moved[k]:.3g} mm"
        return f"next to a singular pose: the correction would move {name} by {size}"
    return None


def _texts(robot: Robot, program: Program, m: _Meant, q: Array, seen: Array) -> tuple[str, ...] | None:
    """New texts of a target's numbers and configuration; None where it would be in another one."""
    numbers = m.target.numbers
    if m.target.kind == "joints":
        units = _units(robot, program)
        values = [convert(v, u, to) for v, (u, to) in zip(q.tolist(), units, strict=True)]
        decimals: Sequence[int] = [decimals_of(to, u) for u, to in units]
    else:
        pose = lie.inverse_pose(robot.base @ m.told.base) @ seen
        near = np.array([[n.value for n in numbers]])
        values = program.form.numbers(pose[None], near)[0].tolist()
        decimals = program.form.decimals
    out = [written(v, n.text, d) for v, n, d in zip(values, numbers, decimals, strict=True)]
    if not m.target.configuration or program.configuration is None:
        return tuple(out)
    old = tuple(n.value for n in m.target.configuration)
    renewed = program.configuration.renewed(old, q)
    if renewed is None:
        return None
    same = [
        n.text if a == b else f"{a:.0f}" for a, b, n in zip(renewed, old, m.target.configuration, strict=True)
    ]
    return (*out, *same)


def _after(
    robot: Robot,
    program: Program,
    some: list[_Meant],
    texts: list[tuple[str, ...]],
    q: Array,
    tool: Array | None,
) -> Array:
    """(n, 6) where the real tool is from the targets when the nominal controller is told the new texts."""
    if not some:
        return np.zeros((0, 6))
    robot.nominal(tool)
    commands = q.copy()
    for row, (m, new) in enumerate(zip(some, texts, strict=True)):
        values = [float(t) for t in new[: len(m.target.numbers)]]
        if m.target.kind == "joints":
            commands[row] = _joints(robot, program, values)
        else:
            pose = robot.base @ m.told.base @ program.form.poses(np.array([values]))[0]
            commands[row] = robot.solver.inverse(pose[None], q[row], restarts=0, rewind=False).q[0]
    robot.real(tool)
    goal = np.array([m.goal for m in some])
    return twists_between(goal, robot.solver.forward(commands)[0])


def _units(robot: Robot, program: Program) -> list[tuple[str, str]]:
    """Unit inside and in the text of each joint."""
    joints = robot.machine.mechanism.actuators
    own = program.joint_units
    return [(a.reading_unit, own.get(a.reading, own.get(a.reading_unit, a.reading_unit))) for a in joints]


def _joints(robot: Robot, program: Program, values: Sequence[float]) -> Array:
    units = _units(robot, program)
    return np.array([convert(v, unit, inside) for v, (inside, unit) in zip(values, units, strict=True)])


def _edited(text: str, done: Sequence[Corrected]) -> str:
    """The text with the new numbers in place of the old ones."""
    edits: list[tuple[Number, str]] = [
        (old, new)
        for one in done
        for old, new in zip((*one.target.numbers, *one.target.configuration), one.numbers, strict=True)
    ]
    out, at = [], 0
    for old, new in sorted(edits, key=lambda edit: edit[0].start):
        out += [text[at : old.start], new]
        at = old.end
    return "".join([*out, text[at:]])


__all__ = ["Corrected", "Correction", "correct"]
