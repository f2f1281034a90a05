"""Motions of a KRL program: what each goes to, and in which frames, as far as its text and the file beside it tell."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.programs.flow import Assignment, Flow
from truepose.identification.leaves.programs.forms import Euler, numbers_of
from truepose.identification.leaves.programs.krl_frames import WORDS, Motion, Stand, changing, motions, stated
from truepose.identification.leaves.programs.program import Left, Lines, Span, Target, numbers_in, shown
from truepose.identification.leaves.programs.roles import ARGUMENT, SEVERAL, Going, worked_out

FIXED = "#TCP"
"""Name of the tool of motions whose tool stands in the cell."""
_ASSIGNED = re.compile(
    r"(?im)^[ \t]*(?:(?:GLOBAL|DECL|CONST)[ \t]+)*(?:\w+[ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*(?P<index>\[[^\]\r\n]*\])?"
    r"(?P<part>(?:\.\w+)*)[ \t]*=(?!=)[ \t]*(?P<value>[^\r\n]*)"
)
_LITERAL = re.compile(r"\{[^{}]*\}")
_NAME = re.compile(r"[A-Za-z_]\w*")
_SEVERAL = "@"
"""Name of a base or tool that may have several values."""
_UNKNOWN = "its value is worked out while the program runs"
_UNSURE = "its base or its tool may have several values there"
Key = tuple[bool, int]
"""A literal: whether it is in the file beside, and where it begins."""


@dataclass
class Motions:
    """What ``follow`` collects: ``goings`` by literal, and literals that are ``features`` as well.

    ``masks`` are the program's own text and that of the file beside it. ``frames`` are numbers of poses that others are in;
    ``followed`` are places of own motions to poses in poses; ``worked_out`` are targets computed of constants.
    """

    masks: tuple[str, str]
    lines: Lines
    taught: Mapping[str, Stand]
    goings: dict[Key, list[Going]] = field(default_factory=dict)
    features: set[Key] = field(default_factory=set)
    frames: dict[str, tuple[float, ...]] = field(default_factory=dict)
    followed: set[int] = field(default_factory=set)
    worked_out: list[Target] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)
    _flows: list[Flow] = field(default_factory=list)
    _changing: set[str] = field(default_factory=set)
    _parts: list[Key] = field(default_factory=list)
    """Literals that the expression in hand is made of."""

    def follow(self) -> None:
        """Look at every motion of both texts."""
        self._changing = changing(self.masks)
        given = [list(_assignments(mask)) for mask in self.masks]
        for k, mask in enumerate(self.masks):
            beside = [replace(one, file="beside") for one in given[1 - k]]
            self._flows.append(Flow.of(mask, WORDS, [*given[k], *beside]))
        for k, mask in enumerate(self.masks):
            for motion in motions(mask, self.taught, "beside:" if k else ""):
                self._take(bool(k), motion)

    def _take(self, other: bool, motion: Motion) -> None:
        *frames, leaf = motion.factors
        stand = motion.stand
        if not frames:
            stand = self.taught.get(_named(self.masks[other], leaf)[0].upper(), stand)
        base, tool = (
            self._in_force(other, stand.base, stand.base_at),
            self._in_force(other, stand.tool, stand.tool_at),
        )
        if not motion.sure or _SEVERAL in (base, tool):
            self._keep(other, leaf)
            if not other:
                self.left.append(
                    Left(self.lines.of(motion.start), shown(self.masks[0][slice(*leaf)]), _UNSURE)
                )
            return
        tool = FIXED if stand.fixed else tool
        self._parts.clear()
        names = [self._frame(other, span) for span in frames]
        if any(name is None for name in names):
            return
        within = tuple(name for name in names if name)
        going = Going(base, within, tool, motion.start, loose=not motion.checked, elsewhere=other)
        if self.masks[other].startswith("{", leaf[0]):
            self.goings.setdefault((other, leaf[0]), []).append(going)
            found = True
        else:
            found = self._take_name(other, leaf, going)
        if found and frames:
            self.features.update(self._parts)
            self.followed |= set() if other else {motion.start}

    def origins(self, product: Span) -> tuple[Span, ...]:
        """Return the literals that the first factor of an own product may be."""
        return self._flows[0].origins(self.masks[0], factors(self.masks[0], *product)[0], _LITERAL)

    def _keep(self, other: bool, span: Span) -> None:
        """Leave what a motion goes to as it is."""
        if self.masks[other].startswith("{", span[0]):
            self.features.add((other, span[0]))
            return
        for one in self._flows[other].reaching(_named(self.masks[other], span)[0], span[0]):
            self.features.add((other != bool(one.file), one.start))

    def _in_force(self, other: bool, name: str | None, at: int | None) -> str | None:
        """The name of a base or tool, with its place where the program gives it several values, of which one holds."""
        if name is None:
            return None
        if {name, name.partition("[")[0]} & self._changing:
            return _SEVERAL
        if at is None:
            return name
        self._parts.clear()
        pose = self._pose(other, (at, at + len(name)))
        self.features.update(self._parts)
        assigned = self._flows[other].assigned(name, at)
        if len(assigned) <= 1 and all(one.is_whole for one in assigned):
            return name
        if pose is None:
            return _SEVERAL
        own = f"{name}@{'beside:' if other else ''}{at}"
        self.frames[own] = numbers_of(Euler(), pose)
        return own

    def _take_name(self, other: bool, span: Span, going: Going) -> bool:
        """What a motion goes to that names a variable; return False where nothing is known of it."""
        name, whole = _named(self.masks[other], span)
        reaching = self._flows[other].reaching(name, span[0])
        going = replace(going, name=span, sure=len(reaching) == 1 and reaching[0].is_whole and whole)
        for one in reaching:
            key = (other != bool(one.file), one.start)
            mask = self.masks[key[0]]
            if mask.startswith("{", one.start) and ":" not in outside(mask[one.start : one.end]):
                self.goings.setdefault(key, []).append(going)
            elif other or one.partly:
                continue
            elif one.parameter:
                self.left.append(Left(self.lines.of(going.place), name, ARGUMENT))
            elif (pose := self._pose(other, span)) is not None:
                self._work_out(name, pose, going)
            else:
                why = _UNKNOWN if len(reaching) == 1 else SEVERAL
                self.left.append(Left(self.lines.of(going.place), name, why))
        if not reaching and not other and not going.within:
            why = "its value is in neither this text nor the file beside it"
            self.left.append(Left(self.lines.of(going.place), shown(self.masks[0][slice(*span)]), why))
        return bool(reaching)

    def _work_out(self, name: str, pose: Array, going: Going) -> None:
        """A target that has the value of an expression of constants: the motion gets a copy."""
        self.features.update(self._parts)
        pairs = zip("XYZABC", numbers_of(Euler(), pose), strict=True)
        literal = "{" + ",".join(f"{axis} {v:.6f}" for axis, v in pairs) + "}"
        bare = Target(0, name, "pose", tuple(numbers_in(literal, 0, len(literal))))
        self.worked_out += worked_out(
            replace(going, loose=False), going.name or (0, 0), bare, literal, self.lines
        )

    def _frame(self, other: bool, span: Span) -> str | None:
        """The name of a pose that another is in, its numbers known; None where they are not, or may be several."""
        pose = self._pose(other, span)
        if pose is None:
            return None
        name = f"{shown(self.masks[other][slice(*span)])}@{'beside:' if other else ''}{span[0]}"
        self.frames[name] = numbers_of(Euler(), pose)
        return name

    def _pose(self, other: bool, span: Span, depth: int = 0) -> Array | None:
        """The pose (4, 4), mm, of an expression of constants. What it is made of has to stay as it is."""
        mask, product = self.masks[other], np.eye(4)
        for start, end in factors(mask, *span):
            if mask.startswith("{", start):
                one = _constant(mask[start:end])
                self._parts.append((other, start))
            else:
                one = self._value(other, (start, end), depth)
            if one is None:
                return None
            product = product @ one
        return product

    def _value(self, other: bool, span: Span, depth: int) -> Array | None:
        name, whole = _named(self.masks[other], span)
        reaching = self._flows[other].reaching(name, span[0])
        if depth > 20 or not whole:
            return None
        poses = [self._pose(other != bool(one.file), (one.start, one.end), depth + 1) for one in reaching]
        return poses[0] if len(reaching) == 1 and reaching[0].is_whole else None


def factors(mask: str, start: int, end: int) -> list[Span]:
    """Spans of what `:` multiplies between two positions, without the space around."""
    out = []
    for m in re.compile(r"(?:\{[^{}]*\}|[^:{}])+").finditer(mask, start, end):
        piece = m.group()
        a, b = m.start() + len(piece) - len(piece.lstrip()), m.end() - len(piece) + len(piece.rstrip())
        out.append((a, max(a, b)))
    return out


def _assignments(mask: str) -> Iterator[Assignment]:
    for m in _ASSIGNED.finditer(mask):
        start, end = m.span("value")
        partly = bool(m["index"]) or bool(m["part"])
        yield Assignment(m["name"], start, start + len(mask[start:end].rstrip()), partly=partly)


def _named(mask: str, span: Span) -> tuple[str, bool]:
    """The name in a span, and whether it is not that of an element or a component."""
    m = _NAME.match(mask, *span)
    return (m.group(), m.end() == span[1]) if m else ("", False)


def outside(text: str) -> str:
    """The text without what is in braces."""
    return re.sub(r"\{[^{}]*\}", "", text)


def _constant(text: str) -> Array | None:
    numbers = stated(text)
    return None if numbers is None else np.asarray(Euler().poses(np.array([numbers]))[0])
