"""Which assignments a place of a program can see: a reading of its text from top to bottom that runs nothing.

An assignment hides those before it from places in its own block; one in a branch hides none behind the branch; one in a loop
reaches the loop's beginning. Names that several functions assign, and programs that jump, are seen everywhere.
"""

from __future__ import annotations

import bisect
import itertools
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal as Choice

BlockKind = Choice["text", "function", "loop", "branch"]


@dataclass(frozen=True)
class Assignment:
    """A value that a program gives to a name (lower case): the text ``[start:end]`` of it, in ``file``.

    ``partly``: only a component is changed, so that what was assigned before stays visible.
    """

    name: str
    start: int
    end: int
    file: str = ""
    partly: bool = False


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
    """Patterns of a language: one match opens a block, turns to its next branch, closes it, or jumps."""

    function: str
    loop: str
    branch: str
    turn: str
    close: str
    jump: str = r"(?!)"

    def found(self, mask: str) -> Iterator[tuple[str, int]]:
        """Yield what begins, turns or ends, and where."""
        kinds = ("function", "loop", "branch", "turn", "close", "jump")
        pattern = "|".join(f"(?P<{kind}>{getattr(self, kind)})" for kind in kinds)
        for m in re.finditer(rf"(?i)(?<![^\r\n;])[ \t]*+(?:{pattern})", mask):
            yield m.lastgroup or "", m.start()


@dataclass
class Flow:
    """Assignments of a program in one text, and of the file that belongs to it."""

    length: int
    _edges: list[int] = field(default_factory=list)
    _inner: list[_Block] = field(default_factory=list)
    _names: dict[str, tuple[Assignment, ...]] = field(default_factory=dict)
    _homes: dict[str, set[int]] = field(default_factory=dict)
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
        for name, several in _by_name(assignments).items():
            out._names[name] = tuple(sorted(several, key=lambda one: one.end))
            out._homes[name] = {-1 if one.file else out._function(one.end) for one in several}
        return out

    def reaching(self, name: str, place: int) -> tuple[Assignment, ...]:
        """Return the assignments that a name may have its value from at a place."""
        every = self.assigned(name)
        if len(every) <= 1 or self._jumps or self._homes[name.lower()] != {self._function(place)}:
            return every
        k = bisect.bisect_right(every, place, key=lambda one: one.end)
        back = range(k - 1, -1, -1)
        sure = next((j for j in back if not every[j].partly and self._at(every[j].end).holds(place)), None)
        if sure is None:
            return every
        again = bisect.bisect_left(every, self._last_loop(place, every[sure]), key=lambda one: one.end)
        return every[sure : max(k, again)]

    def in_force(self, name: str, place: int) -> tuple[Assignment | None, ...]:
        """Return the assignments that may hold at a place, None for none, of what every function sets for itself.

        Without one in the place's own function that surely comes first, the last one before it in the text counts.
        """
        every, own = self.assigned(name), self._function(place)
        k = bisect.bisect_right(every, place, key=lambda one: one.end)
        first: Assignment | None = None
        here: list[Assignment] = []
        for one in (every[j] for j in range(k - 1, -1, -1)):
            if self._function(one.end) != own:
                first = first or one
                if one.end < own:
                    break
            elif self._at(one.end).holds(place):
                first = one
                break
            else:
                here.insert(0, one)
        end = self._last_loop(place, first)
        later = itertools.takewhile(lambda one: one.end < end, (every[j] for j in range(k, len(every))))
        again = [one for one in later if self._function(one.end) == own]
        return tuple(dict.fromkeys([first, *here, *again]))

    def assigned(self, name: str) -> tuple[Assignment, ...]:
        """Return all assignments to a name."""
        return self._names.get(name.lower(), ())

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


def _by_name(assignments: Iterable[Assignment]) -> dict[str, list[Assignment]]:
    out: dict[str, list[Assignment]] = {}
    for one in assignments:
        out.setdefault(one.name.lower(), []).append(one)
    return out


__all__ = ["Assignment", "Flow", "Keywords"]
