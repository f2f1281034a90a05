"""Targets of a robot program corrected in place: a nominal controller that is given them brings the real tool where they meant.

A pose means where the tool is to be: the controller's nominal inverse kinematics makes joints of it, and the real machine, with
its constants and effects, then stands elsewhere. Solved are the joints that bring the real tool there, and what is written is
the nominal machine's pose of those joints. Joint targets mean where nominal joints and links would put the flange. What
cannot be corrected stays as it is and is listed with its reason.

A corrected program run from its text: read anew, solved as the nominal controller does, and moved by the real machine.

What a program does is compared with what the program before it meant, motion by motion. So a fault in what was edited, in
how it reads, or in which frames a motion goes by cannot hide behind the numbers that were solved for.
"""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError, ReadBackError
from truepose.identification.compensation.inverse import Reach
from truepose.identification.leaves.programs.frames import Cell, Frames, Told, shown_name
from truepose.identification.leaves.programs.meaning import (
    Meant,
    by_tool,
    joint_units,
    joint_values,
    meant_of,
)
from truepose.identification.leaves.programs.points import decimals_of
from truepose.identification.leaves.programs.pose_forms import written
from truepose.identification.leaves.programs.program import (
    LARGEST,
    Left,
    Program,
    Target,
    in_order,
    replaced,
    shown,
)
from truepose.identification.leaves.programs.robot import Robot
from truepose.identification.prediction.outside import outside_notes
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.units import convert

# -- A corrected program run from its text: read anew, solved as the nominal controller does, and moved by the real machine

MISSED = 0.01
"""mm, and as an angle at the reach of the machine: no motion of a corrected program may end farther from where it should.
Written numbers are rounded to a tenth of a micrometre."""
_WRONG = "what was to be written"


@dataclass(frozen=True)
class Corrected:
    """A target with the joints ``q`` (nq,) that bring the real tool there, and what is written for it.

    ``numbers`` are the new texts of its numbers and, behind them, of its configuration. ``change``, ``before``, ``after`` (6,)
    are twists [mm, rad]: the correction; where the real tool is from the target with the program as it was; and with what is
    written now, its rounding included.
    """

    meant: Meant
    numbers: tuple[str, ...]
    q: Array
    change: Array
    before: Array
    reconfigured: bool
    after: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def target(self) -> Target:
        return self.meant.target


def run(
    robot: Robot,
    programs: tuple[Program, Program],
    frames: tuple[Frames, Frames],
    solved: Sequence[Corrected],
) -> list[Array]:
    """Return where the real tool is (6,) from each target with the second program; the worst of the motions to it.

    Raises ReadBackError where the programs do not go to the same targets, or a motion misses by more than ``MISSED``.
    """
    of_target = {id(one.meant.at): k for k, one in enumerate(solved)}
    now: list[tuple[int, Target, Told]] = []
    for target, other in _pairs(*programs, solved):
        told = frames[1].of(other)
        k = of_target.get(id(target))
        if k is None:
            _check_same(target, other, frames[0].of(target), told)
        elif isinstance(told, str):
            raise _wrong(other, f": {told}")
        else:
            now.append((k, other, told))
    after: list[Array] = [np.zeros(6) for _ in solved]
    for tool, rows in by_tool([(row, told) for row, (_, _, told) in enumerate(now)]):
        some = [now[row] for row in rows]
        q = _commands(robot, programs[1], some, solved, tool)
        robot.real(tool)
        goals = np.array([solved[k].meant.goal for k, _, _ in some])
        missed = robot.missed(goals, robot.solver.forward(q)[0])
        for (k, other, _), one in zip(some, missed, strict=True):
            size = max(float(np.linalg.norm(one[:3])), robot.solver.size * float(np.linalg.norm(one[3:])))
            if not size <= MISSED:
                raise _wrong(other, f": run, it misses by {size:.3g} mm, expected {MISSED:g}")
            if np.linalg.norm(one) >= np.linalg.norm(after[k]):
                after[k] = one
    return after


def read_again(program: Program, text: str) -> Program:
    """Return the program that a corrected text reads as. Raises ReadBackError where it reads as none."""
    if program.again is None:
        raise ReadBackError(f"{_WRONG} cannot be read: no dialect")
    try:
        return program.again(text)
    except InputError as exc:
        raise ReadBackError(f"{_WRONG} cannot be read: {exc}") from exc


def edits_of(solved: Sequence[Corrected]) -> list[tuple[int, int, str]]:
    """Return what is written at spans of the text: new numbers, and literals where motions get a copy of their own."""
    edits: list[tuple[int, int, str]] = []
    for one in solved:
        target = one.target
        old = (*target.numbers, *target.configuration)
        written_anew = [(n.start, n.end, new) for n, new in zip(old, one.numbers, strict=False)]
        if target.copies is None:
            edits += written_anew
        else:
            edits += [(*span, replaced(target.copies.literal, written_anew)) for span in target.copies.names]
    return sorted(edits)


def _pairs(program: Program, again: Program, solved: Sequence[Corrected]) -> list[tuple[Target, Target]]:
    """Return the targets of each motion, before and now; and what no motion here goes to, by where it is written."""
    here, there = _motions(program), _motions(again)
    if len(here) != len(there):
        raise ReadBackError(f"{_WRONG} has {len(there)} motions to targets, expected {len(here)}")
    pairs = list(zip(here, there, strict=True))
    edits = edits_of(solved)
    ends = [end for _, end, _ in edits]
    longer = [0, *np.cumsum([len(new) - (end - start) for start, end, new in edits]).tolist()]
    still = {t.numbers[0].start: t for t in again.targets if not t.places}
    for target in (t for t in program.targets if not t.places):
        start = target.numbers[0].start
        now = still.get(start + longer[bisect.bisect_right(ends, start)])
        if now is None:
            raise ReadBackError(f"{_WRONG} has no target {target.name}, expected it as in line {target.line}")
        pairs.append((target, now))
    for target, other in pairs:
        if (target.kind, len(target.configuration)) != (other.kind, len(other.configuration)):
            raise _wrong(other, f", expected {target.kind} of {target.name}")
    return pairs


def _motions(program: Program) -> list[Target]:
    """Return the target of each motion, in the order of the text."""
    every = [(place, t.numbers[0].start, k) for k, t in enumerate(program.targets) for place in t.places]
    return [program.targets[k] for *_, k in sorted(every)]


def _wrong(other: Target, why: str) -> ReadBackError:
    return ReadBackError(f"{other.line}: {_WRONG} reads as another target: {other.name}{why}")


def _check_same(target: Target, other: Target, told: Told | str, now: Told | str) -> None:
    """Raise ReadBackError where a target that was not corrected means another place."""
    here, there = ([n.text for n in (*t.numbers, *t.configuration)] for t in (target, other))
    if isinstance(told, str) or isinstance(now, str):
        same = isinstance(told, str) and isinstance(now, str)
    else:
        frames = [(told.base, now.base), (told.tool, now.tool)]
        same = all(
            a is b if a is None or b is None else np.allclose(a, b, rtol=0, atol=1e-9) for a, b in frames
        )
    if here != there or not same:
        raise _wrong(other, f" is {', '.join(there)}, expected {', '.join(here)}")


def _commands(
    robot: Robot,
    program: Program,
    some: Sequence[tuple[int, Target, Told]],
    solved: Sequence[Corrected],
    tool: Array | None,
) -> Array:
    """Return joints (n, nq) that the nominal controller has at targets, next to those that were solved for."""
    robot.nominal(tool)
    q = np.array([solved[k].q for k, _, _ in some])
    values = [[n.value for n in target.numbers] for _, target, _ in some]
    rows = [row for row, (_, target, _) in enumerate(some) if target.kind == "pose"]
    if rows:
        poses = program.form.poses(np.array([values[row] for row in rows]))
        told = np.array([robot.base @ some[row][2].base for row in rows]) @ poses
        q[rows] = robot.solver.inverse(told, q[rows], restarts=0, rewind=False).q
    for row, (_, target, _) in enumerate(some):
        if target.kind == "joints":
            q[row] = joint_values(robot, program, values[row])
    return q


# -- Targets of a robot program corrected in place: the nominal controller brings the real tool where they meant

FARTHEST = 0.1
"""rad, or part of the machine's size: a correction that moves a joint by more is not made. Calibrations move joints by
thousandths; a tenth is reached next to singular poses only, where a joint swings for nothing."""


@dataclass(frozen=True)
class Correction:
    """A corrected text and what was done. ``left`` are the lines where something was not, or not wholly, corrected.

    ``drivers`` are the values of the effects' drivers that hold for all targets; ``assumed`` are names of tools that were taken
    for the machine file's. ``unnamed`` counts poses that were taken in the robot's base, and with the machine file's tool,
    because neither program nor user told others. ``notes`` name targets that lie outside of what the calibration saw.
    """

    text: str
    done: tuple[Corrected, ...]
    left: tuple[Left, ...]
    drivers: Mapping[str, float]
    assumed: tuple[str, ...]
    unnamed: tuple[int, int]
    notes: tuple[str, ...] = ()


def correct(
    machine: Machine, program: Program, cell: Cell | None = None, drivers: Mapping[str, float] | None = None
) -> Correction:
    """The text of a program with its targets corrected.

    ``drivers`` are values of what effects depend on (``payload``, ``temperature.base``), mm, rad, kg, degC; the rest has its
    defaults. Raises InputError for a machine whose joints a pose does not tell where the program has poses, and where no target
    is left to correct; ReadBackError where the corrected program, run, does not do what this one meant.
    """
    given = cell or Cell()
    frames, robot = Frames(program, given), Robot(machine, drivers or {})
    program = _check(robot, program)
    left = list(program.left)
    known: list[tuple[Target, Told]] = []
    for target in program.targets:
        told = _beyond(target) or frames.of(target)
        if isinstance(told, str):
            left.append(Left(target.line, target.name, told))
        else:
            known.append((target, told))
    meant = meant_of(robot, program, known, left)
    solved = _solved(robot, program, meant, left)
    text = edited(program.text, solved)
    again = _check(robot, read_again(program, text)) if solved else program
    after = run(robot, (program, again), (frames, Frames(again, given)), solved)
    done = [replace(one, after=missed) for one, missed in zip(solved, after, strict=True)]
    assumed = sorted({shown_name(m.told.assumed) for m in meant if m.told.assumed})
    poses = [m.target for m in meant if m.target.kind == "pose"]
    bare = sum(t.base is None for t in poses) * (given.base is None)
    unnamed = (bare, sum(t.tool is None for t in poses) * (given.tool is None))
    notes = _outside(robot, [one.meant for one in done])
    return Correction(text, tuple(done), in_order(left), robot.drivers, tuple(assumed), unnamed, notes)


def _outside(robot: Robot, meant: Sequence[Meant]) -> tuple[str, ...]:
    """Return a note on corrected targets that lie outside of what the calibration saw."""
    q = np.array([one.q for one in meant]).reshape(len(meant), len(robot.home))
    z = np.tile(robot.solver.z, (len(meant), 1))
    return outside_notes(robot.solver.model, q, z, lambda k: f"line {meant[k].target.line}", rows="targets")


def _beyond(target: Target) -> str | None:
    """Why numbers of a target are no place: no controller has them, and their squares are none."""
    far = [n.text for n in (*target.numbers, *target.configuration) if not abs(n.value) <= LARGEST]
    return f"its number {shown(far[0], 30)} is beyond {LARGEST:g}" if far else None


def _check(robot: Robot, program: Program) -> Program:
    """Refuse programs of other robots; the program, of fewer joints than six without configurations: they are six joints'."""
    machine, task = robot.machine, robot.solver.task
    joints = machine.mechanism.actuators
    if not program.targets and not program.left:
        raise InputError("found no target in the program, expected poses or joints that it moves to")
    if any(t.kind == "pose" for t in program.targets) and (
        len(joints) != len(task.rows) or len(task.along) < 3
    ):
        raise InputError(
            f"{machine.name}: found {len(joints)} joints, which meet {task.words}, expected six, or fewer that meet x, y "
            "and z: a program's pose tells the joints of no other robot"
        )
    odd = [a.reading for a in joints if a.reading_unit not in ("rad", "mm")]
    counts = {len(t.numbers) for t in program.targets if t.kind == "joints"}
    if counts and (odd or counts != {len(joints)}):
        found = f"joints {', '.join(odd)} in turns" if odd else f"{len(joints)} joints"
        raise InputError(
            f"{machine.name}: found {found}, expected {max(counts)} joints in angles and lengths, as the program has them"
        )
    if len(joints) == len(AXES):
        return program
    bare = tuple(replace(target, configuration=()) for target in program.targets)
    return replace(program, targets=bare, configuration=None)


def _solved(robot: Robot, program: Program, meant: list[Meant], left: list[Left]) -> list[Corrected]:
    out: list[Corrected] = []
    for tool, rows in by_tool([(k, m.told) for k, m in enumerate(meant)]):
        some = [meant[k] for k in rows]
        goal, q = np.array([m.goal for m in some]), np.array([m.q for m in some])
        robot.real(tool)
        before = robot.missed(goal, robot.solver.forward(q)[0])
        found = robot.solver.inverse(goal, q, restarts=0, rewind=False)
        robot.nominal(tool)
        seen = robot.solver.forward(found.q)[0]
        change = robot.missed(goal, seen)
        for row, m in enumerate(some):
            why = _refused(robot, found.status[row], found.saturated(row), found.q[row] - q[row])
            new = _texts(robot, program, m, found.q[row], seen[row]) if why is None else None
            if new is None:
                left.append(Left(m.target.line, m.target.name, why or _WRIST))
                continue
            turned = new[len(m.target.numbers) :] != tuple(n.text for n in m.target.configuration)
            out.append(Corrected(m, new, found.q[row], change[row], before[row], turned))
    return sorted(out, key=lambda one: (one.target.line, one.target.numbers[0].start))


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


def _texts(robot: Robot, program: Program, m: Meant, q: Array, seen: Array) -> tuple[str, ...] | None:
    """New texts of a target's numbers and configuration; None where it would be in another one."""
    numbers = m.target.numbers
    if m.target.kind == "joints":
        units = joint_units(robot, program)
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
    pairs = zip(renewed, old, m.target.configuration, strict=True)
    return (*out, *(n.text if a == b else f"{a:.0f}" for a, b, n in pairs))


def edited(text: str, solved: Sequence[Corrected]) -> str:
    """Return the text with what was solved for in it."""
    return replaced(text, edits_of(solved))
