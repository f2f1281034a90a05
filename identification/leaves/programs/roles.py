"""What motions make of one literal: in which frames they go to it, and whether it is a frame itself.

A correction belongs to a target in its frames. So a literal is corrected where it is written if all motions go to it in the
same frames and nothing takes it for a frame. Otherwise it stays, and each motion gets a corrected copy of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from truepose.identification.leaves.programs.program import Copies, Left, Lines, Span, Target

ARGUMENT = "calls of its function give it its value"
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


def targets_of(way: Way, bare: Target, text: str, literal: Span, lines: Lines) -> list[Target]:
    """Return the target that motions of one way go to, given what ``literal`` in a text says of it; none where none may get a
    copy."""
    own = [one for one in way.goings if not one.elsewhere and (way.names is None or one.span is not None)]
    if way.names is not None and not own:
        return []
    (start, end), first = literal, way.goings[0] if way.names is None else own[0]
    spans = tuple((n.start - start, n.end - start) for n in (*bare.numbers, *bare.configuration))
    places = tuple(one.place for one in own)
    target = replace(
        bare, line=lines.of(start if way.names is None else first.place), base=first.base, tool=first.tool,
        place=places[0] if places else bare.place, near=first.near, loose=all(one.loose for one in way.goings),
        within=first.within, places=places, copies=None if way.names is None else Copies(text[start:end], spans, way.names),
    )  # fmt: skip
    return [target]


def worked_out(going: Going, name: Span, bare: Target, literal: str, lines: Lines) -> list[Target]:
    """Return the target of a motion to what the text works out: a ``literal`` that is written where the motion names it."""
    way = Way((replace(going, name=name, sure=True),), (name,))
    return targets_of(way, bare, literal, (0, len(literal)), lines)


def unsure(way: Way, name: str, lines: Lines) -> list[Left]:
    """Return the motions of a way that should get a copy and may not."""
    lost = [one for one in way.goings if one.span is None and not one.elsewhere]
    return [] if way.names is None else [Left(lines.of(one.place), name, SEVERAL) for one in lost]
