"""Motions of a URScript: what each goes to, in which features and with which tool, as far as its text tells."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.programs.flow import Flow
from truepose.identification.leaves.programs.forms import RotationVector, numbers_of
from truepose.identification.leaves.programs.program import (
    Left,
    Lines,
    Span,
    Target,
    closing,
    numbers_in,
    parts,
    shown,
)
from truepose.identification.leaves.programs.roles import ARGUMENT, SEVERAL, Going, worked_out
from truepose.identification.leaves.programs.urscript_numbers import CONSTANT, constants_in

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
            held = [
                tools.get(one.start) if one else None for one in self.flow.in_force(IN_FORCE, call.start())
            ]
            going = Going(None, (), held[-1], call.start(), near=near)
            several = {self.frames.get(name, name) if name else None for name in held}
            unsure = len(several) > 1 or _UNSURE in several
            for argument in arguments[: _PLACES.get(call["what"], 1)]:
                span = self._bare(argument)
                if unsure and not self.mask.startswith("get_inverse_kin", span[0]):
                    self._leave(
                        replace(going, place=span[0]),
                        self.mask[slice(*span)],
                        "its tool may have several values there",
                    )
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
            self.left.append(
                Left(self.lines.of(span[0]), shown(f"{what}({piece}"), _COMPUTED, not within, origins)
            )

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
        self.left.append(Left(self.lines.of(going.place), shown(what), why))

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
        inside = self._factors(span)
        factors = [self._pose(one, depth + 1) for one in inside or ()]
        return (
            factors[0] @ factors[1] if factors and factors[0] is not None and factors[1] is not None else None
        )

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
