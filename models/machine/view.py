"""What a sensor reads, and from where: a frame of the machine (a tip), seen from the world or from another of its frames.

The fields that such sensors share are those of ``ViewSection``. One tip and a sensor in the world are the usual case.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pydantic import Field

from truepose.errors import InputError
from truepose.models.file.fields import Section
from truepose.models.machine.context import BuildContext
from truepose.wording import close_matches

WORLD: Final = "world"
TOOL: Final = "tool"


@dataclass(frozen=True)
class View:
    """The frame that a sensor reads, and the frame that its readings are in: both ``tool`` or a further frame of the file.

    ``frame`` may also be ``world``, the sensor's own.
    """

    tip: str = TOOL
    frame: str = WORLD

    @property
    def relative(self) -> bool:
        """Whether the machine, or another frame, carries the sensor."""
        return self.frame != WORLD


class ViewSection(Section):
    """The fields of a sensor that may read any frame, from any frame."""

    tip: str = TOOL
    """Frame that it reads: `tool`, or another of `frames`."""
    in_: str = Field(default=WORLD, alias="in")
    """Frame that its readings are in: `world`, or one of `frames` that carries it (a camera on a head, the other hand)."""

    def view(self, context: BuildContext) -> View:
        """Checked against the file's frames. Raises InputError naming the field."""
        known = (TOOL, *context.file.frames.further)
        for field, name, others in (("tip", self.tip, known), ("in", self.in_, (WORLD, *known))):
            if name not in others:
                raise InputError(
                    f"{context.where}.{field}: found {name!r}, expected {others[0]} or a frame that `frames` names; "
                    f"{close_matches(name, others)}"
                )
        if self.tip == self.in_:
            raise InputError(
                f"{context.where}.in: found {self.in_!r}, which is the tip that it reads, expected another frame"
            )
        return View(self.tip, self.in_)


TOOL_IN_WORLD: Final = View()
"""What every sensor has that states no other view."""


def prefix(name: str | None) -> str:
    """What opens the names of columns and parameters of a sensor that has a name."""
    return f"{name}." if name else ""
