"""A corrected program run from its text: read anew, solved as the nominal controller does, and moved by the real machine.

What a program does is compared with what the program before it meant, motion by motion. So a fault in what was edited, in
how it reads, or in which frames a motion goes by cannot hide behind the numbers that were solved for.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError, ReadBackError
from truepose.identification.leaves.programs.frames import Frames, Told
from truepose.identification.leaves.programs.meaning import Meant, by_tool, joint_values
from truepose.identification.leaves.programs.program import Program, Target, replaced
from truepose.identification.leaves.programs.robot import Robot

MISSED = 0.01
"""mm, and as an angle at the reach of the machine: no motion of a corrected program may end farther from where it should.
Written numbers are rounded to a tenth of a micrometre."""
_WRONG = "what was to be written"


@dataclass(frozen=True)
class Solved:
    """A target with the joints ``q`` (nq,) that bring the real tool there, and what is written for it.

    ``change`` and ``before`` (6,) are the correction, and where the real tool is from the target with the program as it was.
    """

    meant: Meant
    numbers: tuple[str, ...]
    q: Array
    change: Array
    before: Array
    reconfigured: bool


def run(
    robot: Robot, programs: tuple[Program, Program], frames: tuple[Frames, Frames], solved: Sequence[Solved]
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
            raise ReadBackError(f"{other.line}: {_wrong(other)}: {told}")
        else:
            now.append((k, other, told))
    after: list[Array] = [np.zeros(6) for _ in solved]
    for tool, rows in by_tool([(row, told) for row, (_, _, told) in enumerate(now)]):
        some = [now[row] for row in rows]
        q = _commands(robot, programs[1], some, solved, tool)
        robot.real(tool)
        missed = robot.missed(
            np.array([solved[k].meant.goal for k, _, _ in some]), robot.solver.forward(q)[0]
        )
        for (k, other, _), one in zip(some, missed, strict=True):
            size = max(float(np.linalg.norm(one[:3])), robot.solver.size * float(np.linalg.norm(one[3:])))
            if not size <= MISSED:
                raise ReadBackError(
                    f"{other.line}: {_wrong(other)}: run, it misses by {size:.3g} mm, expected {MISSED:g}"
                )
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


def edits_of(solved: Sequence[Solved]) -> list[tuple[int, int, str]]:
    """Return what is written at spans of the text: new numbers, and literals where motions get a copy of their own."""
    edits: list[tuple[int, int, str]] = []
    for one in solved:
        target = one.meant.target
        if target.copies is None:
            old = (*target.numbers, *target.configuration)
            edits += [(n.start, n.end, new) for n, new in zip(old, one.numbers, strict=True)]
        else:
            spans = target.copies.spans[: len(one.numbers)]
            new = [(*at, number) for at, number in zip(spans, one.numbers, strict=True)]
            edits += [(*span, replaced(target.copies.literal, new)) for span in target.copies.names]
    return sorted(edits)


def _pairs(program: Program, again: Program, solved: Sequence[Solved]) -> list[tuple[Target, Target]]:
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
            raise ReadBackError(f"{other.line}: {_wrong(other)}, expected {target.kind} of {target.name}")
    return pairs


def _motions(program: Program) -> list[Target]:
    """Return the target of each motion, in the order of the text."""
    every = [(place, t.numbers[0].start, k) for k, t in enumerate(program.targets) for place in t.places]
    return [program.targets[k] for *_, k in sorted(every)]


def _wrong(other: Target) -> str:
    return f"{_WRONG} reads as another target: {other.name}"


def _check_same(target: Target, other: Target, told: Told | str, now: Told | str) -> None:
    """Raise ReadBackError where a target that was not corrected means another place."""
    here, there = ([n.text for n in (*t.numbers, *t.configuration)] for t in (target, other))
    if isinstance(told, str) or isinstance(now, str):
        same = isinstance(told, str) and isinstance(now, str)
    else:
        same = np.allclose(told.base, now.base, rtol=0, atol=1e-9) and (told.tool is None) == (
            now.tool is None
        )
        same = same and (
            told.tool is None or now.tool is None or np.allclose(told.tool, now.tool, rtol=0, atol=1e-9)
        )
    if here != there or not same:
        raise ReadBackError(
            f"{other.line}: {_wrong(other)} is {', '.join(there)}, expected {', '.join(here)}"
        )


def _commands(
    robot: Robot,
    program: Program,
    some: Sequence[tuple[int, Target, Told]],
    solved: Sequence[Solved],
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
