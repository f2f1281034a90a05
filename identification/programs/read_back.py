"""Read a corrected program back before it is published: its targets must have the numbers that were solved for."""

from __future__ import annotations

from truepose.errors import InputError, ReadBackError
from truepose.identification.programs.correct import Correction
from truepose.identification.programs.frames import shown_name
from truepose.identification.programs.program import Dialect, Program, Target
from truepose.models.machine import Machine


def check_program(
    found: Correction, program: Program, dialect: Dialect, machine: Machine, beside: str | None, name: str
) -> None:
    """Raise ReadBackError, which ``name`` opens, unless a corrected text has the targets of ``program`` with new numbers.

    ``beside``: the text of the file that belongs to the program, where there is one. All numbers are compared as they are
    written, so that the error that is stated for each target is that of the file.
    """
    try:
        again = dialect.read(found.text, machine, beside)
    except InputError as exc:
        raise ReadBackError(f"{name}: what was to be written cannot be read: {exc}") from exc
    new = {one.target.numbers[0].start: one.numbers for one in found.done}
    if len(again.targets) != len(program.targets):
        raise ReadBackError(
            f"{name}: what was to be written has {len(again.targets)} targets, expected {len(program.targets)}"
        )
    for read, was in zip(again.targets, program.targets, strict=True):
        texts = _texts(was)
        meant = (*(corrected := new.get(was.numbers[0].start, ())), *texts[len(corrected) :])
        for what in (
            "name",
            "kind",
            "base",
            "tool",
        ):  # the place in the text that frames' names have is another one
            there, meant_to_be = (shown_name(str(getattr(one, what))) for one in (read, was))
            if there != meant_to_be:
                raise ReadBackError(
                    f"{name}:{read.line}: what was to be written has a target with the {what} {there}, expected {meant_to_be}"
                )
        if _texts(read) != meant:
            raise ReadBackError(
                f"{name}:{read.line}: what was to be written reads as another target: {read.name} is "
                f"{', '.join(_texts(read))}, expected {', '.join(meant)}"
            )


def _texts(target: Target) -> tuple[str, ...]:
    """Return the numbers of a target and of its configuration as they are written."""
    return tuple(number.text for number in (*target.numbers, *target.configuration))


__all__ = ["check_program"]
