"""What motions make of one literal: in which frames they go to it, and whether it is a frame itself.

A correction belongs to a target in its frames. So a literal is corrected where it is written if all motions go to it in the
same frames and nothing takes it for a frame. Otherwise it stays, and each motion gets a corrected copy of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from truepose.identification.programs.program import Copies, Number, Span

SEVERAL = "motions go to it in several ways, and what they name may have several values there"


@dataclass(frozen=True)
class Going:
    """A motion to a literal: the names of its frames (as in ``Target``), and where in the text it is.

    ``name``: the span of text that names the literal, None where the literal itself is there; ``sure``: the name has no other
    value there; ``elsewhere``: the motion is in the file beside. ``near`` as in ``Target``; ``loose``: the motion does not
    look at configurations.
    """

    base: str | None
    within: tuple[str, ...]
    tool: str | None
    place: int = field(compare=False)
    name: Span | None = field(default=None, compare=False)
    sure: bool = field(default=True, compare=False)
    near: tuple[float, ...] | None = field(default=None, compare=False)
    loose: bool = field(default=False, compare=False)
    elsewhere: bool = field(default=False, compare=False)

    @property
    def span(self) -> Span | None:
        """Where a copy of the literal may be written; None where it may not."""
        return self.name if self.sure and not self.elsewhere else None


@dataclass(frozen=True)
class Way:
    """Motions that go to a literal in the same frames, and the text that gets a copy; None where the literal is changed."""

    goings: tuple[Going, ...]
    names: tuple[Span, ...] | None


def ways_to(goings: Sequence[Going], *, is_frame: bool, in_frames: bool) -> list[Way]:
    """Return the ways in which motions go to one literal; ``in_frames``: its meaning depends on them (a pose)."""
    groups: dict[Going | None, list[Going]] = {}
    for one in goings:
        groups.setdefault(one if in_frames else None, []).append(one)
    alone = len(groups) == 1 and not is_frame
    return [
        Way(tuple(group), None if alone else tuple(one.span for one in group if one.span is not None))
        for group in groups.values()
    ]


def copies_of(
    text: str, literal: Span, numbers: Sequence[Number], names: tuple[Span, ...] | None
) -> Copies | None:
    """Return what is written at ``names`` for a literal of a text; None where it is changed itself."""
    if names is None:
        return None
    start, end = literal
    return Copies(text[start:end], tuple((n.start - start, n.end - start) for n in numbers), names)


__all__ = ["SEVERAL", "Going", "Way", "copies_of", "ways_to"]
