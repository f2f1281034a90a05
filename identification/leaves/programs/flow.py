"""Which assignments a place of a program can see: a reading of its text from top to bottom that runs nothing.

An assignment hides those before it from places in its own block; one in a branch hides none behind the branch; one in a loop
reaches the loop's beginning. Names that several functions assign, and programs that jump, are seen everywhere.
Inside a function a parameter is a name of its own: it hides what others assign to that name, and hides from them what it gets.

What motions make of one literal: in which frames they go to it, and whether it is a frame itself.

A correction belongs to a target in its frames. So a literal is corrected where it is written if all motions go to it in the
same frames and nothing takes it for a frame. Otherwise it stays, and each motion gets a corrected copy of its own.
"""

from __future__ import annotations

import bisect
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal as Choice

from truepose.identification.leaves.programs.program import (
    ELSEWHERE,
    Copies,
    Left,
    Lines,
    Span,
    Target,
    closing,
)

# -- What motions make of one literal: in which frames they go to it, and whether it is a frame itself

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


# -- Which assignments a place of a program can see: a reading of its text from top to bottom that runs nothing

_NAME = re.compile(r"[A-Za-z_]\w*")
BlockKind = Choice["text", "function", "loop", "branch"]


@dataclass(frozen=True)
class Assignment:
    """A value that a program gives to a name (lower case): the text ``[start:end]`` of it, in ``file``.

    ``partly``: only a component is changed, so that what was assigned before stays visible. ``parameter``: calls of the
    function give the value; the text is the list of its parameters.
    """

    name: str
    start: int
    end: int
    file: str = ""
    partly: bool = False
    parameter: bool = False

    @property
    def is_whole(self) -> bool:
        """True if the text that is assigned is the whole value."""
        return not self.partly and not self.parameter


@dataclass
class _Block:
    kind: BlockKind
    start: int
    around: _Block | None = None
    end: int = 0

    def holds(self, place: int) -> bool:
        return self.start <= place < self.end


@dataclass(frozen=True)
class Keywords:
    """Patterns of a language: one match opens a block, turns to its next branch, closes it, or jumps.

    ``parameter`` finds the name in one piece of a list of parameters.
    """

    function: str
    loop: str
    branch: str
    turn: str
    close: str
    jump: str = r"(?!)"
    parameter: str = r"^\s*(?P<name>[A-Za-z_]\w*)"

    def found(self, mask: str) -> Iterator[tuple[str, int]]:
        """Yield what begins, turns or ends, and where."""
        kinds = ("function", "loop", "branch", "turn", "close", "jump")
        pattern = "|".join(f"(?P<{kind}>{getattr(self, kind)})" for kind in kinds)
        for m in re.finditer(rf"(?i)(?<![^\r\n;])[ \t]*+(?:{pattern})", mask):
            yield m.lastgroup or "", m.start()

    def heads(self, mask: str) -> Iterator[re.Match[str]]:
        """Yield the head of each function, with its name, to the bracket before its parameters."""
        yield from re.finditer(
            rf"(?i)(?<![^\r\n;])[ \t]*+{self.function}[^\r\n(]*?(?P<name>\w+)[ \t]*\(", mask
        )

    def parameters(self, mask: str) -> Iterator[Assignment]:
        """Yield the parameters of each function."""
        for m in self.heads(mask):
            start, end = m.end() - 1, closing(mask, m.end() - 1)
            for piece in re.split(r"[,|\\]", mask[start + 1 : end]) if end is not None else ():
                if (name := re.search(self.parameter, piece)) is not None:
                    yield Assignment(name["name"], start, (end or start) + 1, parameter=True)


@dataclass
class _Held:
    """Assignments and calls of one name, and what may hold when functions, by their beginning, begin and end."""

    events: list[Assignment]
    begin: dict[int, dict[Assignment | None, None]] = field(default_factory=dict)
    end: dict[int, dict[Assignment | None, None]] = field(default_factory=dict)


@dataclass
class Flow:
    """Assignments of a program in one text, and of the file that belongs to it."""

    length: int
    _edges: list[int] = field(default_factory=list)
    _inner: list[_Block] = field(default_factory=list)
    _names: dict[str, tuple[Assignment, ...]] = field(default_factory=dict)
    _homes: dict[str, set[int]] = field(default_factory=dict)
    _parameters: dict[str, set[int]] = field(default_factory=dict)
    _calls: dict[int, list[int]] = field(default_factory=dict)
    """Places of calls by the function, which goes by its beginning."""
    _held: dict[str, _Held] = field(default_factory=dict)
    _jumps: bool = False

    @classmethod
    def of(cls, mask: str, words: Keywords, assignments: Iterable[Assignment]) -> Flow:
        """Return the flow of a text whose comments and strings are blank."""
        out, block = cls(len(mask)), _Block("text", 0)
        block.end = out.length
        out._edges, out._inner = [0], [block]
        for kind, place in words.found(mask):
            block = out._step(block, kind, place)
        while block.around is not None:
            block.end, block = out.length, block.around
        out._calls = out._called(mask, words)
        given = list(words.parameters(mask))
        for one in given:
            out._parameters.setdefault(one.name.lower(), set()).add(out._function(one.start))
        by_name: dict[str, list[Assignment]] = {}
        for one in (*given, *assignments):
            name = one.name.lower() if one.file else out.scoped(one.name, one.end)
            by_name.setdefault(name, []).append(one)
        for name, several in by_name.items():
            out._names[name] = tuple(sorted(several, key=lambda one: one.end))
            out._homes[name] = {-1 if one.file else out._function(one.end) for one in several}
        return out

    def scoped(self, name: str, place: int) -> str:
        """Return a name in lower case; that of a parameter with the place of its function behind ``@``."""
        name = name.lower()
        owners = self._parameters.get(name, ())
        block: _Block | None = self._at(place) if owners else None
        while block is not None:
            if block.kind == "function" and block.start in owners:
                return f"{name}@{block.start}"
            block = block.around
        return name

    def reaching(self, name: str, place: int) -> tuple[Assignment, ...]:
        """Return the assignments that a name may have its value from at a place."""
        every = self.assigned(name, place)
        if len(every) <= 1 or self._jumps or self._homes[self.scoped(name, place)] != {self._function(place)}:
            return every
        k = bisect.bisect_right(every, place, key=lambda one: one.end)
        back = range(k - 1, -1, -1)
        sure = next((j for j in back if not every[j].partly and self._at(every[j].end).holds(place)), None)
        if sure is None:
            return every
        again = bisect.bisect_left(every, self._last_loop(place, every[sure]), key=lambda one: one.end)
        return every[sure : max(k, again)]

    def in_force(self, name: str, place: int) -> tuple[Assignment | None, ...]:
        """Return the assignments that may hold at a place, None for none, of what functions set for all.

        Calls of functions of this text are followed. In a function that the text does not call, before its first assignment,
        the last one before it in the text counts.
        """
        key = name.lower()
        if key not in self._held:
            self._held[key] = held = _Held(self._events(name))
            while self._follow(held):
                pass
        return tuple(self._holding(self._held[key], place))

    def _events(self, name: str) -> list[Assignment]:
        """Return assignments to a name and, as changes of a part, calls of functions that assign it, in order."""
        every = self.assigned(name, 0)
        setting = {self._function(one.end) for one in every}
        events, size = list(every), -1
        while size != len(setting):
            size = len(setting)
            calls = [(f, place) for f in setting for place in self._calls.get(f, ())]
            events = [*every, *(Assignment(name, f, place, partly=True) for f, place in calls)]
            setting |= {self._function(place) for _, place in calls}
        return sorted(events, key=lambda one: one.end)

    def _follow(self, held: _Held) -> bool:
        """Renew what holds when functions begin and end; return True if that changed."""
        before = dict(held.begin), dict(held.end)
        for f, places in self._calls.items():
            held.begin[f] = dict.fromkeys(one for place in places for one in self._holding(held, place - 1))
            held.end[f] = dict.fromkeys(self._holding(held, self._at(f).end - 1))
        return before != (held.begin, held.end)

    def _holding(self, held: _Held, place: int) -> list[Assignment | None]:
        """Return what holds at a place by what is known of functions."""
        every, own = held.events, self._function(place)
        k = bisect.bisect_right(every, place, key=lambda one: one.end)
        sure: Assignment | None = None
        other: Assignment | None = None
        here: list[Assignment] = []
        for one in (every[j] for j in range(k - 1, -1, -1)):
            home = self._function(one.end)
            if home != own:
                other = other or (None if home in self._calls else one)
                if one.end < own and (other or own in self._calls):
                    break
            elif self._at(one.end).holds(place):
                sure = one
                break
            else:
                here.insert(0, one)
        end = self._last_loop(place, sure)
        later = itertools.takewhile(lambda one: one.end < end, (every[j] for j in range(k, len(every))))
        again = [one for one in later if self._function(one.end) == own]
        first = [sure] if sure else held.begin.get(own, ()) if own in self._calls else [other]
        found = [
            [one] if one is None or not one.partly else held.end.get(one.start, ())
            for one in (*first, *here, *again)
        ]
        return list(dict.fromkeys(itertools.chain.from_iterable(found)))

    def _called(self, mask: str, words: Keywords) -> dict[int, list[int]]:
        """Return the places of calls of each function that is called."""
        heads = {m["name"].lower(): m for m in words.heads(mask)}
        starts = {m.start("name") for m in heads.values()}
        out: dict[int, list[int]] = {}
        for m in re.finditer(r"\b\w+(?=[ \t]*\()", mask) if heads else ():
            head = heads.get(m.group().lower())
            if head is not None and m.start() not in starts:
                out.setdefault(self._function(head.end()), []).append(m.start())
        return out

    def origins(self, mask: str, span: Span, literal: re.Pattern[str]) -> tuple[Span, ...]:
        """Return the literals that an expression may be made of, its names followed, and ``ELSEWHERE`` for what is not here."""
        spans = {span: None}
        queue = [span]
        for one in queue:
            for m in _NAME.finditer(mask, *one):
                reaching = self.reaching(m.group(), m.start())
                new = [ELSEWHERE if a.file or a.parameter else (a.start, a.end) for a in reaching]
                queue += [a for a in new if a not in spans and a != ELSEWHERE]
                spans.update(dict.fromkeys(new))
        found = [m.span() for one in queue for m in literal.finditer(mask, *one)]
        return (*found, *[ELSEWHERE] * (ELSEWHERE in spans))

    def assigned(self, name: str, place: int) -> tuple[Assignment, ...]:
        """Return all assignments to what a name is at a place."""
        return self._names.get(self.scoped(name, place), ())

    def _step(self, block: _Block, kind: str, place: int) -> _Block:
        """Open or close blocks at a place; return the one behind it."""
        if kind == "jump":
            self._jumps = True
            return block
        if kind in ("turn", "close"):
            if block.around is None:
                return block
            around = block.around
            block.end = place
            block = _Block("branch", place, around) if kind == "turn" else around
        else:
            block = _Block(kind, place, block)  # type: ignore[arg-type]
        self._edges.append(place)
        self._inner.append(block)
        return block

    def _at(self, place: int) -> _Block:
        return self._inner[bisect.bisect_right(self._edges, place) - 1]

    def _function(self, place: int) -> int:
        """Return where the function around a place begins."""
        block = self._at(place)
        while block.kind != "function" and block.around is not None:
            block = block.around
        return block.start

    def _last_loop(self, place: int, sure: Assignment | None) -> int:
        """Return the end of the outermost loop around a place that does not begin with the ``sure`` assignment inside."""
        block, end = self._at(place), place
        while block.around is not None:
            if block.kind == "loop" and (sure is None or not block.holds(sure.end)):
                end = block.end
            block = block.around
        return end
