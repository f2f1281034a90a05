"""Hold a robot program as what can be corrected in it: targets, the spans of their numbers, and what is left as it is.

Texts are decoded as Latin-1, one character a byte, so that whatever stands between the numbers is written back as it was.
"""

from __future__ import annotations

import bisect
import functools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from truepose.identification.leaves.programs.configurations import Configuration
from truepose.identification.leaves.programs.pose_forms import Form

Kind = Literal["pose", "joints"]
Span = tuple[int, int]
NUMBER = r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?"
WHOLE_NUMBER = re.compile(NUMBER)
_BRACKET = re.compile(r"[][(){}]")
LARGEST = 1e9
"""mm, deg: a coordinate beyond is none."""
BASE_ITSELF = ""
"""Name of the frame that is the robot's base itself; as a tool's name, of the flange."""


@dataclass(frozen=True)
class Number:
    """A number of a text: ``text[start:end]``."""

    start: int
    end: int
    text: str

    @property
    def value(self) -> float:
        return float(self.text)


@dataclass(frozen=True)
class Copies:
    """Where motions name a target whose own numbers have to stay: each gets a literal of its own there.

    ``literal`` is its text, in which the target's numbers and those of its configuration are; ``names`` are the spans of the
    program's text that it takes the place of.
    """

    literal: str
    names: tuple[Span, ...]


@dataclass(frozen=True)
class Target:
    """A place that a program sends the robot to, in one way: several motions go there with the same frames.

    ``numbers`` are those of its pose in the order of the program's ``Form``, or of its joints; ``configuration`` are those that
    choose among solutions. ``base`` and ``tool`` name the frames it is told in: None is what the user says, ``BASE_ITSELF``
    none; ``within`` are frames inside the base, the outermost first. ``place`` is where in the text the program first goes
    there, ``places`` all; ``near`` are joints next to which it goes, as written. ``loose``: the controller does not look at
    the configuration there, so that no joints need to have it. ``copies``: where it is written instead of its own place.
    """

    line: int
    name: str
    kind: Kind
    numbers: tuple[Number, ...]
    configuration: tuple[Number, ...] = ()
    base: str | None = None
    tool: str | None = None
    place: int = 0
    near: tuple[float, ...] | None = None
    loose: bool = False
    within: tuple[str, ...] = ()
    places: tuple[int, ...] = ()
    copies: Copies | None = None


@dataclass(frozen=True)
class Left:
    """What is not corrected, or not as it would have to be: its line, what stands there, and why."""

    line: int
    what: str
    why: str


@dataclass(frozen=True)
class Program:
    """Targets of a text in its order. ``frames`` are the work objects, bases and tools whose numbers it states itself."""

    text: str
    targets: tuple[Target, ...]
    left: tuple[Left, ...]
    form: Form
    joint_units: Mapping[str, str]
    """Units of joints in the text, by their unit inside (rad, mm)."""
    frames: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    configuration: Configuration | None = None
    again: Callable[[str], Program] | None = field(default=None, compare=False)
    """Reads another text of the same kind, beside the same file."""


class Lines:
    """Lines of positions in a text, from 1."""

    def __init__(self, text: str) -> None:
        self._ends = [m.end() for m in re.finditer(r"\r\n|\n|\r", text)]

    def of(self, position: int) -> int:
        """The line that a position stands in."""
        return bisect.bisect_right(self._ends, position) + 1


def masked(text: str, comment: str, quote: str = r'"[^"\r\n]*"') -> str:
    """The text with comments and strings as spaces, every other character in its place."""
    return re.sub(f"{quote}|{comment}", lambda m: " " * len(m.group()), text)


def numbers_in(text: str, start: int, end: int) -> list[Number]:
    """The numbers between two positions."""
    found = WHOLE_NUMBER.finditer(text, start, end)
    return [Number(m.start(), m.end(), m.group()) for m in found]


def parts(text: str, start: int, end: int, mark: str = ",") -> list[tuple[int, int]]:
    """Spans between two positions, parted by ``mark`` outside of all brackets."""
    out, depth, begin = [], 0, start
    for k in range(start, end):
        if text[k] in "([{":
            depth += 1
        elif text[k] in ")]}":
            depth -= 1
        elif text[k] == mark and depth == 0:
            out.append((begin, k))
            begin = k + 1
    return [*out, (begin, end)]


def closing(text: str, opening: int) -> int | None:
    """Where the bracket that opens at a position closes; None where it does not."""
    return _closings(text).get(opening)


@functools.lru_cache(maxsize=2)
def _closings(text: str) -> Mapping[int, int]:
    """Where each bracket closes: all of a text in one pass, as a text may open many that never do."""
    out, opened = dict[int, int](), list[int]()
    for m in _BRACKET.finditer(text):
        if m.group() in "([{":
            opened.append(m.start())
        elif opened:
            out[opened.pop()] = m.start()
    return out


def shown(text: str, most: int = 60) -> str:
    """A piece of a program in one line of a message."""
    words = " ".join(text.encode("latin-1", "replace").decode("utf-8", "replace").split())
    return words if len(words) <= most else words[: most - 3] + "..."


def replaced(text: str, edits: Iterable[tuple[int, int, str]]) -> str:
    """The text with what is to stand at spans of it."""
    out, at = [], 0
    for start, end, new in sorted(edits):
        out += [text[at:start], new]
        at = end
    return "".join([*out, text[at:]])


def in_order(left: Sequence[Left]) -> tuple[Left, ...]:
    """By line, each once."""
    return tuple(sorted(dict.fromkeys(left), key=lambda one: one.line))
