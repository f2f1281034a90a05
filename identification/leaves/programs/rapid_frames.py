"""Work objects and tools of a RAPID module, and which of them its motions go by."""

from __future__ import annotations

import bisect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.identification.leaves.programs.program import LARGEST, NUMBER, Span, parts

_TEXT = r'(?:"(?:[^"]|"")*"|\w+)'
_POSE = (
    r"\[\s*\[\s*"
    + r"\s*,\s*".join([f"({NUMBER})"] * 3)
    + r"\s*\]\s*,\s*\[\s*"
    + r"\s*,\s*".join([f"({NUMBER})"] * 4)
    + r"\s*\]\s*\]"
)
_WOBJ = re.compile(
    rf"(?i)\bwobjdata\s+(\w+)\s*:=\s*\[\s*(TRUE|FALSE)\s*,\s*(TRUE|FALSE)\s*,\s*{_TEXT}\s*,\s*{_POSE}\s*,\s*{_POSE}\s*\]"
)
_TOOL = re.compile(rf"(?i)\btooldata\s+(\w+)\s*:=\s*\[\s*(TRUE|FALSE)\s*,\s*{_POSE}")
_MOVE = re.compile(
    r"(?i)(?<![\w.])(?P<how>(?:Move|Search|Trigg|Arc|Spot|Disp|Paint|Cap)[A-Za-z]*)(?:\s+|(?=\\))(?P<rest>[^;]*)"
)
_UNCHECKED = re.compile(r"(?i)(?<![\w.])Conf(?P<which>[LJ])\s*\\\s*Off\b")
_WITH = re.compile(r"(?i)\\\s*WObj\s*:=\s*(\w+)")
_NAME = re.compile(r"\s*(?P<name>[A-Za-z]\w*)\s*(?:\{[^{}]*\})?\s*")


@dataclass(frozen=True)
class Move:
    """The names of the work object and tool of a motion; None where nothing tells. ``checked``: it looks at configurations.

    ``span`` is what it goes to; ``one``: that names one value, not an element of an array; ``sure``: where it stands in the
    motion nothing else can.
    """

    wobj: str | None
    tool: str | None
    checked: bool = field(default=True, compare=False)
    span: Span = field(default=(0, 0), compare=False)
    one: bool = field(default=True, compare=False)
    sure: bool = field(default=False, compare=False)


@dataclass(frozen=True)
class Moves:
    """Motions by the name (lower case) of their target, and in the order of the text, from ``starts`` to ``ends``.

    ``others`` go to what is neither a name nor a literal.
    """

    names: Mapping[str, list[Move]]
    starts: list[int]
    ends: list[int]
    moves: list[Move]
    others: list[Move]

    def of_place(self, start: int) -> list[Move]:
        k = bisect.bisect_right(self.starts, start) - 1
        return [self.moves[k]] if k >= 0 and start < self.ends[k] else []


@dataclass(frozen=True)
class Cell:
    """Numbers (x y z q1 q2 q3 q4) of frames by name, and why others of them cannot be known."""

    frames: Mapping[str, tuple[float, ...]]
    moved: Mapping[str, str]


def moves(mask: str) -> Moves:
    """All motions of a module whose comments and strings are blank."""
    names: dict[str, list[Move]] = {}
    spans: list[tuple[int, int, Move]] = []
    others: list[Move] = []
    unchecked = {m["which"].upper() for m in _UNCHECKED.finditer(mask)}
    for m in _MOVE.finditer(mask):
        start, end = m.span("rest")
        pieces = parts(mask, start, end)
        wobj = _WITH.search(mask, start, end)
        positional = [p for p in pieces if not mask[slice(*p)].lstrip().startswith("\\")]
        tool = _NAME.match(mask, _tool_at(mask, m["how"], positional)) if len(positional) > 2 else None
        kind = "J" if re.search(r"(?i)J|Abs", m["how"]) else "L"
        move = Move(
            wobj[1].lower() if wobj else "wobj0",
            tool["name"].lower() if tool else None,
            kind not in unchecked,
        )
        spans.append((start, end, move))
        about = 1 if re.match(r"(?i)(?:Move|Trigg)C", m["how"]) else 0  # an arc has two places
        for k, (a, b) in enumerate(positional[:-1]):
            bare = re.sub(r"\\\s*\w+(?:\s*:=\s*\w+)?", "", mask[a:b])
            name = _NAME.fullmatch(bare)
            at = a + len(mask[a:b]) - len(mask[a:b].lstrip())
            if name is not None:
                to = replace(move, span=(at, at + len(name["name"])), one="{" not in bare, sure=k <= about)
                names.setdefault(name["name"].lower(), []).append(to)
            elif mask[at : at + 1].isalpha():
                others.append(replace(move, span=(at, a + len(mask[a:b].rstrip()))))
    return Moves(
        names, [s for s, _, _ in spans], [e for _, e, _ in spans], [move for *_, move in spans], others
    )


def _tool_at(mask: str, how: str, positional: list[tuple[int, int]]) -> int:
    """Where the tool's name stands: before its work object, else last, but for signals and calls behind it."""
    for a, b in positional:
        if _WITH.search(mask, a, b):
            return a
    behind = 2 if re.search(r"(?:DO|AO|GO)$", how, re.I) else 1 if how.lower().endswith("sync") else 0
    return positional[max(len(positional) - 1 - behind, 0)][0]


def cell_of(text: str, mask: str) -> Cell:
    """Work objects and tools that a module states in numbers; names in lower case."""
    frames: dict[str, tuple[float, ...]] = {}
    moved: dict[str, str] = {}
    for m in _WOBJ.finditer(text):
        if mask[m.start()] != text[m.start()]:
            continue  # in a comment
        name, held, fixed, *numbers = m.groups()
        if held.upper() == "TRUE":
            moved[name.lower()] = "the robot holds this work object"
        elif fixed.upper() == "FALSE":
            moved[name.lower()] = "a mechanical unit moves this work object"
        else:
            user, own = np.array(numbers, dtype=float).reshape(2, 7)
            if not all(abs(float(np.sum(np.clip(f[3:], -9.0, 9.0) ** 2)) - 1.0) <= 0.01 for f in (user, own)):
                moved[name.lower()] = "the square of a quaternion of it is not 1"
            elif max(np.abs(user).max(), np.abs(own).max()) <= LARGEST:
                frames[name.lower()] = _product(user, own)
    for m in _TOOL.finditer(text):
        if mask[m.start()] != text[m.start()]:
            continue
        name, held, *numbers = m.groups()
        if held.upper() == "FALSE":
            moved[name.lower()] = "this tool stands in the cell"
        else:
            frames[name.lower()] = tuple(float(n) for n in numbers)
    return Cell(frames, moved)


def _product(first: Array, second: Array) -> tuple[float, ...]:
    """Numbers of one frame in another."""
    a, b = (Rotation.from_quat(f[[4, 5, 6, 3]]) for f in (first, second))
    place = first[:3] + a.apply(second[:3])
    x, y, z, w = (a * b).as_quat()
    return (*place.tolist(), w, x, y, z)
