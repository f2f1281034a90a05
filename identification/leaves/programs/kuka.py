"""KUKA's KRL: positions in .src and .dat files.

Targets are constants ``{X 1, Y 2, ...}`` and ``{A1 1, A2 2, ...}`` behind a motion (PTP, LIN, CIRC, SPTP, SLIN, SCIRC, SPL) and
in variables of the types POS, E6POS, AXIS and E6AXIS, or of FRAME where a motion goes to them. Which base and tool a
target is told in comes from the FDAT of its name (taught points), else from ``$BASE`` and ``$TOOL``, ``BAS(#BASE, n)`` and
``BAS(#TOOL, n)`` before the motions to it, in the order of the text.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from truepose.identification.leaves.programs.configurations import StatusTurn
from truepose.identification.leaves.programs.forms import Euler
from truepose.identification.leaves.programs.krl_frames import Stand, fdats, frames
from truepose.identification.leaves.programs.krl_motions import FIXED, Motions, outside
from truepose.identification.leaves.programs.program import (
    NUMBER,
    Kind,
    Left,
    Lines,
    Number,
    Program,
    Span,
    Target,
    closing,
    in_order,
    masked,
    parts,
    shown,
)
from truepose.identification.leaves.programs.roles import Going, Way, targets_of, unsure, ways_to
from truepose.models.machine.machine import Machine

_COMMENT = r";[^\r\n]*|(?m:^[ \t]*&[^\r\n]*)"
_AGGREGATE = re.compile(r"\{")
_FIELD = re.compile(rf"\s*(\w+)\s+({NUMBER})\s*")
_TYPED = r"(?:(?:GLOBAL|DECL|CONST)\s+)*(?P<type>POS|E6POS|FRAME|AXIS|E6AXIS)\s+"
_ASSIGNED = re.compile(
    rf"(?i)^\s*(?:(?:GLOBAL|DECL|CONST)\s+)*(?:{_TYPED})?(?P<name>\$?\w+(?:\s*\[[^\]]*\])?(?:\.\w+)*)\s*=\s*$"
)
_DECLARED = re.compile(rf"(?im)^[ \t]*{_TYPED}(?P<names>[\w \t,\[\]]+)$")
_MOTION = re.compile(
    r"(?i)^\s*(?P<how>S?PTP|S?LIN|S?CIRC|SPL|S?(?:PTP|LIN|CIRC)_REL)\b\s*(?P<before>(?:[^,{}]*,|\{[^{}]*\}\s*,)?)\s*$"
)
_POSE, _JOINTS = ("X", "Y", "Z", "A", "B", "C"), ("A1", "A2", "A3", "A4", "A5", "A6")
_FRAMES = re.compile(r"(?i)^(?:\$BASE|\$TOOL|\$WORLD|\$ROBROOT|(?:BASE|TOOL)_DATA\[.*|\$?MACHINE_\w+.*)$")
_OWN, _OTHER = "", "beside:"
_EXTERNAL = re.compile(r"E[1-6]")


@dataclass
class _Found:
    """What is collected while a text is read."""

    targets: list[Target] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)


class Kuka:
    """KRL, .src and .dat."""

    name, title = "kuka", "KUKA KRL"

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        mask, lines, found = masked(text, _COMMENT), Lines(text), _Found()
        other = "" if beside is None else masked(beside, _COMMENT)
        taught = fdats(other) | fdats(mask)
        went = Motions((mask, other), lines, taught)
        went.follow()
        types = _types(mask) | _types(other)
        count = len(machine.mechanism.readings) if machine else len(_JOINTS)
        for text_of, is_beside in ((mask, False), (other, True)):
            _Reader(text_of, is_beside, lines, found, went, taught, types, count).take()
        self._computed(mask, lines, found, went)
        targets, left = [*found.targets, *went.worked_out], [*found.left, *went.left]
        return Program(
            text, tuple(targets), in_order(left), Euler(), {"rad": "deg", "mm": "mm"},
            frames(other, _OTHER) | frames(mask, _OWN) | went.frames, StatusTurn(),
            again=functools.partial(self.read, machine=machine, beside=beside),
        )  # fmt: skip

    def _computed(self, mask: str, lines: Lines, found: _Found, went: Motions) -> None:
        """Motions to what the program works out while it runs."""
        motion = re.compile(r"(?im)^[ \t]*((?:S?PTP|S?LIN|S?CIRC|SPL)\b[^\r\n]*)")
        for m in motion.finditer(mask):
            what = m.group(1)
            products = [
                p
                for p in parts(mask, m.start(1) + len(what.split()[0]), m.end(1))
                if ":" in outside(mask[slice(*p)])
            ]
            if products and not any(p[0] <= place < p[1] for p in products for place in went.followed):
                origins = went.origins(products[0])
                why = "worked out by `:` while the program runs"
                found.left.append(Left(lines.of(m.start(1)), shown(what), why, True, origins))
            elif re.match(r"(?i)\w+\s+[A-Z_]\w*\s*\(", what):
                found.left.append(
                    Left(
                        lines.of(m.start(1)), shown(what), "a function gives the point while the program runs"
                    )
                )
        component = re.compile(r"(?im)^[ \t]*(\w+(?:\[[^\]]*\])?\.(?:[XYZABC]|A[1-6])\s*=[^\r\n]*)")
        for m in component.finditer(mask):
            why = "the program changes a coordinate while it runs: it stands for what was written there, not corrected"
            found.left.append(Left(lines.of(m.start(1)), shown(m.group(1)), why, computed=True))


def _types(mask: str) -> dict[str, str]:
    """Types of positions by name, of declarations without values."""
    out: dict[str, str] = {}
    for m in _DECLARED.finditer(mask):
        names = re.findall(r"(\w+)\s*(?:\[[^\]]*\])?", m["names"])
        out |= {name.upper(): m["type"].upper() for name in names}
    return out


def _aggregates(mask: str) -> Iterator[tuple[int, int]]:
    """Spans of constants in braces, outermost ones."""
    at = 0
    while (found := _AGGREGATE.search(mask, at)) is not None:
        end = closing(mask, found.start())
        if end is None:
            at = found.end()
            continue
        yield found.start(), end + 1
        at = end + 1


@dataclass
class _Reader:
    """What the constants of one text are: the program's, or that of the file ``beside`` it, of which motions get copies.

    ``count`` is how many axes the robot has.
    """

    mask: str
    beside: bool
    lines: Lines
    found: _Found
    went: Motions
    taught: dict[str, Stand]
    types: dict[str, str]
    count: int

    def take(self) -> None:
        """Collect targets, and what is left."""
        for start, end in _aggregates(self.mask):
            begin = max(self.mask.rfind("\n", 0, start), self.mask.rfind("\r", 0, start)) + 1
            self._constant(begin, start, end)

    def _constant(self, begin: int, start: int, end: int) -> None:
        """A constant ``[start:end]`` on the line that begins at ``begin``."""
        before, key = self.mask[begin:start], (self.beside, start)
        assigned, motion = _ASSIGNED.match(before), _MOTION.match(before)
        goings = self.went.goings.get(key, [])
        if not goings and ((assigned is None and motion is None) or key in self.went.features):
            return
        fields = _fields(self.mask, start, end)
        if fields is None or not (set(fields) & {*_POSE, *_JOINTS}):
            if fields is None and self._is_position(assigned, motion, start, end):
                self._leave(begin, end, "not all of its coordinates are plain numbers")
            return
        if assigned is not None:
            self._assigned(assigned, fields, goings, begin, (start, end))
        elif motion is not None and motion["how"].upper().endswith("_REL"):
            self._leave(begin, end, "a relative motion: it starts where the motion before it ended")
        else:
            self._target(before.split(maxsplit=1)[0].upper(), fields, goings, begin, (start, end))

    def _assigned(
        self, assigned: re.Match[str], fields: dict[str, Number], goings: list[Going], begin: int, span: Span
    ) -> None:
        name = re.sub(r"\s", "", assigned["name"]).upper()
        if _FRAMES.match(name):
            return
        bare = name.partition("[")[0]
        kind = (assigned["type"] or "").upper() or self.types.get(bare, "")
        if not goings and kind == "FRAME":
            return  # a frame of the program's own
        if not kind and not goings and not {"S", "T"} & set(fields):
            self._leave(begin, span[1], "no motion here goes to it")
            return
        self._target(name, fields, goings, begin, span)

    def _target(
        self, name: str, fields: dict[str, Number], goings: list[Going], begin: int, span: Span
    ) -> None:
        kind: Kind = "joints" if "A1" in fields else "pose"
        names = self._axes(fields) if kind == "joints" else _POSE
        missing = [f for f in names if f not in fields]
        external = [f for f in fields if _EXTERNAL.fullmatch(f) and fields[f].value != 0.0]
        if missing:
            self._leave(
                begin, span[1], f"{', '.join(missing)} of it stay what they are when the robot comes there"
            )
            return
        if external:
            used = ", ".join(f"{f} {fields[f].text}" for f in external)
            self._leave(begin, span[1], f"external axes are in use ({used})")
            return
        stand = self.taught.get(name.partition("[")[0], Stand(None, None))
        by_itself = Going(stand.base, (), FIXED if stand.fixed else stand.tool, begin, elsewhere=True)
        numbers = tuple(fields[f] for f in names)
        configured = {"S", "T"} <= set(fields) and kind == "pose"
        configuration = (fields["S"], fields["T"]) if configured else ()
        is_frame = (self.beside, span[0]) in self.went.features
        ways = ways_to(goings, is_frame=is_frame, in_frames=kind == "pose") or [Way((by_itself,), None)]
        for way in ways:
            if way.names is not None or not self.beside:
                self._way(way, Target(0, name, kind, numbers, configuration, place=begin), span)
        if not self.beside and ways[0].names is not None and any(one.elsewhere for one in goings):
            told = sorted({_stand_words(one) for one in goings})
            self._leave(
                begin, span[1], f"used with several frames ({'; '.join(told)}): its motions get copies"
            )

    def _way(self, way: Way, bare: Target, span: Span) -> None:
        """Motions to a constant in the same frames: it is changed itself, or each of them gets a copy."""
        self.found.left += unsure(way, bare.name, self.lines)
        for target in targets_of(way, bare, self.mask, span, self.lines):
            if target.tool == FIXED and target.kind == "pose":
                why = "the tool is fixed in the cell and the robot holds the part (#TCP)"
                at = bare.place if way.names is None else target.place
                self.found.left.append(Left(self.lines.of(at), shown(self.mask[bare.place : span[1]]), why))
            else:
                self.found.targets.append(replace(target, tool=None if target.tool == FIXED else target.tool))

    def _axes(self, fields: dict[str, Number]) -> tuple[str, ...]:
        """Names of the robot's axes; a robot of fewer than six has no others, or they are 0."""
        own, others = _JOINTS[: self.count], _JOINTS[self.count :]
        return own if all(f not in fields or fields[f].value == 0.0 for f in others) else _JOINTS

    def _is_position(
        self, assigned: re.Match[str] | None, motion: re.Match[str] | None, start: int, end: int
    ) -> bool:
        inside = self.mask[start + 1 : end]
        typed = assigned is not None and assigned["type"] is not None
        return (motion is not None or typed) and re.match(
            r"(?i)\s*(?:\w+\s*:)?\s*(?:X|A1)\s", inside
        ) is not None

    def _leave(self, begin: int, end: int, why: str) -> None:
        if not self.beside:
            start = begin + len(self.mask[begin:end]) - len(self.mask[begin:end].lstrip())
            self.found.left.append(Left(self.lines.of(start), shown(self.mask[begin:end]), why))


def _stand_words(going: Going) -> str:
    base, tool = (shown(name.partition("@")[0]) if name else "none" for name in (going.base, going.tool))
    return f"base {base} with tool {tool}"


def _fields(mask: str, start: int, end: int) -> dict[str, Number] | None:
    """Fields of a constant by name; None where one is no plain number."""
    typed = re.compile(r"\s*\w+\s*:").match(mask, start + 1, end - 1)
    out: dict[str, Number] = {}
    for a, b in parts(mask, typed.end() if typed else start + 1, end - 1):
        m = _FIELD.fullmatch(mask, a, b)
        if m is None:
            return None
        out[m.group(1).upper()] = Number(m.start(2), m.end(2), m.group(2))
    return out
