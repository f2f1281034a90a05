"""Find the frames that a program's targets are told in: from the program, from the user, or the machine file's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.leaves.programs.program import BASE_ITSELF, LARGEST, Program, Target


@dataclass(frozen=True)
class Cell:
    """What the user says of frames, each as numbers in the program's own way of writing a pose.

    ``base`` and ``tool`` are those of targets for which the program says none; None is the robot's base, and the machine file's
    tool. ``frames`` are work objects, bases, features and tools that the program names, by name.
    """

    base: str | None = None
    tool: str | None = None
    frames: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Told:
    """Frames of a target: ``base`` (4, 4) in the robot's base; ``tool`` (4, 4) on the flange, None for the machine file's.

    ``assumed`` says which of a program's names was taken for what, where its numbers are not known.
    """

    base: Array
    tool: Array | None
    assumed: str | None = None


class Frames:
    """The frames of one program. Raises InputError for numbers that are no pose."""

    def __init__(self, program: Program, cell: Cell) -> None:
        self._program = program
        stated = {
            name.lower(): np.array(numbers) for name, numbers in program.frames.items() if is_rigid(numbers)
        }
        given = {name.lower(): self._numbers(f"--frame {name}", v) for name, v in cell.frames.items()}
        named = {one.lower() for t in program.targets for one in (t.base, t.tool, *t.within) if one}
        odd = [name for name in cell.frames if name.lower() not in set(map(shown_name, named))]
        if odd and named:
            known = ", ".join(sorted(set(map(shown_name, named))))
            raise InputError(
                f"--frame: found the name {odd[0]!r}, expected one that targets are told in: {known}"
            )
        self._known = stated | {name: given[shown_name(name)] for name in named if shown_name(name) in given}
        self._base = None if cell.base is None else self._pose(self._numbers("--base", cell.base))
        self._tool = None if cell.tool is None else self._pose(self._numbers("--tool", cell.tool))
        self._unknown_tools = {
            t.tool.lower() for t in program.targets if t.tool and t.tool.lower() not in self._known
        }

    def of(self, target: Target) -> Told | str:
        """Frames of a target, or why they are not known."""
        if target.kind == "joints":
            return Told(np.eye(4), None)
        base = np.eye(4) if self._base is None or target.base is not None else self._base
        for name in (target.base, *target.within):
            if name:
                numbers = self._known.get(name.lower())
                if numbers is None:
                    return self._missing("told in", name)
                base = base @ self._pose(numbers)
        tool = self._tool_of(target)
        return tool if isinstance(tool, str) else Told(base, *tool)

    def _tool_of(self, target: Target) -> tuple[Array | None, str | None] | str:
        if target.tool is None:
            return self._tool, None
        if target.tool == BASE_ITSELF:
            return np.eye(4), None
        numbers = self._known.get(target.tool.lower())
        if numbers is not None:
            return self._pose(numbers), None
        if len(self._unknown_tools) > 1:
            return self._missing("for the tool", target.tool)
        return self._tool, target.tool if self._tool is None else None

    def _missing(self, how: str, name: str) -> str:
        shown = shown_name(name)
        return (
            f"{how} {shown}, whose numbers are not known here: --frame '{shown}={self._program.form.words}'"
        )

    def _numbers(self, where: str, text: str) -> Array:
        count = len(self._program.form.decimals)
        try:
            out = np.array([float(word) for word in text.split(",")])
        except ValueError:
            out = np.zeros(0)
        if len(out) != count or not (np.abs(out) <= LARGEST).all():
            raise InputError(f"{where}: found {text!r}, expected {count} numbers {self._program.form.words}")
        if count == 7 and abs(float(np.sum(out[3:] ** 2)) - 1.0) > 0.01:
            raise InputError(
                f"{where}: found {text!r}, expected a quaternion of length 1 in the last four numbers"
            )
        return out

    def _pose(self, numbers: Array) -> Array:
        out: Array = self._program.form.poses(numbers[None, :])[0]
        return out


def is_rigid(numbers: Sequence[float]) -> bool:
    """Whether the numbers of a frame are a pose; of one that a program states with others the numbers are not known."""
    return max(map(abs, numbers)) <= LARGEST and (
        len(numbers) != 7 or abs(sum(v**2 for v in numbers[3:]) - 1.0) <= 0.01
    )


def shown_name(name: str) -> str:
    """A frame's name as a person knows it: without the place in the text that tells several apart."""
    return name.partition("@")[0]
