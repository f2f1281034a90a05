"""Universal Robots' URScript: poses ``p[x, y, z, rx, ry, rz]`` in m and rad, joints ``[q1, ..., q6]`` in rad.

Targets are literals in motions (movej, movel, movep, movec, servoj), in ``get_inverse_kin``, and in variables that these
go to. ``pose_trans(feature, p[...])`` in a motion is a pose in that feature; features may be poses in features again.
"""

from __future__ import annotations

import functools
import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.programs.flow import (
    ARGUMENT,
    SEVERAL,
    Assignment,
    Flow,
    Going,
    Keywords,
    targets_of,
    unsure,
    ways_to,
    worked_out,
)
from truepose.identification.leaves.programs.program import (
    NUMBER,
    Kind,
    Left,
    Lines,
    Number,
    Program,
    RotationVector,
    Span,
    Target,
    closing,
    in_order,
    masked,
    numbers_in,
    numbers_of,
    parts,
    shown,
)
from truepose.models.machine.machine import Machine

# -- Numbers of a URScript literal: plain, products of plain ones, or ``d2r`` of one

CONSTANT = rf"(?:[+-]?d2r\s*\(\s*{NUMBER}\s*\)|{NUMBER}(?:\s*[*/]\s*{NUMBER})*+)"
_CONSTANT = re.compile(CONSTANT)
_DEGREES = re.compile(rf"(?P<sign>[+-]?)d2r\s*\(\s*(?P<deg>{NUMBER})")
_FACTOR = re.compile(rf"(?P<how>[*/]?)\s*(?P<number>{NUMBER})")


def constants_in(text: str, start: int, end: int) -> list[Number]:
    """Return the constants between two positions; the text of one that is worked out is its value."""
    found = _CONSTANT.finditer(text, start, end)
    return [Number(m.start(), m.end(), _plain(m.group())) for m in found]


def _plain(text: str) -> str:
    """Return the text of a constant's value; one that is none is beyond every limit."""
    degrees, factors = _DEGREES.match(text), list(_FACTOR.finditer(text))
    if degrees is None and len(factors) == 1:
        return text
    if degrees is not None:
        value = math.radians(float(f"{degrees['sign']}1") * float(degrees["deg"]))
    else:
        value = 1.0
        for m in factors:
            number = float(m["number"])
            value = value * number if m["how"] != "/" else value / number if number else math.inf
    return f"{value:.10f}" if math.isfinite(value) else "1e99"


# -- Motions of a URScript: what each goes to, in which features and with which tool, as far as its text tells

_SIX = r"\[\s*" + r"\s*,\s*".join([CONSTANT] * 6) + r"\s*\]"
LITERAL = re.compile(rf"(?:(?P<pose>(?<!\w)p[ \t]*)|(?<![\w\]])){_SIX}")
_CALL = re.compile(r"\b(?P<what>movej|movel|movep|movec|servoj|servoc|get_inverse_kin)\s*\(")
SET_TCP = re.compile(r"\bset_tcp\s*\(")
IN_FORCE = "set_tcp()"
"""What the flow of a text calls the tool in force."""
_TRANS = re.compile(r"\s*pose_trans\s*\(")
_NAME = re.compile(r"[A-Za-z_]\w*")
_PLACES = {"movec": 2}
_UNSURE = "@"
"""Name of a tool that may have several values."""
_COMPUTED = "worked out while the program runs"
_DEEPEST = 50
"""Poses in poses, and names of names, that are followed."""


@dataclass
class Motions:
    """What ``follow`` collects: ``goings`` by the start of the literal, and starts of literals that are ``features`` as well.

    ``frames`` are numbers of features and tools; ``worked_out`` are targets that the program computes from constants.
    """

    mask: str
    lines: Lines
    flow: Flow
    form: RotationVector
    goings: dict[int, list[Going]] = field(default_factory=dict)
    features: set[int] = field(default_factory=set)
    frames: dict[str, tuple[float, ...]] = field(default_factory=dict)
    worked_out: list[Target] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)

    def follow(self) -> None:
        """Look at every motion of the text."""
        tools = self._tools()
        for call in _CALL.finditer(self.mask):
            end = closing(self.mask, call.end() - 1)
            if end is None:
                continue
            arguments = parts(self.mask, call.end(), end)
            near = self._near(arguments[1:2]) if call["what"] == "get_inverse_kin" else None
            force = self.flow.in_force(IN_FORCE, call.start())
            held = [tools.get(one.start) if one else None for one in force]
            going = Going(None, (), held[-1], call.start(), near=near)
            several = {self.frames.get(name, name) if name else None for name in held}
            unsure = len(several) > 1 or _UNSURE in several
            for argument in arguments[: _PLACES.get(call["what"], 1)]:
                span = self._bare(argument)
                if unsure and not self.mask.startswith("get_inverse_kin", span[0]):
                    why = "its tool may have several values there"
                    self.left.append(self.lines.left(span[0], self.mask[slice(*span)], why))
                    self._pose(span)
                else:
                    self._take(span, replace(going, place=span[0]), call["what"])

    def _take(self, span: Span, going: Going, what: str) -> None:
        """What one argument of a motion goes to."""
        piece = self.mask[slice(*span)]
        if LITERAL.fullmatch(piece):
            self.goings.setdefault(span[0], []).append(going)
        elif _NAME.fullmatch(piece):
            self._take_name(span, going, what)
        elif piece.startswith("get_inverse_kin"):  # its own argument is looked at by itself
            return
        elif (inside := self._factors(span)) is not None:
            feature = self._frame(inside[0])
            if feature is None:
                self._leave(going, f"{what}({piece}", "its feature may have several values there")
                return
            inner = (*going.within, feature) if going.base is not None else ()
            self._take(inside[1], replace(going, base=going.base or feature, within=inner), what)
        else:
            within = going.base is not None  # what it is in stays, and is no target that is corrected
            origins = None if within else self.flow.origins(self.mask, span, LITERAL)
            self.left.append(self.lines.left(span[0], f"{what}({piece}", _COMPUTED, not within, origins))

    def _take_name(self, span: Span, going: Going, what: str) -> None:
        """What a motion goes to that names a variable: the literals that it may have there, or what they are worked out of."""
        name = self.mask[slice(*span)]
        reaching = self.flow.reaching(name, span[0])
        going = replace(going, name=span, sure=len(reaching) == 1)
        for one in reaching:
            value = self._bare((one.start, one.end))
            text = self.mask[slice(*value)]
            if one.partly or text.startswith("get_inverse_kin"):
                continue
            if one.parameter:
                self._leave(going, f"{what}({name}", ARGUMENT)
                continue
            if LITERAL.fullmatch(text):
                self.goings.setdefault(value[0], []).append(going)
            elif (pose := self._pose(value)) is not None:
                self._work_out(name, pose, going)
            else:
                self._leave(going, f"{what}({name}", "its value is worked out while the program runs")
        if not reaching:
            self._leave(going, f"{what}({name}", "its value is not in this text")

    def _work_out(self, name: str, pose: Array, going: Going) -> None:
        """A target that has the value of an expression of constants: the motion gets a copy."""
        if not going.sure or going.name is None:
            self._leave(going, name, SEVERAL)
            return
        values = numbers_of(self.form, pose)
        literal = f"p[{', '.join(f'{v:.1f}' if v == 0 else f'{v:.10f}' for v in values)}]"
        bare = Target(0, name, "pose", tuple(numbers_in(literal, 1, len(literal))))
        self.worked_out += worked_out(going, going.name, bare, literal, self.lines)

    def _leave(self, going: Going, what: str, why: str) -> None:
        self.left.append(self.lines.left(going.place, what, why))

    def _frame(self, span: Span, called: str = "") -> str | None:
        """The name of a feature or tool, its numbers known where the text has them; None where they may be several.

        An expression is ``called`` this.
        """
        piece = self.mask[slice(*span)]
        named = _NAME.fullmatch(piece) is not None
        reaching = self.flow.reaching(piece, span[0]) if named else ()
        pose = self._pose(span)
        if pose is None:
            return None if self._is_unsure(span) else shown(piece)
        alone = named and len(self.flow.assigned(piece, span[0])) == 1
        bare = shown(piece) if named else called or shown(piece)
        name = piece if alone else f"{bare}@{reaching[0].start if reaching else span[0]}"
        self.frames[name] = numbers_of(self.form, pose)
        return name

    def _is_unsure(self, span: Span, depth: int = 0) -> bool:
        """Return True if the text gives a name in an expression several values, or others than it shows."""
        for m in _NAME.finditer(self.mask, *span):
            reaching = self.flow.reaching(m.group(), m.start())
            if len(reaching) > 1 or not all(one.is_whole for one in reaching) or depth > _DEEPEST:
                return True
            if any(self._is_unsure((one.start, one.end), depth + 1) for one in reaching):
                return True
        return False

    def _pose(self, span: Span, depth: int = 0) -> Array | None:
        """The pose (4, 4), mm, of an expression of constants. What it is made of has to stay as it is."""
        span = self._bare(span)
        piece = self.mask[slice(*span)]
        literal = LITERAL.fullmatch(piece)
        if depth > _DEEPEST or (literal and literal["pose"] is None):
            return None
        if literal:
            values = [n.value for n in constants_in(piece, literal.end("pose"), len(piece))]
            self.features.add(span[0])
            return np.asarray(self.form.poses(np.array([values]))[0])
        if _NAME.fullmatch(piece):
            reaching = self.flow.reaching(piece, span[0])
            poses = [self._pose((one.start, one.end), depth + 1) for one in reaching if one.is_whole]
            return poses[0] if len(reaching) == len(poses) == 1 else None
        factors = [self._pose(one, depth + 1) for one in self._factors(span) or ()]
        known = [one for one in factors if one is not None]
        return known[0] @ known[1] if len(known) == 2 else None

    def _factors(self, span: Span) -> list[Span] | None:
        """The two arguments where an expression is ``pose_trans``."""
        trans = _TRANS.match(self.mask, *span)
        if trans is None or closing(self.mask, trans.end() - 1) != span[1] - 1:
            return None
        inside = parts(self.mask, trans.end(), span[1] - 1)
        return [self._bare(one) for one in inside] if len(inside) == 2 else None

    def _near(self, argument: list[Span]) -> tuple[float, ...] | None:
        """Joints of the argument ``qnear``, where they stand there or in a variable."""
        for span in argument:
            start, end = self._bare(span)
            named = re.compile(r"qnear\s*=\s*").match(self.mask, start, end)
            piece = self.mask[named.end() if named else start : end]
            known = [self.mask[one.start : one.end].strip() for one in self.flow.reaching(piece, start)]
            literal = LITERAL.fullmatch(piece) or LITERAL.fullmatch(known[-1] if known else "")
            if literal and literal["pose"] is None:
                return tuple(n.value for n in constants_in(literal.group(), 0, len(literal.group())))
        return None

    def _tools(self) -> dict[int, str]:
        """Names of what calls of set_tcp set, by position."""
        out: dict[int, str] = {}
        for m in SET_TCP.finditer(self.mask):
            end = closing(self.mask, m.end() - 1)
            if end is None:
                continue
            span = self._bare(parts(self.mask, m.end(), end)[0])
            out[m.start()] = self._frame(span, "set_tcp") or _UNSURE
        return out

    def _bare(self, span: Span) -> Span:
        """A span without the space around it."""
        piece = self.mask[slice(*span)]
        start = span[0] + len(piece) - len(piece.lstrip())
        return start, max(start, span[1] - len(piece) + len(piece.rstrip()))


_COMMENT, _QUOTE = r"#[^\r\n]*", r"\"[^\"\r\n]*\"|'[^'\r\n]*'"
# -- Universal Robots' URScript: poses ``p[x, y, z, rx, ry, rz]`` in m and rad, joints ``[q1, ..., q6]`` in rad

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
            is_frame = m.start() in motions.features
            if not goings and not is_frame:
                left += _unused(mask, m, name, lines)
            for way in ways_to(goings, is_frame=is_frame, in_frames=m["pose"] is not None):
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
    return [lines.left(m.start(), f"{name} = {m.group()}", why)]


@functools.lru_cache(maxsize=2)
def _words(mask: str) -> Counter[str]:
    """How often each word stands in a text; once for all of its variables."""
    return Counter(re.findall(r"\w+", mask))


def _changed(mask: str, names: set[str], lines: Lines) -> Iterator[Left]:
    for m in _COMPONENT.finditer(mask):
        if m["name"] in names:
            why = "the program changes a target while it runs; what it writes is not corrected"
            yield lines.left(m.start("what"), m["what"], why, computed=True)
