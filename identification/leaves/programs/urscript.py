"""Universal Robots' URScript: poses ``p[x, y, z, rx, ry, rz]`` in m and rad, joints ``[q1, ..., q6]`` in rad.

Targets are literals in motions (movej, movel, movep, movec, servoj), in ``get_inverse_kin``, and in variables that these
go to. ``pose_trans(feature, p[...])`` in a motion is a pose in that feature; features may be poses in features again.
"""

from __future__ import annotations

import functools
import re
from collections import Counter
from collections.abc import Iterator

from truepose.identification.leaves.programs.flow import Assignment, Flow, Keywords
from truepose.identification.leaves.programs.forms import RotationVector
from truepose.identification.leaves.programs.program import (
    Kind,
    Left,
    Lines,
    Program,
    Target,
    in_order,
    masked,
    shown,
)
from truepose.identification.leaves.programs.roles import targets_of, unsure, ways_to
from truepose.identification.leaves.programs.urscript_motions import IN_FORCE, LITERAL, SET_TCP, Motions
from truepose.identification.leaves.programs.urscript_numbers import constants_in
from truepose.models.machine.machine import Machine

_COMMENT, _QUOTE = r"#[^\r\n]*", r"\"[^\"\r\n]*\"|'[^'\r\n]*'"
_BEGIN = r"(?<![^\r\n:;])[ \t]*+(?:(?:global|local)[ \t]+)?"
_VALUE = rf"{LITERAL.pattern}(?=[ \t]*(?:[\r\n;]|\Z))|[^\r\n]*"
_ASSIGNED = re.compile(rf"{_BEGIN}(?P<name>[A-Za-z_]\w*)\s*=(?!=)[ \t]*(?P<value>{_VALUE})")
_COMPONENT = re.compile(
    r"(?<![^\r\n])[ \t]*+(?P<what>(?P<name>[A-Za-z_]\w*)\s*\[[^\]\r\n]*\]\s*=[^=][^\r\n]*)"
)
_WORDS = Keywords(
    function=r"(?:def|thread|sec)\b",
    loop=r"(?:while|for)\b",
    branch=r"if\b",
    turn=r"(?:elif|else)\b",
    close=r"end\b",
)
_FORM = RotationVector(
    ("m",) * 3, ("rad",) * 3, (7, 7, 7, 8, 8, 8), "x,y,z,rx,ry,rz in m and rad, a rotation vector"
)
_NOWHERE = "no motion here goes to it"


class UrScript:
    """URScript, .script."""

    name, title = "urscript", "URScript"

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        mask, lines = masked(text, _COMMENT, _QUOTE), Lines(text)
        motions = Motions(mask, lines, Flow.of(mask, _WORDS, _assignments(mask)), _FORM)
        motions.follow()
        targets, left = list(motions.worked_out), list(motions.left)
        for m in LITERAL.finditer(mask):
            name = _name_of(mask, m)
            goings = motions.goings.get(m.start(), [])
            if not goings and m.start() not in motions.features:
                left += _unused(mask, m, name, lines)
            for way in ways_to(
                goings, is_frame=m.start() in motions.features, in_frames=m["pose"] is not None
            ):
                targets += targets_of(way, _bare(mask, m, name or "literal"), mask, m.span(), lines)
                left += unsure(way, name or "literal", lines)
        left += _changed(mask, {t.name for t in targets}, lines)
        return Program(
            text, tuple(targets), in_order(left), _FORM, {"rad": "rad", "mm": "m"}, motions.frames,
            again=functools.partial(self.read, machine=machine, beside=beside),
        )  # fmt: skip


def _bare(mask: str, m: re.Match[str], name: str) -> Target:
    """Return what a literal says of a target by itself."""
    kind: Kind = "joints" if m["pose"] is None else "pose"
    return Target(0, name, kind, tuple(constants_in(mask, max(m.start(), m.end("pose")), m.end())))


def _assignments(mask: str) -> Iterator[Assignment]:
    for m in _ASSIGNED.finditer(mask):
        yield Assignment(m["name"], *m.span("value"))
    for m in _COMPONENT.finditer(mask):
        yield Assignment(m["name"], *m.span("what"), partly=True)
    for m in SET_TCP.finditer(mask):
        yield Assignment(IN_FORCE, *m.span())


def _name_of(mask: str, m: re.Match[str]) -> str | None:
    """The variable that a literal is assigned to; None in a motion or elsewhere."""
    begin = max(mask.rfind("\n", 0, m.start()), mask.rfind("\r", 0, m.start())) + 1
    assigned = re.fullmatch(rf"{_BEGIN}(?P<name>[A-Za-z_]\w*)\s*=\s*", mask[begin : m.start()])
    return assigned and assigned["name"]


def _unused(mask: str, m: re.Match[str], name: str | None, lines: Lines) -> list[Left]:
    """Poses that no motion here goes to; lists of other things are no targets."""
    if m["pose"] is None or name is None:
        return []
    why = _NOWHERE if _words(mask)[name] == 1 else "motions go to what is worked out of it"
    return [Left(lines.of(m.start()), shown(f"{name} = {m.group()}"), why)]


@functools.lru_cache(maxsize=2)
def _words(mask: str) -> Counter[str]:
    """How often each word stands in a text; once for all of its variables."""
    return Counter(re.findall(r"\w+", mask))


def _changed(mask: str, names: set[str], lines: Lines) -> Iterator[Left]:
    for m in _COMPONENT.finditer(mask):
        if m["name"] in names:
            why = "the program changes a target while it runs; what it writes is not corrected"
            yield Left(lines.of(m.start("what")), shown(m["what"]), why, computed=True)
