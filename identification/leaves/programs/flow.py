"""Which assignments a place of a program can see: a reading of its text from top to bottom that runs nothing.

An assignment hides those before it from places in its own block; one in a branch hides none behind the branch; one in a loop
reaches the loop's beginning. Calls of functions of the text are followed. The first function begins without a value. Another
one that the text does not call may begin with whatever others assign, and so may what is declared outside of functions.
Programs that jump, or run functions side by side, see every assignment everywhere. Inside a function a parameter is a name of
its own.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from truepose.identification.leaves.programs.program import closing


@dataclass(frozen=True)
class Assignment:
    """A value that a program gives to a name (lower case): the text ``[start:end]`` of it.

    ``partly``: what was assigned before stays visible, because only a component is changed or a condition stands in the
    statement. ``parameter``: calls of the function give the value; the text is the list of its parameters. ``call``: a call,
    at ``end``, of the function that begins at ``start`` gives it.
    """

    name: str
    start: int
    end: int
    partly: bool = False
    parameter: bool = False
    call: bool = False

    @property
    def is_whole(self) -> bool:
        """True if the text that is assigned is the whole value."""
        return not self.partly and not self.parameter


@dataclass(frozen=True)
class Keywords:
    """Patterns of a language: one match opens a block, turns to its next branch, or closes it; ``jump`` leaves the order.

    ``parameter`` finds the name in one piece of a list of parameters; ``call`` what may be the name in a call.
    """

    function: str
    loop: str
    branch: str
    turn: str
    close: str
    jump: str
    parameter: str = r"^\s*(?P<name>[A-Za-z_]\w*)"
    call: str = r"\b\w+(?=[ \t]*\()"


@dataclass
class _Block:
    """A piece of the text of one kind of ``Keywords``, or of all of it (``text``)."""

    kind: str
    start: int
    end: int
    around: _Block | None = None

    def holds(self, place: int) -> bool:
        return self.start <= place < self.end

    @property
    def function(self) -> _Block:
        """The function around, or all of the text."""
        block = self
        while block.kind != "function" and block.around is not None:
            block = block.around
        return block


_TEXT = -1
"""Where all of the text begins, before any function."""
_BEGIN = r"(?i)(?<![^\r\n;])[ \t]*+"
Held = tuple[Assignment | None, ...]
"""Assignments that may hold at a place; None for none."""


class Flow:
    """Assignments of a text whose comments and strings are blank."""

    def __init__(self, mask: str, words: Keywords, assignments: Iterable[Assignment]) -> None:
        self._edges: list[int] = []
        self._inner: list[_Block] = []
        self._open_blocks(mask, words)
        self._jumps = re.search(f"{_BEGIN}{words.jump}", mask) is not None
        heads = {
            m["name"].lower(): m
            for m in re.finditer(rf"{_BEGIN}{words.function}[^\r\n(]*?(?P<name>\w+)[ \t]*\(", mask)
        }
        self._calls = self._find_calls(mask, heads, words.call)
        self._parameters: dict[str, set[int]] = {}
        names: dict[str, list[Assignment]] = {}
        for one in _parameters(mask, heads.values(), words.parameter):
            self._parameters.setdefault(one.name, set()).add(self._at(one.start).function.start)
            names.setdefault(self.scoped(one.name, one.end), []).append(one)
        for one in assignments:
            names.setdefault(self.scoped(one.name, one.end), []).append(one)
        self._names = {name: sorted(several, key=lambda one: one.end) for name, several in names.items()}
        self._events: dict[str, dict[int, list[Assignment]]] = {}

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

    def assigned(self, name: str, place: int) -> list[Assignment]:
        """Return all assignments to what a name is at a place; to ``a[3]`` also those to an element that is worked out."""
        array, bracket, _ = name.lower().partition("[")
        anywhere = self._names.get(f"{array}[]", []) if bracket else []
        return [*anywhere, *self._names.get(self.scoped(name, place), [])]

    def reaching(self, name: str, place: int) -> Held:
        """Return the assignments that a name may have its value from at a place."""
        every = self.assigned(name, place)
        if self._jumps or any(one.name.endswith("[]") for one in every):
            return (*every, *([] if any(one.end <= place for one in every) else [None]))
        key = self.scoped(name, place)
        if key not in self._events:
            self._events[key] = self._events_of(every)
        return tuple(dict.fromkeys(self._holding(self._events[key], place, set())))

    def _open_blocks(self, mask: str, words: Keywords) -> None:
        block = _Block("text", _TEXT, len(mask))
        self._edges, self._inner = [_TEXT], [block]
        kinds = ("function", "loop", "branch", "turn", "close")
        pattern = "|".join(f"(?P<{kind}>{getattr(words, kind)})" for kind in kinds)
        for m in re.finditer(f"{_BEGIN}(?:{pattern})", mask):
            kind, around = m.lastgroup or "", block.around
            if kind in ("turn", "close"):
                if around is None:
                    continue
                block.end = m.start()
                block = around
            if kind != "close":
                block = _Block("branch" if kind == "turn" else kind, m.start(), len(mask), block)
            self._edges.append(m.start())
            self._inner.append(block)

    def _find_calls(self, mask: str, heads: dict[str, re.Match[str]], call: str) -> dict[int, list[int]]:
        """Return the places of calls of each function that is called."""
        out: dict[int, list[int]] = {}
        for m in re.finditer(call, mask) if heads else ():
            head = heads.get(m.group().lower())
            if head is not None and m.start() != head.start("name"):
                out.setdefault(self._at(head.end()).function.start, []).append(m.start())
        return out

    def _events_of(self, every: list[Assignment]) -> dict[int, list[Assignment]]:
        """Return assignments, and calls of functions that make them, in order by the function they are in."""
        events, setting = list(every), [self._at(one.end).function.start for one in every]
        setting = list(dict.fromkeys(setting))
        for function in setting:  # grows while it is gone through
            for place in self._calls.get(function, ()):
                events.append(Assignment("", function, place, call=True))
                caller = self._at(place).function.start
                if caller not in setting:
                    setting.append(caller)
        out: dict[int, list[Assignment]] = {}
        for one in sorted(events, key=lambda one: one.end):
            out.setdefault(self._at(one.end).function.start, []).append(one)
        return out

    def _holding(
        self, events: dict[int, list[Assignment]], place: int, seen: set[tuple[str, int]]
    ) -> Iterator[Assignment | None]:
        """Yield what may hold at a place; ``seen`` are beginnings and ends of functions that were looked at already."""
        function = self._at(place).function
        own = events.get(function.start, [])
        k = bisect.bisect_right(own, place, key=lambda one: one.end)
        back = range(k - 1, -1, -1)
        sure = next((j for j in back if not own[j].partly and self._at(own[j].end).holds(place)), None)
        if sure is None and ("begin", function.start) not in seen:
            seen.add(("begin", function.start))
            yield from self._at_begin(events, function, seen)
        loop = self._loop_end(place, None if sure is None else own[sure].end)
        again = bisect.bisect_left(own, loop, key=lambda one: one.end)
        for one in own[sure or 0 : max(k, again)]:
            if not one.call:
                yield one
            elif ("end", one.start) not in seen:
                seen.add(("end", one.start))
                yield from self._holding(events, self._at(one.start).end - 1, seen)

    def _at_begin(
        self, events: dict[int, list[Assignment]], function: _Block, seen: set[tuple[str, int]]
    ) -> Iterator[Assignment | None]:
        """Yield what may hold where a function begins."""
        for place in self._calls.get(function.start, ()):
            yield from self._holding(events, place - 1, seen)
        if function.start in self._calls:
            return
        around = [one for one in events.get(_TEXT, ()) if not one.call and function.kind == "function"]
        first = next((block for block in self._inner if block.kind == "function"), None)
        others = [
            one
            for start, several in events.items()
            if (around or function is not first) and start not in (_TEXT, function.start, *self._calls)
            for one in several
            if not one.call
        ]
        yield from [*around, *others, *([] if around else [None])]

    def _loop_end(self, place: int, sure: int | None) -> int:
        """Return the end of the outermost loop around a place that does not have the ``sure`` assignment inside."""
        block: _Block | None = self._at(place)
        end = place
        while block is not None:
            if block.kind == "loop" and (sure is None or not block.holds(sure)):
                end = block.end
            block = block.around
        return end

    def _at(self, place: int) -> _Block:
        return self._inner[bisect.bisect_right(self._edges, place) - 1]


def _parameters(mask: str, heads: Iterable[re.Match[str]], pattern: str) -> Iterator[Assignment]:
    """Yield the parameters of each function."""
    for m in heads:
        start, end = m.end() - 1, closing(mask, m.end() - 1)
        for piece in re.split(r"[,|\\]", mask[start + 1 : end]) if end is not None else ():
            if (name := re.search(pattern, piece)) is not None:
                yield Assignment(name["name"].lower(), start, (end or start) + 1, parameter=True)
